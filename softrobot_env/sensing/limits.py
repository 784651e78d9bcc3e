"""Bounds of what sensors read, without what computes it."""

from collections.abc import Sequence

import numpy as np

from softrobot_env.robots.sensors import Sensor
from softrobot_env.sensing.optics import SATURATED, STRAIGHT

#: Largest turn [rad] between two tags.
MOST_TURN = 4 * np.pi


def readings(sensors: Sequence[Sensor]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest readings (k,) of a robot's sensors, see `robots.sensors.Sensor`."""
    tags = np.array([s.kind == "tags" for s in sensors for _ in range(s.size)])
    most = [SATURATED.get(s.kind, 1.0) / STRAIGHT.get(s.kind, 1.0) for s in sensors]
    most = np.repeat(most, [s.size for s in sensors])
    return np.where(tags, -MOST_TURN, 0.0), np.where(tags, MOST_TURN, most * (1 + 1e-9))
