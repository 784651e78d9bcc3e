"""The tip as a camera sees it: late, at its own rate, and not exactly."""

from collections import deque
from math import ceil

import numpy as np

from softrobot_env.core.arrays import like, on_host
from softrobot_env.envs.observations.readouts import BatchReadout, ChainReadout, SensedReadout
from softrobot_env.robots import CAMERA_PERIOD

#: Standard deviations at which a camera's noise ends, so that it has bounds.
FARTHEST = 6.0

#: Pictures of many cameras whose noise is drawn at once.
_BLOCK = 64


class Camera:
    """A camera that sees late and not exactly, one picture per `CAMERA_PERIOD` on average.

    Each is taken at the first control instant after it is due: from one to the next it is a whole
    number of control periods, the one below or above a `CAMERA_PERIOD`, and one where a control
    period is longer.

    Attributes:
        position: (coordinates,) [m], what the newest picture at hand says.
        velocity: (coordinates,) [m/s], by difference to the picture before, over the time between.
    """

    def __init__(
        self, noise: float, delay: int, control_period: float, seed: int, coordinates: int = 2
    ) -> None:
        """A camera with noise of standard deviation `noise` [m], `delay` control periods late.

        It sees so many coordinates.
        """
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame = CAMERA_PERIOD / control_period
        self._generator = np.random.default_rng(seed)
        self._instant, self._due = -1, 0.0
        self._undeveloped: deque[tuple[int, np.ndarray]] = deque()
        self._taken = -1
        self.position, self.velocity = np.zeros((2, coordinates))

    def start(self, tip: np.ndarray) -> None:
        """Look at a tip at rest at (coordinates,) [m] until there are two pictures."""
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tip)

    def see(self, tip: np.ndarray) -> bool:
        """Come to the next control instant, with the tip at (coordinates,) [m].

        Returns:
            Whether a picture is new.
        """
        self._instant += 1
        if self._instant >= self._due:
            self._due += self._frame
            normal = np.clip(
                self._generator.standard_normal(self.position.size), -FARTHEST, FARTHEST
            )
            self._undeveloped.append((self._instant, tip + self._noise * normal))
        if not self._undeveloped or self._undeveloped[0][0] > self._instant - self._delay:
            return False
        taken, seen = self._undeveloped.popleft()
        self.velocity = (seen - self.position) / ((taken - self._taken) * self._period)
        self.position, self._taken = seen, taken
        return True

    @property
    def age(self) -> float:
        """How long ago [s] the newest picture at hand was taken."""
        return (self._instant - self._taken) * self._period


class Cameras:
    """As many as n robots: what `Camera` says of each, at once.

    Attributes:
        position, velocity: (n, coordinates) [m, m/s], see `Camera`.
    """

    def __init__(
        self, count: int, noise: float, delay: int, control_period: float, coordinates: int = 2
    ) -> None:
        """Cameras that are to be started; arguments as `Camera`'s."""
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame = CAMERA_PERIOD / control_period
        self._everyone = np.arange(count)
        self._generators: list[np.random.Generator | None] = [None] * count
        self._normal = np.zeros((count, _BLOCK, coordinates))
        # Rings of undeveloped pictures: there is one at an instant at most.
        self._seen = np.zeros((count, delay + 1, coordinates))
        self._when = np.zeros((count, delay + 1), dtype=int)
        self._instant, self._due = np.zeros(count, dtype=int), np.zeros(count)
        self._pictures, self._developed = np.zeros((2, count), dtype=int)
        self._taken = np.zeros(count, dtype=int)
        self.position, self.velocity = np.zeros((2, count, coordinates))

    def start(self, which: np.ndarray, seeds: list[int], tip: np.ndarray) -> None:
        """Start cameras `which` (k,), each with a seed, before tips at rest at (k, coordinates)."""
        for i, seed in zip(which.tolist(), seeds, strict=True):
            self._generators[i] = np.random.default_rng(seed)
        self._instant[which] = self._taken[which] = -1
        self._due[which] = self._pictures[which] = self._developed[which] = 0
        self.position[which] = self.velocity[which] = 0.0
        tips = np.zeros_like(self.position)
        tips[which] = tip
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tips, which)

    def see(self, tip: np.ndarray, which: np.ndarray | None = None) -> None:
        """Come to the next control instant, all or `which` (k,); tips of all (n, coordinates)."""
        which = self._everyone if which is None else which
        self._instant[which] += 1
        self._take(which[self._instant[which] >= self._due[which]], tip)
        # The oldest that is not developed yet; where there is none, it is an older one.
        oldest = self._when[which, self._developed[which] % (self._delay + 1)]
        late = oldest <= self._instant[which] - self._delay
        self._develop(which[late & (self._developed[which] < self._pictures[which])])

    def _take(self, which: np.ndarray, tip: np.ndarray) -> None:
        """Take pictures of the tips `which` (k,) of all."""
        self._due[which] += self._frame
        number = self._pictures[which]
        place = number % (self._delay + 1)
        at = number % _BLOCK
        for i in which[at == 0].tolist():
            normal = self._generators[i].standard_normal(self._normal.shape[1:])
            self._normal[i] = np.clip(normal, -FARTHEST, FARTHEST)
        self._seen[which, place] = tip[which] + self._noise * self._normal[which, at]
        self._when[which, place] = self._instant[which]
        self._pictures[which] += 1

    def _develop(self, which: np.ndarray) -> None:
        """Let the next pictures `which` (k,) be the newest."""
        place = self._developed[which] % (self._delay + 1)
        seen, taken = self._seen[which, place], self._when[which, place]
        passed = (taken - self._taken[which]) * self._period
        self.velocity[which] = (seen - self.position[which]) / passed[:, None]
        self.position[which], self._taken[which] = seen, taken
        self._developed[which] += 1


def filmed(readout: ChainReadout | BatchReadout, camera: Camera | Cameras) -> SensedReadout:
    """A readout with the tip as cameras see it; every `update` is their next control instant."""
    seen = {
        "tip_position": lambda: like(camera.position.copy(), readout.tip),
        "tip_velocity": lambda: like(camera.velocity.copy(), readout.tip),
    }
    if isinstance(camera, Cameras):
        return SensedReadout(readout, seen, lambda tip, which: camera.see(on_host(tip), which))
    return SensedReadout(readout, seen, lambda tip, _: camera.see(np.array(tip)))
