"""What the sensors of fingers tell of their shape, once a grip has calibrated them."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from softrobot_env.robots import Gripper, Sensor
from softrobot_env.sensing.calibration import Calibration

#: [m], the bar on which fingers are calibrated (thesis 4.1.3), and [N], to which they close.
DIAMETER, TENSION = 0.048, 38.0

#: [N], from which on readings count: with less fingers sag outwards, and planar sensors tell the
#: size of a bend alone.
LIFTED = 2.0

#: [s], of closing and opening.
_CLOSING, _OPENING = 1.2, 0.8

#: [m], how far ends of tags may lie from those of a sensor.
_NEAR = 1e-9


@dataclass(frozen=True)
class FingerCalibration:
    """Calibrated planar sensors of grippers, one or n.

    Light is taken over that of the straight fingers from which every episode starts: so the drift
    of gains, and what warming up does to them, is left out.

    Attributes:
        gripper: The gripper.
        angles: Of all planar sensors, finger by finger.
    """

    gripper: Gripper
    angles: Calibration

    @classmethod
    def fitted(cls, gripper: Gripper, readings: np.ndarray, order: int = 5) -> "FingerCalibration":
        """From readings (t, ..., size) of a grip; the first are of straight fingers.

        The reference is what a camera sees of the tags, as in the thesis.

        Raises:
            ValueError: A finger has no planar sensors, or no tags at their ends.
        """
        fibres, tags = columns(gripper)
        light = readings[..., fibres] / readings[:1, ..., fibres]
        turns = np.stack([readings[..., own].sum(axis=-1) for own in tags], axis=-1)
        return cls(gripper, Calibration.fitted(light, turns, order))

    def curvature(self, readings: np.ndarray, straight: np.ndarray) -> np.ndarray:
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


def columns(gripper: Gripper) -> tuple[np.ndarray, list[np.ndarray]]:
    """Where in readings of all fingers the planar sensors stand, and the tags along each.

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


def _along(finger: str, sensor: Sensor, seen: dict[int, tuple[float, float]]) -> np.ndarray:
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


def calibration_grip(period: float) -> np.ndarray:
    """Tensions (steps,) [N] of a grip: closing beyond what encloses, and opening."""
    closing, opening = (np.linspace(0, 1, 1 + round(t / period))[1:] for t in (_CLOSING, _OPENING))
    rise = (1 - np.cos(np.pi * closing)) / 2
    fall = (1 + np.cos(np.pi * opening)) / 2
    return TENSION * np.concatenate([rise, fall])


def calibrated(env: Any, specimens: dict[str, Any], seed: int) -> FingerCalibration:
    """Calibrate the fingers of environments whose bar is clamped (`VectorGripperEnv`).

    Args:
        env: The environments; they observe `sensors`.
        specimens: What the fingers are, options of a reset.
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
