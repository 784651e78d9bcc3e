"""What the sensors of n robots read, one control instant after the other."""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy import ndarray

from softrobot_env.robots.sensors import Sensor

from . import optics
from .optics import CONVERTER, SATURATED, STRAIGHT
from .shape import Places

#: Standard deviations at which noise ends.
FARTHEST = 6.0

_BLOCK = 64  # instants whose noise is sampled at once


class SensorArray:
    """The sensors of n robots of one kind, each its own specimen.

    Attributes:
        size: Readings of a robot: of its sensors in turn, see `robots.sensors.Sensor`.
        reading: (n, size), now; late where sensors are.
    """

    def __init__(
        self, sensors: Sequence[Sensor], edges: ndarray, control_period: float, count: int = 1
    ) -> None:
        """Sensors that are to be started.

        Args:
            sensors: As designed; what is built is said by `start`.
            edges: (cells + 1,) [m] between which shapes are given, see `sensing.shape`.
            control_period: [s].
            count: Number n of robots.
        """
        self._sensors, self._period = tuple(sensors), control_period
        self._everyone = np.arange(count)
        self._places = Places(edges, *_places(self._sensors))
        self._columns = _slices([sensor.size for sensor in sensors])
        self._joints = _slices([optics.joints_of(sensor) for sensor in sensors])
        self.size = self._columns[-1].stop
        self._of = np.repeat(np.arange(len(sensors)), [sensor.size for sensor in sensors])

        def each(value: Callable[[Sensor], float]) -> ndarray:
            return np.array([value(sensor) for sensor in sensors])[self._of]

        self._frame = each(lambda s: max(1.0, 1 / (s.rate * control_period)))
        self._late = each(lambda s: round(s.delay / control_period))
        self._straight = each(lambda s: STRAIGHT.get(s.kind, 1.0))
        self._most = each(lambda s: SATURATED.get(s.kind, np.inf))
        self._step = each(lambda s: float(s.kind != "tags"))
        self._noise = each(lambda s: s.deviation)
        self._state(count, self._joints[-1].stop)

    def _state(self, count: int, joints: int) -> None:
        size, sensors = self.size, len(self._sensors)
        self._gain, self._moment_arm = np.ones((count, size)), np.ones((count, joints))
        self._tilt, self._azimuth = np.zeros((2, count, sensors, 4))
        self._acceptance = np.ones((count, sensors))
        names = ("temperature", "drift", "stretch", "stray", "flicker")
        self._error = {name: np.zeros((count, sensors)) for name in names}
        self._lag = np.zeros((count, joints))
        self._backlash = np.zeros((count, joints, len(optics.PLAY), 2))
        self._drift = np.zeros((count, size))
        self._instant = np.zeros(count, int)
        self._due = np.zeros((count, size))
        self._held = np.zeros((count, size))
        self._ring = np.zeros((count, 1 + int(self._late.max()), size))
        self._generators: list[np.random.Generator | None] = [None] * count
        self._normal = np.zeros((count, _BLOCK, 3, size))
        self._offset = np.array([sensor.offset for sensor in self._sensors])
        self.reading = np.zeros((count, size))

    def start(
        self, which: ndarray, built: Sequence[Sequence[Sensor]], seeds: list[int], shape: ndarray
    ) -> None:
        """Start robots `which` (k,) at rest.

        Args:
            which: The robots.
            built: (k,), sensors of each as built.
            seeds: (k,), of noise and drift.
            shape: (k, cells, 3) [1/m].
        """
        for i, sensors, seed in zip(which.tolist(), built, seeds, strict=True):
            self._build(i, sensors)
            self._generators[i] = np.random.default_rng(seed)
            self._drift[i] = np.clip(self._generators[i].standard_normal(self.size), -3, 3)
        self._instant[which], self._due[which] = 0, 0.0
        self._backlash[which] = 0.0  # the posture was reached from straight
        self._felt(which, shape)
        self._sample(which, shape, None)
        self._ring[which] = self._held[which][:, None]
        self.reading[which] = self._held[which]

    def _build(self, i: int, sensors: Sequence[Sensor]) -> None:
        for k, sensor in enumerate(sensors):
            one = optics.build(sensor)
            self._gain[i, self._columns[k]] = one.gain
            self._moment_arm[i, self._joints[k]] = one.moment_arm
            self._tilt[i, k], self._azimuth[i, k] = one.tilt, one.azimuth
            self._acceptance[i, k] = one.acceptance
            self._lag[i, self._joints[k]] = sensor.hysteresis
            for name, values in self._error.items():
                values[i, k] = getattr(sensor, name)

    def look(
        self, shape: ndarray, which: ndarray | None = None, touch: ndarray | None = None
    ) -> None:
        """Come to the next control instant, all robots or `which` (k,).

        Args:
            shape: (n, cells, 3) [1/m], of all robots.
            which: The robots.
            touch: (n, sensors) [N], contact force on each sensor; none unless given.
        """
        which = self._everyone if which is None else which
        self._instant[which] += 1
        self._sample(which, shape[which], None if touch is None else touch[which])
        self._ring[which, self._instant[which] % self._ring.shape[1]] = self._held[which]
        late = (self._instant[which][:, None] - self._late) % self._ring.shape[1]
        self.reading[which] = self._ring[which[:, None], late, np.arange(self.size)]

    def _sample(self, which: ndarray, shape: ndarray, touch: ndarray | None) -> None:
        """Take the samples that are due, of shapes (k, cells, 3) of robots `which` (k,)."""
        normal = self._noise_of(which)
        bend, spans = self._felt(which, shape)
        light = self._light(which, bend, spans)
        level = light * self._gains(which, normal, spans) + self._leaks(which, touch)
        noisy = self._straight * level + self._noise * normal[:, 1]
        counts = np.rint(np.clip(noisy, 0, np.minimum(self._most, CONVERTER)))
        counts = np.where(self._step > 0, counts, noisy)
        due = self._instant[which][:, None] >= self._due[which]
        self._due[which] += np.where(due, self._frame, 0.0)
        self._held[which] = np.where(due, counts / self._straight, self._held[which])

    def _felt(self, which: ndarray, shape: ndarray) -> tuple[ndarray, ndarray]:
        """Bends (k, j, 2) that joints feel in shapes, lagging behind, and turns of spans."""
        bend, spans = self._places.turns(shape)
        bend = bend * self._moment_arm[which][..., None]
        backlash = self._backlash[which]
        optics.follow(backlash, bend)
        self._backlash[which] = backlash
        return optics.lagged(backlash, bend, self._lag[which]), spans

    def _noise_of(self, which: ndarray) -> ndarray:
        """Normal variates (k, 3, size) of this instant; the drifts go on."""
        at = self._instant[which] % _BLOCK
        for i in which[at == 0].tolist():
            sampled = self._generators[i].standard_normal(self._normal.shape[1:])
            self._normal[i] = np.clip(sampled, -FARTHEST, FARTHEST)
        normal = self._normal[which, at]
        keep = np.exp(-self._period / optics.DRIFT_TIME)
        self._drift[which] = keep * self._drift[which] + np.sqrt(1 - keep**2) * normal[:, 2]
        return normal

    def _light(self, which: ndarray, bend: ndarray, spans: ndarray) -> ndarray:
        """Readings (k, size) of sensors whose joints have bends (k, j, 2), before any gain."""
        out, tags = np.empty((len(which), self.size)), len(self._sensors)
        for k, sensor in enumerate(self._sensors):
            own = self._columns[k]
            acceptance = self._acceptance[which, k][:, None]
            if sensor.kind == "planar":
                angle = np.hypot(*np.moveaxis(bend[:, self._joints[k]], -1, 0))
                out[:, own] = optics.transmission(angle, acceptance).prod(axis=1, keepdims=True)
            elif sensor.kind == "spatial":
                azimuth, tilt = self._azimuth[which, k], self._tilt[which, k]
                aligned = optics.split_light(
                    bend[:, self._joints[k].start], azimuth, tilt, acceptance
                )
                out[:, own] = aligned * np.exp(1.0)
            else:
                turn = spans[:, tags : tags + sensor.segments]
                tags += sensor.segments
                out[:, own] = turn @ [np.cos(sensor.azimuth), np.sin(sensor.azimuth)]
        return out

    def _gains(self, which: ndarray, normal: ndarray, spans: ndarray) -> ndarray:
        """Factors (k, size) on the light; ones of tags."""
        error = {name: values[which][:, self._of] for name, values in self._error.items()}
        time = self._instant[which][:, None] * self._period
        warm = error["temperature"] * (1 - np.exp(-time / optics.WARMING_TIME))
        # Towards the side it lies on, a bend shortens the sensor.
        lengths = np.array([sensor.end - sensor.begin for sensor in self._sensors])
        mean = spans[:, : len(lengths)] / lengths[:, None]
        strain = -(mean * self._offset).sum(axis=2)[:, self._of]
        gain = self._gain[which] * (1 + optics.LIGHT_PER_KELVIN * warm)
        gain *= (1 + error["drift"] * self._drift[which]) * (1 + error["flicker"] * normal[:, 0])
        gain *= np.clip(1 - error["stretch"] * strain, 0.0, None)
        return np.where(self._step > 0, gain, 1.0)

    def _leaks(self, which: ndarray, touch: ndarray | None) -> ndarray | float:
        """Light (k, size) that contacts let in, over that of a straight sensor."""
        if touch is None:
            return 0.0
        return (self._error["stray"][which] * touch)[:, self._of] * self._step


