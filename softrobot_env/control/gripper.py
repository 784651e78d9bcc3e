"""The diameter of an unknown bar from the curvatures of fingers that enclose it."""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.learned.reduction.polynomials import Monomials
from softrobot_env.robots import Gripper, Sensor
from softrobot_env.sensing.calibration import Calibration

#: Order of the polynomial, and the curvature [1/m] and diameter [m] that scale its variables.
_ORDER, _BEND, _SIZE = 3, 30.0, 0.05


def mean_bends(gripper: Gripper, curvature: ndarray) -> ndarray:
    """Means over the fingers (..., pieces) [1/m], of curvatures (..., all pieces) of like fingers.

    Raises:
        ValueError: The fingers have different numbers of pieces.
    """
    pieces = {finger.robot.pieces for finger in gripper.fingers}
    if len(pieces) > 1:
        raise ValueError(f"gripper {gripper.name!r}: need fingers of as many pieces each")
    shape = (*np.shape(curvature)[:-1], len(gripper.fingers), pieces.pop())
    return np.reshape(curvature, shape).mean(axis=-2)


def size_by_sensor(gripper: Gripper, curvature: ndarray) -> ndarray:
    """Diameters (...) [m] of bars, if the second piece of each finger lies fully on them.

    Its curvature is then 1 / (d / 2 + the distance of the fibre from the surface).
    """
    width = gripper.fingers[0].robot.backbone.widest
    return 2 / mean_bends(gripper, curvature)[..., 1] - 2 * float(width)


@dataclass(frozen=True)
class SizeEstimator:
    """A polynomial in the mean curvatures of the fingers' pieces.

    The straight part of a finger near its clamp depends on the diameter, as does its bending
    further out, and both hardly depend on its stiffness.

    Attributes:
        gripper: The gripper.
        tension: [N], with which the fingers must close.
        weights: (terms,) [1].
    """

    gripper: Gripper
    tension: float
    weights: ndarray

    def __call__(self, curvature: ndarray) -> ndarray:
        """Diameters (...) [m] from curvatures (..., all pieces) [1/m]."""
        return _SIZE * (_terms(mean_bends(self.gripper, curvature)) @ self.weights)

    @classmethod
    def fitted(
        cls, gripper: Gripper, tension: float, curvature: ndarray, diameter: ndarray
    ) -> "SizeEstimator":
        """By least squares, from curvatures (n, all pieces) [1/m] and diameters (n,) [m].

        Raises:
            ValueError: Fewer examples than terms.
        """
        terms = _terms(mean_bends(gripper, curvature))
        if len(terms) < terms.shape[1]:
            raise ValueError(f"need {terms.shape[1]} examples or more, got {len(terms)}")
        weights = np.linalg.lstsq(terms, diameter / _SIZE, rcond=None)[0]
        return cls(gripper, tension, weights)


def _terms(bends: ndarray) -> ndarray:
    """Monomials (..., terms) up to the order, of curvatures (..., pieces) [1/m]."""
    return _monomials(bends.shape[-1])(bends / _BEND)


@cache
def _monomials(pieces: int) -> Monomials:
    return Monomials.of(pieces, 0, _ORDER, constant=True)


#: [m], the bar on which fingers are calibrated (thesis 4.1.3), and [N], to which they close.
DIAMETER, TENSION = 0.048, 38.0

#: [N], above which readings are used: below it fingers sag outwards, and planar sensors measure
#: only the magnitude of a bend.
LIFTED = 2.0

#: [s], of closing and opening.
_CLOSING, _OPENING = 1.2, 0.8

#: [m], tolerance between the ends of tags and those of a sensor.
_NEAR = 1e-9


