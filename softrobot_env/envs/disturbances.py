"""Disturbances between policy and robot: gain and delay of the drives, and sensor noise."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.arrays import HOST, HostArrays, namespace
from softrobot_env.robots.variations import VARIATIONS

from .observations.readouts import SensorNoise, filmed, fitted, noisy
from .observations.table import SENSOR_NOISE, Measured

if TYPE_CHECKING:
    from .parts import SimulatedParts

__all__ = ["SENSOR_NOISE", "Drives", "Periphery", "SensorNoise", "noise_seed"]

#: These disturbances by name, with their neutral values.
BETWEEN = {name: one.neutral for name, one in VARIATIONS.registered().items() if not one.apply}

_WHOLE = 1e-9  # s, tolerance of a delay as a multiple of the control period


def periods(delay: float, control_period: float) -> int:
    """Control periods in a delay [s].

    Raises:
        ValueError: It is not a multiple of the control period.
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
    return {f"variation_{name}": np.array(value, float)[()] for name, value in values.items()}


def noise_seed(rng: np.random.Generator) -> int:
    """Seed of an episode's noise: a single draw, independent of the length of the episode."""
    return int(rng.integers(2**63))


class Drives:
    """Drives of n robots, with a gain and a delay each; neutral until started.

    The applied tension is min(gain x commanded, limit).
    """

    def __init__(self, count: int, limit: ndarray, arrays: HostArrays = HOST) -> None:
        """Neutral drives of `count` robots, with limits (n_tendons,) [N], operating on `arrays`."""
        self._arrays, self._limit = arrays, arrays.real(limit)
        self._everyone = arrays.index(np.arange(count))
        self._gain = arrays.real(np.ones((count, 1)))
        self._delay = np.zeros(count, int)
        self._sent = arrays.real(np.zeros((count, 1, len(limit))))  # a ring of commands
        self._now = 0

    def start(self, which: ndarray, gain: ndarray, delay: ndarray, tension: ndarray) -> ndarray:
        """Start episodes; earlier commands are taken to be the tensions at the start.

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

    def apply(self, commanded: ndarray) -> ndarray:
        """Tensions (n, n_tendons) [N] applied in a control period, given those commanded in it."""
        self._now = (self._now + 1) % self._sent.shape[1]
        self._sent[:, self._now] = commanded
        return self.tension

    @property
    def tension(self) -> ndarray:
        """(n, n_tendons) [N], applied now."""
        late = self._arrays.index((self._now - self._delay) % self._sent.shape[1])
        sent = self._gain * self._sent[self._everyone, late]
        return namespace(sent).minimum(sent, self._limit)


class Periphery:
    """Drives, and sensors with their errors, between robots and policies.

    Attributes:
        drives: None if all apply their commands exactly.
        noise: Of sensors; None without noise.
        cameras, sensors: A twin's camera with errors, and observed curvature sensors; or None.
    """

    def __init__(
        self, parts: "SimulatedParts", count: int | None = None, arrays: HostArrays = HOST
    ) -> None:
        """Set up for one robot, or for `count` of them."""
        self._parts, self._count, self._arrays = parts, count or 1, arrays
        self._robots = 0 if count is None else slice(None)
        self.drives: Drives | None = None
        self.noise: SensorNoise | None = None
        self.cameras, self.sensors = parts.cameras(count), parts.sensors(self._count)

    def readout(self, exact: Measured) -> Measured:
        """Measurements as the sensors show them, from exact ones."""
        out = exact
        if self.sensors is not None:
            out = fitted(out, self.sensors, self._robots)
        if self.cameras is not None:
            out = filmed(out, self.cameras)
        return out if self.noise is None else noisy(out, self.noise, self._robots)

    def start_drives(self, which: ndarray, values: dict[str, ndarray], command: ndarray) -> ndarray:
        """Start the drives of robots `which` (k,).

        Args:
            which: Indices of the robots.
            values: (n,) of variations by name.
            command: (k, n_tendons) [N or m].

        Returns:
            (k, n_tendons) [N or m], what the drives apply.
        """
        gain = values["tension_gain"]
        delay = np.rint(values["delay"] / self._parts.control_period).astype(int)
        if np.all(gain == 1) and not delay.any():
            self.drives = None
            return command
        if self.drives is None:
            self.drives = Drives(self._count, self._parts.most, self._arrays)
        self.drives.start(which, gain[which], delay[which], command)
        return self._arrays.host(self.drives.tension)[which]

    def start_sensors(
        self,
        which: ndarray,
        values: dict[str, ndarray],
        generators: list[np.random.Generator],
        exact: Any,
    ) -> bool:
        """Start noise, cameras and sensors of robots `which` (k,), at rest.

        Args:
            which, values: See `start_drives`.
            generators: Of n robots, for the seeds.
            exact: The exact measurements.

        Returns:
            Whether noise was switched on or off, so that `readout` must be replaced.
        """
        scale, parts = values["sensor_noise"], self._parts
        changed = bool(scale.any()) != (self.noise is not None)
        if changed:
            self.noise = SensorNoise(self._count, parts.noise_sizes) if scale.any() else None
        seeds, sensed = [], []  # of cameras, and of curvature sensors
        for i in which.tolist():
            if self.noise is not None:
                self.noise.start(i, scale[i], noise_seed(generators[i]) if scale[i] else None)
            if self.cameras is not None:
                seeds.append(noise_seed(generators[i]) if parts.twin.camera_noise else 0)
            if self.sensors is not None:
                sensed.append(noise_seed(generators[i]))
        if self.cameras is not None:
            exact.update()
            tips = [exact.tip] if self._robots == 0 else self._arrays.host(exact.tip)
            self.cameras.start(which, seeds, np.asarray(tips)[which])
        if self.sensors is not None:
            errors = values["sensor_errors"][which].tolist()
            built = [parts.built_sensors(*pair) for pair in zip(errors, sensed, strict=True)]
            self.sensors.start(which, built, sensed, exact.shape()[which])
        return changed
