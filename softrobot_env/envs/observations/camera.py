"""The tip as a camera sees it: late, at its own rate, and not exactly."""

from collections import deque
from math import ceil
from typing import Any

import numpy as np

from softrobot_env.envs.observations.readouts import SensedReadout
from softrobot_env.robots.twin import FRAME

#: Standard deviations at which a camera's noise ends, so that it has bounds.
FARTHEST = 6.0


class Camera:
    """A camera that sees late and not exactly, one picture per `FRAME` on average.

    Each is taken at the first control instant after it is due: from one to the next it is a whole
    number of control periods, the one below or above a `FRAME`, and one where a period is longer.

    Attributes:
        position: (d,) [m], what the newest picture at hand says.
        velocity: (d,) [m/s], by difference to the picture before, over the time between them.
    """

    def __init__(
        self, noise: float, delay: int, control_period: float, seed: int, dimensions: int = 2
    ) -> None:
        """A camera with noise of standard deviation `noise` [m], `delay` control periods late."""
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame = FRAME / control_period
        self._generator = np.random.default_rng(seed)
        self._instant, self._due = -1, 0.0
        self._undeveloped: deque[tuple[int, np.ndarray]] = deque()
        self._taken, self.position, self.velocity = -1, *np.zeros((2, dimensions))

    def start(self, tip: np.ndarray) -> None:
        """Look at a tip at rest at (d,) [m] until there are two pictures."""
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tip)

    def see(self, tip: np.ndarray) -> bool:
        """Come to the next control instant, with the tip at (d,) [m]; whether a picture is new."""
        self._instant += 1
        if self._instant >= self._due:
            self._due += self._frame
            normal = np.clip(
                self._generator.standard_normal(len(self.position)), -FARTHEST, FARTHEST
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
    """A camera for each of n robots, seen together.

    Attributes:
        position, velocity: (n, d) [m, m/s], as of `Camera`.
    """

    def __init__(
        self, count: int, noise: float, delay: int, control_period: float, dimensions: int
    ) -> None:
        """Arguments as of `Camera`."""
        self._make = lambda seed: Camera(noise, delay, control_period, seed, dimensions)
        self._cameras = [self._make(0) for _ in range(count)]
        self.position, self.velocity = np.zeros((2, count, dimensions))

    def start(self, robot: int, tip: np.ndarray, seed: int) -> None:
        """Let a new camera look at the tip (d,) [m] at rest of one robot."""
        self._cameras[robot] = self._make(seed)
        self._cameras[robot].start(tip)

    def see(self, tips: np.ndarray, which: np.ndarray | None = None) -> None:
        """Come to the next control instant of all robots, or of `which` (k,); tips (n, d) [m]."""
        for i in range(len(tips)) if which is None else which.tolist():
            camera = self._cameras[i]
            if camera.see(tips[i].copy()):
                self.position[i], self.velocity[i] = camera.position, camera.velocity


def filmed(readout: Any, camera: Camera | Cameras) -> SensedReadout:
    """A readout with the tip as a camera sees it; every `update` is its next control instant."""
    seen = {
        "tip_position": lambda: camera.position.copy(),
        "tip_velocity": lambda: camera.velocity.copy(),
    }
    if isinstance(camera, Cameras):
        return SensedReadout(readout, seen, camera.see)
    return SensedReadout(readout, seen, lambda tip, _: camera.see(np.array(tip)))