@dataclass(frozen=True)
class FingerCalibration:
    """Calibrated planar sensors of grippers, one or n.

    Light is divided by that of the straight fingers at the start of every episode, which removes
    the drift of the gains, including that of warming up.

    Attributes:
        gripper: The gripper.
        angles: Of all planar sensors, finger by finger.
    """

    gripper: Gripper
    angles: Calibration

    @classmethod
    def fitted(cls, gripper: Gripper, readings: ndarray, order: int = 5) -> "FingerCalibration":
        """From readings (t, ..., size) of a grip; the first are of straight fingers.

        The reference is the tags' positions seen by a camera, as in the thesis.

        Raises:
            ValueError: A finger has no planar sensors, or no tags at their ends.
        """
        fibres, tags = columns(gripper)
        light = readings[..., fibres] / readings[:1, ..., fibres]
        turns = np.stack([readings[..., own].sum(axis=-1) for own in tags], axis=-1)
        return cls(gripper, Calibration.fitted(light, turns, order))

    def curvature(self, readings: ndarray, straight: ndarray) -> ndarray:
        """Mean curvatures (..., pieces) [1/m] of the parts with sensors.

        Args:
            readings: (..., size), see `observations.fingers`.
            straight: (..., size), those of straight fingers, with which the episode began.
        """
        fibres, _ = columns(self.gripper)
        lengths = [s.end - s.begin for f in self.gripper.fingers for s in _planar(f.robot.sensors)]
        return self.angles(readings[..., fibres] / straight[..., fibres]) / np.array(lengths)


def senses(gripper: Gripper) -> bool:
    """Whether the fingers of a gripper can be calibrated, see `columns`."""
    try:
        columns(gripper)
    except ValueError:
        return False
    return True


def _planar(sensors: tuple[Sensor, ...]) -> list[Sensor]:
    return [sensor for sensor in sensors if sensor.kind == "planar"]


def columns(gripper: Gripper) -> tuple[ndarray, list[ndarray]]:
    """Columns of the planar sensors in the readings of all fingers, and of the tags along each.

    Raises:
        ValueError: A finger has no planar sensors, or no tags at their ends.
    """
    fibres, tags, first = [], [], 0
    for finger in gripper.fingers:
        seen: dict[int, tuple[float, float]] = {}
        for sensor in finger.robot.sensors:
            ends = np.linspace(sensor.begin, sensor.end, sensor.size + 1)
            own = range(first, first + sensor.size)
            if sensor.kind == "tags":
                seen |= dict(zip(own, pairwise(ends.tolist()), strict=True))
            elif sensor.kind == "planar":
                fibres.append(first)
            first += sensor.size
        tags += [_along(finger.name, sensor, seen) for sensor in _planar(finger.robot.sensors)]
    if not fibres:
        raise ValueError(f"gripper {gripper.name!r}: its fingers carry no planar sensors")
    return np.array(fibres), tags


def _along(finger: str, sensor: Sensor, seen: dict[int, tuple[float, float]]) -> ndarray:
    """Columns of the tags that lie along a sensor of a finger."""
    inside = [
        column
        for column, (begin, end) in seen.items()
        if begin > sensor.begin - _NEAR and end < sensor.end + _NEAR
    ]
    covered = sum(seen[column][1] - seen[column][0] for column in inside)
    if abs(covered - (sensor.end - sensor.begin)) > _NEAR:
        raise ValueError(f"finger {finger!r}: calibrating {sensor.name!r} needs tags at its ends")
    return np.array(inside)


def calibration_grip(period: float) -> ndarray:
    """Tensions (steps,) [N] of a grip: closing beyond the enclosing tension, and opening."""
    closing, opening = (np.linspace(0, 1, 1 + round(t / period))[1:] for t in (_CLOSING, _OPENING))
    rise = (1 - np.cos(np.pi * closing)) / 2
    fall = (1 + np.cos(np.pi * opening)) / 2
    return TENSION * np.concatenate([rise, fall])