def felt_bends(sensors: Sequence[Sensor], edges: ndarray, strain: ndarray) -> list[ndarray]:
    """Bends (n, joints, 2) [rad] of each sensor's joints.

    Args:
        sensors: The sensors.
        edges: (cells + 1,) [m].
        strain: (n, cells, 3) [1/m], shapes of n robots.
    """
    bends, _ = Places(edges, *_places(sensors)).turns(strain)
    return np.split(bends, np.cumsum([optics.joints_of(s) for s in sensors])[:-1], axis=1)


def _slices(counts: Sequence[int]) -> list[slice]:
    """Places of things of some counts, one after the other."""
    return [slice(end - count, end) for end, count in zip(accumulate(counts), counts, strict=True)]


def _places(sensors: Sequence[Sensor]) -> tuple[list, list]:
    """Joints and spans [m] of sensors: of each the span from end to end, then those of tags."""
    joints, tags = [], []
    for sensor in sensors:
        parts = 2 if sensor.kind == "spatial" else sensor.segments
        ends = np.linspace(sensor.begin, sensor.end, parts + 1).tolist()
        if sensor.kind == "tags":
            tags += list(pairwise(ends))
        else:
            joints += list(zip(ends[:-2], ends[1:-1], ends[2:], strict=True))
    return joints, [(sensor.begin, sensor.end) for sensor in sensors] + tags
