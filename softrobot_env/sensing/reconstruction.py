"""What policies want to know of a robot, from its curvature sensors: tip and curvatures.

While a robot is calibrated, a camera sees what sensors shall report later. Spatial sensors have a
model of their light, which takes their play and drift away (`estimation`). With what they and tags
report, arcs say roughly where the tip is; polynomials, as few as the postures determine, the rest.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, fields
from itertools import combinations_with_replacement, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.core.artifacts import Arrays
from softrobot_env.robots import RobotParams, Sensor

from .estimation import BendFilter, LightModel, calibrate

#: The observable that every calibration reports.
TIP = "tip_position"

#: Orders that are tried, postures that each coefficient wants, and parts of a cross-validation.
_ORDERS, _POSTURES, _PARTS = (1, 2, 3, 4, 5), 3, 6

#: Shrinks coefficients that postures hardly determine, over their number.
_RIDGE = 1e-6

#: Change of a polynomial [1] that the next order has to bring to be worth it.
_WORTH = 0.95


class SensedShape(NamedTuple):
    """What is known from one reading to the next.

    Attributes:
        filters: Of each spatial sensor, None of others.
        reading: (size,), the last that was finite.
        reported: By name, what the sensors report.
    """

    filters: tuple[BendFilter | None, ...]
    reading: ndarray
    reported: dict[str, ndarray]


@dataclass(frozen=True)
class Map:
    """Polynomials of features.

    Attributes:
        powers: (terms, features), of each feature in each term.
        weights: (terms, outputs).
        middle, half: (features,), which are scaled by them.
        error: [unit of the output], RMS over postures that were left out, largest output.
    """

    powers: ndarray
    weights: ndarray
    middle: ndarray
    half: ndarray
    error: float

    def __call__(self, features: ndarray) -> ndarray:
        """Outputs (..., outputs) of features (..., features), which do not leave their range far.

        Far beyond the postures a polynomial means nothing: features are taken at a fifth of their
        range beyond it.
        """
        scaled = np.clip((features - self.middle) / self.half, -1.2, 1.2)
        return _terms(scaled, self.powers) @ self.weights


def _terms(scaled: ndarray, powers: ndarray) -> ndarray:
    """Terms (..., terms) of scaled features (..., features)."""
    return np.prod(scaled[..., None, :] ** powers, axis=-1)


def _powers(features: int, order: int) -> ndarray:
    """Powers (terms, features) of all terms up to an order."""
    every = [
        np.bincount(np.array(which, int), minlength=features)
        for degree in range(order + 1)
        for which in combinations_with_replacement(range(features), degree)
    ]
    return np.array(every)


def fit_map(features: ndarray, outputs: ndarray) -> Map:
    """The polynomials that give outputs of postures best that were left out.

    Args:
        features: (n, f).
        outputs: (n, k).

    Raises:
        ValueError: Fewer postures than a linear map needs.
    """
    n, count = features.shape
    middle = (features.max(axis=0) + features.min(axis=0)) / 2
    half = np.maximum(np.ptp(features, axis=0) / 2, 1e-9)
    scaled = (features - middle) / half
    best: Map | None = None
    for order in _ORDERS:
        powers = _powers(count, order)
        if len(powers) * _POSTURES > n:
            break
        terms = _terms(scaled, powers)
        error = _left_out(terms, outputs)
        if best is None or error < _WORTH * best.error:
            best = Map(powers, _solved(terms, outputs), middle, half, error)
    if best is None:
        raise ValueError(
            f"{n} postures do not tell {count} quantities of the sensors apart: "
            f"{_POSTURES * (count + 1)} or more are needed"
        )
    return best


def _solved(terms: ndarray, outputs: ndarray) -> ndarray:
    square = terms.T @ terms
    return np.linalg.solve(square + _RIDGE * len(terms) * np.eye(len(square)), terms.T @ outputs)


def _left_out(terms: ndarray, outputs: ndarray) -> float:
    """RMS of the largest output over postures that the coefficients do not know."""
    part = np.arange(len(terms)) % _PARTS
    square = np.zeros(outputs.shape[1])
    for k in range(_PARTS):
        away = part == k
        off = terms[away] @ _solved(terms[~away], outputs[~away]) - outputs[away]
        square += (off**2).sum(axis=0)
    return float(np.sqrt(square.max() / len(terms)))


@dataclass(frozen=True)
class Arcs:
    """A robot made of arcs, one for each of its sensors' bends and turns.

    Attributes:
        lengths: (arcs,) [m].
        bends: (arcs, 2, features), of each arc [rad] by what sensors report.
        head: [m] beyond the last arc.
        base, axes: (3,) [m] and (3, 3), where the robot is clamped and its own axes, in the world.
    """

    lengths: ndarray
    bends: ndarray
    head: float
    base: ndarray
    axes: ndarray

    @classmethod
    def of(cls, robot: RobotParams) -> "Arcs | None":
        """Of a robot whose sensors lie one after the other; None where they overlap, or where one
        does not report to which side the robot bends.
        """
        parts = sorted(_parts(robot.sensors), key=lambda part: part[:2])
        begins, ends = np.array([part[:2] for part in parts]).T
        if any(s.kind == "planar" for s in robot.sensors) or (ends[:-1] > begins[1:] + 1e-9).any():
            return None
        edges = np.concatenate([[0.0], (ends[:-1] + begins[1:]) / 2, [robot.length]])
        lengths, count = np.diff(edges), len(parts[0][2].T)
        bends = np.zeros((len(parts), 2, count))
        for k, (begin, end, bend) in enumerate(parts):
            bends[k] = bend * lengths[k] / (end - begin)
        base, head = robot.clamp, robot.reach - robot.length
        return cls(lengths, bends, head, np.array(base.position), base.axes)

    def tip(self, features: ndarray) -> ndarray:
        """Output point (n, 3) [m] in the world, of features (n, f)."""
        turn = np.broadcast_to(np.eye(3), (len(features), 3, 3))
        place = np.zeros((len(features), 3))
        for length, by_features in zip(self.lengths, self.bends, strict=True):
            bend = features @ by_features.T
            size = np.hypot(*bend.T)[:, None]
            # sin(a) / a towards +z, and (1 - cos(a)) / a to the side.
            along, aside = np.sinc(size / np.pi), size * np.sinc(size / (2 * np.pi)) ** 2 / 2
            side = bend / np.where(size > 0, size, 1.0)
            chord = np.concatenate([aside * side, along], axis=1)
            place = place + length * np.einsum("nij,nj->ni", turn, chord)
            # By bends towards x and y it turns about y and -x.
            about = np.stack([-bend[:, 1], bend[:, 0], np.zeros(len(bend))], axis=1)
            turn = turn @ Rotation.from_rotvec(about).as_matrix()
        return self.base + (place + self.head * turn[:, :, 2]) @ self.axes.T


def _parts(sensors: Sequence[Sensor]) -> list[tuple[float, float, ndarray]]:
    """Begin and end [m] of what bends by features (2, f) [rad], for each that is reported."""
    count = reported(sensors)
    out, at = [], 0
    for sensor in sensors:
        parts = sensor.segments if sensor.kind == "tags" else 1
        ends = np.linspace(sensor.begin, sensor.end, parts + 1).tolist()
        for k, (begin, end) in enumerate(pairwise(ends)):
            bend = np.zeros((2, count))
            if sensor.kind == "tags":
                bend[:, at + k] = np.cos(sensor.azimuth), np.sin(sensor.azimuth)
            elif sensor.kind == "spatial":
                bend[:, at : at + 2] = 2 * np.eye(2)  # chords of halves: half of the whole turn
            out.append((begin, end, bend))
        at += reported([sensor])
    return out


def reported(sensors: Sequence[Sensor]) -> int:
    """Number of quantities that sensors report: bends of spatial ones, readings of others."""
    return sum(2 if sensor.kind == "spatial" else sensor.size for sensor in sensors)


@dataclass(frozen=True)
class Reconstruction:
    """What a calibrated robot's sensors report.

    Attributes:
        sensors: As designed.
        lights: Of each spatial sensor, None of others.
        arcs: Where the tip is, roughly; None where sensors do not say.
        coordinates: Out of x, y and z, those of the tip that are reported.
        maps: Name of an observable -> how it follows from the sensors, of the tip beyond the arcs.
    """

    sensors: tuple[Sensor, ...]
    lights: tuple[LightModel | None, ...]
    arcs: Arcs | None
    coordinates: tuple[int, ...]
    maps: dict[str, Map]

    @property
    def size(self) -> int:
        """Number of readings."""
        return sum(sensor.size for sensor in self.sensors)

    def begin(self, reading: ndarray) -> SensedShape:
        """Of a robot that was straight, and then rests where sensors read this (size,)."""
        filters = tuple(None if light is None else BendFilter(light) for light in self.lights)
        start = SensedShape(filters, np.full(self.size, np.nan), {})
        if not np.isfinite(reading).all():
            sizes = {name: one.weights.shape[1] for name, one in self.maps.items()}
            return start._replace(reported={n: np.full(k, np.nan) for n, k in sizes.items()})
        return self.update(start, reading, 0.0)

    def update(self, before: SensedShape, reading: ndarray, passed: float) -> SensedShape:
        """Take in a reading (size,) of `passed` seconds after the last.

        One that is not finite, or that is the last one still, changes nothing.
        """
        if not np.isfinite(reading).all() or np.array_equal(reading, before.reading):
            return before
        filters = deepcopy(before.filters)
        features = _features(self.sensors, filters, reading, passed)
        values = {name: found(features) for name, found in self.maps.items()}
        if self.arcs is not None:
            values[TIP] = values[TIP] + self.arcs.tip(features[None])[0, list(self.coordinates)]
        return SensedShape(filters, np.array(reading), values)

    def arrays(self) -> dict[str, ndarray]:
        """What a file holds of it."""
        out: dict[str, ndarray] = {"coordinates": np.array(self.coordinates)}
        for name, found in self.maps.items():
            out |= {f"map_{name}_{key}": np.asarray(value) for key, value in vars(found).items()}
        for k, light in enumerate(self.lights):
            values = {} if light is None else asdict(light)
            out |= {f"light_{k}_{key}": np.asarray(value) for key, value in values.items()}
        return out

    @classmethod
    def of(cls, robot: RobotParams, data: Arrays) -> "Reconstruction":
        """That of `arrays`, for a robot.

        Raises:
            ValueError: The arrays are damaged or of other sensors.
        """
        data.check_finite()
        sensors = robot.sensors
        lights = tuple(
            _part(data, LightModel, f"light_{k}_", _LIGHT) if sensor.kind == "spatial" else None
            for k, sensor in enumerate(sensors)
        )
        ends = "_powers"
        names = [n[4 : -len(ends)] for n in data if n.startswith("map_") and n.endswith(ends)]
        count, maps = reported(sensors), {}
        for name in names:
            terms = len(np.atleast_1d(data[f"map_{name}_powers"]))
            ends_of = {"middle": (count,), "half": (count,), "error": ()}
            shapes = {"powers": (terms, count), "weights": (terms, None), **ends_of}
            maps[name] = _part(data, Map, f"map_{name}_", shapes)
        if TIP not in maps:
            raise ValueError(f"{data.path} holds no map to {TIP}")
        coordinates = tuple(int(k) for k in data["coordinates"])
        return cls(tuple(sensors), lights, Arcs.of(robot), coordinates, maps)


#: Shapes of a `LightModel`.
_LIGHT = {
    **dict.fromkeys(("gain", "tilt", "azimuth"), (4,)),
    **dict.fromkeys(("acceptance", "lag"), ()),
    **dict.fromkeys(("straight", "curve"), (2,)),
    "turn": (2, 2),
}


def _part(
    data: Arrays, kind: type, prefix: str, shapes: Mapping[str, tuple[int | None, ...]]
) -> Any:
    data.check_shapes(shapes, prefix)
    values = {field.name: data[f"{prefix}{field.name}"] for field in fields(kind)}
    return kind(**{n: v.item() if v.ndim == 0 else v for n, v in values.items()})


def _features(
    sensors: Sequence[Sensor], filters: Sequence[BendFilter | None], reading: ndarray, passed: float
) -> ndarray:
    """What maps are fed with: bends of spatial sensors, readings of others."""
    out = []
    for one, own in zip(filters, _each(sensors, reading), strict=True):
        if one is not None:
            one.update(own, passed)
        out.append(own if one is None else one.bend)
    return np.concatenate(out)


def _each(sensors: Sequence[Sensor], readings: ndarray) -> list[ndarray]:
    """The readings (..., size) of each sensor."""
    return np.split(readings, np.cumsum([sensor.size for sensor in sensors])[:-1], axis=-1)


def reconstruct(
    robot: RobotParams,
    readings: ndarray,
    seen: Mapping[str, ndarray],
    coordinates: Sequence[int],
    places: Sequence[ndarray],
    passed: float,
) -> Reconstruction:
    """Calibrate the sensors of a robot by postures at rest.

    Args:
        robot: With its sensors as designed.
        readings: (n, size), in the order in which postures were visited, from the straight one on.
        seen: Name of an observable -> (n, k), as the camera saw it, `TIP` among them.
        coordinates: Out of x, y and z, those of the tip.
        places: (n, 2) for each sensor, what its bend grows with about in proportion, at most 0.2;
            see `estimation.calibrate`. Only those of spatial sensors count.
        passed: [s] from one posture to the next.

    Raises:
        ValueError: Too few postures.
    """
    sensors, every = robot.sensors, np.ones(len(readings), bool)
    lights = [
        calibrate(own, place, every, sensor) if sensor.kind == "spatial" else None
        for sensor, place, own in zip(sensors, places, _each(sensors, readings), strict=True)
    ]
    filters = [None if light is None else BendFilter(light) for light in lights]
    features = np.array([_features(sensors, filters, row, passed) for row in readings])
    arcs, beyond = Arcs.of(robot), dict(seen)
    if arcs is not None:
        beyond[TIP] = seen[TIP] - arcs.tip(features)[:, list(coordinates)]
    maps = {name: fit_map(features, values) for name, values in beyond.items()}
    return Reconstruction(tuple(sensors), tuple(lights), arcs, tuple(coordinates), maps)