def calibrated(env: Any, specimens: dict[str, Any], seed: int) -> FingerCalibration:
    """Calibrate the fingers of environments whose bar is clamped (`VectorGripperEnv`).

    Args:
        env: The environments; they observe `sensors`.
        specimens: The fingers, as options of a reset.
        seed: Of noise.
    """
    observation, _ = env.reset(seed=seed, options=specimens | {"diameter": DIAMETER})
    readings = [observation["sensors"]]
    for tension in calibration_grip(env.control_period):
        action = 2 * np.minimum(tension / env.gripper.tension_limits, 1.0) - 1
        observation, *_ = env.step(np.broadcast_to(action, env.action_space.shape))
        if tension >= LIFTED:
            readings.append(observation["sensors"])
    return FingerCalibration.fitted(env.gripper, np.stack(readings))


#: [s], in which the tension rises, and after which the fingers are at rest.
RISE, CALM = 0.5, 0.7

#: Diameters [m] and the tensions [N] that hold bars of them.
_SIZES, _HOLDS = (0.045, 0.100), (20.0, 38.0)


@dataclass
class ScriptedGrip:
    """Closes all fingers to a tension, steadily, and keeps it.

    Attributes:
        gripper: The gripper.
        control_period: [s].
        tension: [N], at the end.
    """

    gripper: Gripper
    control_period: float
    tension: float = 30.0

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[ndarray, Any]:
        """See `interfaces.Policy`; the state is the number of steps (n,) of each episode so far."""
        count = next(iter(observation.values())).shape[:-1]
        steps = np.zeros(count, int) if state is None else state["steps"]
        if episode_start is not None:
            steps = np.where(np.reshape(episode_start, steps.shape), 0, steps)
        known = {} if state is None else state
        steps = steps + 1
        tension, kept = self._tension(steps, observation, known)
        limits = self.gripper.tension_limits
        action = 2 * np.minimum(tension[..., None] / limits, 1.0) - 1
        return action.astype(np.float32), {"steps": steps, **kept}

    def _tension(
        self, steps: ndarray, observation: Observation, known: dict[str, ndarray]
    ) -> tuple[ndarray, dict[str, ndarray]]:
        """Tensions (...) [N] in steps (...) from 1 on, and what to remember."""
        return self.tension * np.minimum(steps * self.control_period / RISE, 1.0), {}


@dataclass(kw_only=True)
class SizedGrip(ScriptedGrip):
    """Closes to the tension of an estimator, then to one that holds a bar of the estimated size.

    Attributes:
        size: The estimator.
        sensors: Calibration from `sensors` to curvatures, which are observed directly unless it is
            given.
    """

    size: SizeEstimator
    sensors: FingerCalibration | None = None

    def _tension(
        self, steps: ndarray, observation: Observation, known: dict[str, ndarray]
    ) -> tuple[ndarray, dict[str, ndarray]]:
        """The estimator's tension; from `CALM` on that of the size, which is estimated once."""
        curvature, kept = self._bends(steps, observation, known)
        time = steps * self.control_period
        first = self.size.tension * np.minimum(time / RISE, 1.0)
        sizes = known.get("diameter", np.full(time.shape, np.nan))
        sizes = np.where(
            time < CALM, np.nan, np.where(np.isnan(sizes), self.size(curvature), sizes)
        )
        wanted = np.interp(np.nan_to_num(sizes), _SIZES, _HOLDS)
        share = np.clip((time - CALM) / 0.2, 0.0, 1.0)
        after = self.size.tension + share * (wanted - self.size.tension)
        return np.where(np.isnan(sizes), first, after), {"diameter": sizes, **kept}

    def _bends(
        self, steps: ndarray, observation: Observation, known: dict[str, ndarray]
    ) -> tuple[ndarray, dict[str, ndarray]]:
        """Curvatures (..., pieces) [1/m], and the readings of straight fingers to remember."""
        if self.sensors is None:
            return observation["curvature"], {}
        now = observation["sensors"]
        straight = np.where(steps[..., None] == 1, now, known.get("straight", now))
        return self.sensors.curvature(now, straight), {"straight": straight}
