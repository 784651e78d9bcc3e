"""Where to draw a reference of the test rig, which has no height."""

import numpy as np

from softrobot_env.robots import RobotParams

_ANGLES = np.linspace(0.0, 2.2, 200)  # rad; the farthest tip is at about 2 rad


def lifted(robot: RobotParams, points: np.ndarray) -> np.ndarray:
    """Points (k, 3) [m] above x and y (k, 2) [m], where the tip of a circular arc would be.

    Beyond the reach of an arc the height of the farthest one is taken.
    """
    head = robot.reach - robot.length
    half = np.sinc(_ANGLES / (2 * np.pi))  # sin(a / 2) / (a / 2)
    chord = robot.length * half
    distance = chord * np.sin(_ANGLES / 2) + head * np.sin(_ANGLES)
    height = chord * np.cos(_ANGLES / 2) + head * np.cos(_ANGLES)
    rising = slice(0, int(np.argmax(distance)) + 1)
    z = np.interp(np.hypot(*points.T), distance[rising], height[rising])
    return np.column_stack((points, z))
