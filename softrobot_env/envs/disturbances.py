"""What lies between policy and robot: the drives' gain and delay, and noise of the sensors."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from softrobot_env.core.arrays import HOST, HostArrays, namespace
from softrobot_env.envs.observations.table import SENSOR_NOISE
from softrobot_env.robots.variations import VARIATIONS

#: Standard deviations at which noise ends, so that it has bounds.
_FARTHEST = 6.0

#: Standard deviations at scale 1 for which observation spaces leave room.
NOISE_ROOM = VARIATIONS["sensor_noise"].range[1] * _FARTHEST

#: Control instants whose noise is drawn at once.
_BLOCK = 64

_FIRST = np.array([0])
_WHOLE = 1e-9  # s that a delay may miss a multiple of the control period


@dataclass(frozen=True)
class Disturbance:
    """The part of a variation that is not the robot's.

    Attributes:
        tension_gain: [1], tension applied per tension commanded, up to the tendon's limit.
        delay: Control periods from an action to its effect.
        sensor_noise: [1], scale of the noise of `observations.table`.
        sensor_errors: [1], scale of the usual imperfections of curvature sensors
            (`robots.sensors.USUAL`), of a specimen drawn for the episode.
    """

    tension_gain: float = 1.0
    delay: int = 0
    sensor_noise: float = 0.0
    sensor_errors: float = 0.0

    def drives(self, limit: np.ndarray, tension: np.ndarray) -> "Drives | None":
        """Started drives of one robot, None where they apply what is commanded.

        Args:
            limit: (n_tendons,) [N], largest tensions.
            tension: (n_tendons,) [N], commanded at the start.
        """
        if self.tension_gain == 1 and self.delay == 0:
            return None
        drives = Drives(1, limit)
        drives.start(_FIRST, np.array([self.tension_gain]), np.array([self.delay]), tension)
        return drives

    def noise(self, sizes: dict[str, int], rng: np.random.Generator) -> "SensorNoise | None":
        """Started noise of one robot, with a sampled seed; None without, which samples nothing.

        Args:
            sizes: Of the observables that can have noise.
            rng: Where the seed comes from.
        """
        if self.sensor_noise == 0:
            return None
        noise = SensorNoise(1, sizes)
        noise.start(0, self.sensor_noise, noise_seed(rng))
        return noise


def split(
    variation: dict[str, float], control_period: float
) -> tuple[dict[str, float], Disturbance]:
    """Part of the robot, and the rest.

    Raises:
        ValueError: The delay is no multiple of the control period.
    """
    robot = {name: v for name, v in variation.items() if VARIATIONS[name].apply is not None}
    rest = {name: float(v) for name, v in variation.items() if name not in robot}
    if "delay" in rest:
        rest["delay"] = periods(rest["delay"], control_period)
    return robot, Disturbance(**rest)


def periods(delay: float, control_period: float) -> int:
    """Control periods in a delay [s].

    Raises:
        ValueError: It is no multiple of the control period.
    """
    count = round(delay / control_period)
    if abs(delay - count * control_period) > _WHOLE:
        raise ValueError(
            f"delay must be a multiple of the control period, {control_period:g} s, got {delay!r}"
        )
    return count


def rounded(variation: dict[str, float], control_period: float) -> dict[str, float]:
    """The variation with its delay at the nearest allowed multiple of the control period."""
    if "delay" not in variation:
        return variation
    most = int(VARIATIONS["delay"].range[1] / control_period + _WHOLE)
    return variation | {
        "delay": min(round(variation["delay"] / control_period), most) * control_period
    }


def reported_variation(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a variation, numbers or arrays (n,), by their names in `info`."""
    return {f"variation_{name}": np.array(value, dtype=float)[()] for name, value in values.items()}


def noise_seed(rng: np.random.Generator) -> int:
    """Seed of an episode's noise: one draw, whatever the length of the episode."""
    return int(rng.integers(2**63))


class Drives:
    """Drives of n robots, with a gain and a delay each; neutral until started.

    Applied is min(gain x commanded, limit): a drive pulls no more than its limit.
    """

    def __init__(self, count: int, limit: np.ndarray, arrays: HostArrays = HOST) -> None:
        """Neutral drives of `count` robots, with limits (n_tendons,) [N], which take `arrays`."""
        self._arrays, self._limit = arrays, arrays.real(limit)
        self._everyone = arrays.index(np.arange(count))
        self._gain = arrays.real(np.ones((count, 1)))
        self._delay = np.zeros(count, dtype=int)
        self._sent = arrays.real(np.zeros((count, 1, len(limit))))  # a ring of commands
        self._now = 0

    def start(
        self, which: np.ndarray, gain: np.ndarray, delay: np.ndarray, tension: np.ndarray
    ) -> np.ndarray:
        """Start episodes, commands before them being the tensions at the start.

        Args:
            which: (k,) int, the robots.
            gain: (k,) [1].
            delay: (k,) int, control periods.
            tension: (k, n_tendons) or (n_tendons,) [N], commanded at the start.

        """
        self._lengthen(int(np.max(delay)) + 1)
        robots, arrays = self._arrays.index(which), self._arrays
        self._gain[robots, 0], self._delay[which] = arrays.real(gain), delay
        tension = np.broadcast_to(tension, (len(which), len(self._limit)))[:, None]
        self._sent[robots] = arrays.real(tension.copy())

    def _lengthen(self, size: int) -> None:
        """Make room for `size` commands of each robot."""
        old = self._sent.shape[1]
        if size > old:
            kind = namespace(self._sent)
            ordered = kind.roll(self._sent, -self._now - 1, 1)  # the latest comes last
            room = self._arrays.real(np.zeros((len(ordered), size - old, len(self._limit))))
            self._sent = kind.concatenate((room, ordered), axis=1)
            self._now = size - 1

    def apply(self, commanded: np.ndarray) -> np.ndarray:
        """Tensions (n, n_tendons) [N] in force in a control period, by those commanded in it."""
        size = self._sent.shape[1]
        self._now = (self._now + 1) % size
        self._sent[:, self._now] = commanded
        return self.tension

    @property
    def tension(self) -> np.ndarray:
        """(n, n_tendons) [N], in force now."""
        late = self._arrays.index((self._now - self._delay) % self._sent.shape[1])
        sent = self._gain * self._sent[self._everyone, late]
        return namespace(sent).minimum(sent, self._limit)


class SensorNoise:
    """White Gaussian noise of n robots' sensors, none until started.

    Normal variates beyond 6 standard deviations (one in 5e8) are set to 6. Every robot's noise
    depends on its seed alone: all observables draw, observed or not.
    """

    def __init__(self, count: int, sizes: dict[str, int]) -> None:
        """No noise for `count` robots, whose observables with sensors have these sizes."""
        each = list(sizes.values())
        ends = np.cumsum(each)
        self._columns = dict(zip(sizes, map(slice, ends - each, ends), strict=True))
        self._deviation = np.repeat([SENSOR_NOISE[name] for name in sizes], each)
        self._everyone = np.arange(count)
        self._scale = np.zeros(count)
        self._generators: list[np.random.Generator | None] = [None] * count
        self._rows = np.zeros((count, _BLOCK, len(self._deviation)))
        self._at = np.zeros(count, dtype=int)
        self._now = self._rows[:, 0]

    def start(self, robot: int, scale: float, seed: int | None) -> None:
        """Start an episode of one robot with noise of a scale [1], None as seed if that is 0."""
        self._scale[robot] = scale
        self._generators[robot] = None if seed is None else np.random.default_rng(seed)
        self._rows[robot] = 0.0
        self._at[robot] = _BLOCK - 1  # the next instant draws

    def advance(self, which: np.ndarray | None = None) -> None:
        """Go on to the next control instant, all or the robots `which` (k,) int."""
        which = self._everyone if which is None else which
        self._at[which] += 1
        for robot in np.flatnonzero(self._at == _BLOCK).tolist():
            self._at[robot] = 0
            self._draw(robot)
        self._now = self._rows[self._everyone, self._at]

    def _draw(self, robot: int) -> None:
        generator = self._generators[robot]
        if generator is not None:
            normal = generator.standard_normal(self._rows.shape[1:])
            normal = np.clip(normal, -_FARTHEST, _FARTHEST, out=normal)
            self._rows[robot] = normal * (self._scale[robot] * self._deviation)

    def on(self, name: str) -> np.ndarray:
        """Noise (n, size) on an observable of `observations.table` at this instant."""
        return self._now[:, self._columns[name]]

    @property
    def noisy(self) -> np.ndarray:
        """(n,) bool, which robots have noise."""
        return self._scale > 0
