"""Bending stiffness of a rig and turn of its tendons, fitted to its quasi-static recording."""

import numpy as np
from scipy.optimize import least_squares

from softrobot_env.control.rig.identified import turned
from softrobot_env.control.rig.inverse import PIECES, TOTAL
from softrobot_env.control.rig.servo_flexible import FlexibleServoConstraints
from softrobot_env.robots import EQUIVALENT, RobotParams
from softrobot_env.robots.three_tendons import mean_curvature

#: Rings [m] in which points are followed one after the other.
_RING = 0.01
_STEP = 1e-4
_SCALE = 1e-3  # m, of the residuals


def calibrate(robot: RobotParams, lengths: np.ndarray, outputs: np.ndarray) -> tuple[float, float]:
    """Stiffness [1] and turn [rad] of the rig in several pieces that fit data best.

    Least squares of the lengths, but for a constant of each tendon: pretension and the zero of a
    servo are not asked for.

    Args:
        robot: The nominal rig.
        lengths: s (n, 3) [m], with a constant sum of tensions.
        outputs: z (n, 2) [m], measured.

    Raises:
        ValueError: Data of other shapes, or fewer than three.
        InversionError: The model does not reach an output.
    """
    if len(lengths) < 3 or lengths.shape[1:] != (3,) or outputs.shape != (len(lengths), 2):
        raise ValueError(
            f"need three lengths (n, 3) or more and outputs (n, 2), got {lengths.shape} and "
            f"{outputs.shape}"
        )
    order = _one_by_one(outputs)
    lengths, outputs = lengths[order], outputs[order]

    def missing(parameters: np.ndarray) -> np.ndarray:
        model = FlexibleServoConstraints(turned(robot, *parameters), PIECES)
        q, reduced = model.hold(outputs)
        tension = model.tendons.with_total(reduced, TOTAL)
        off = model.tendons.pulled(tension, mean_curvature(q)) - lengths
        return (off - off.mean(axis=0)).ravel() / _SCALE

    found = least_squares(missing, (EQUIVALENT, 0.0), diff_step=_STEP)
    return float(found.x[0]), float(found.x[1])


def _one_by_one(points: np.ndarray) -> np.ndarray:
    """Indices of points (n, 2) [m], ring by ring, each next to the one before."""
    ring = np.round(np.hypot(*points.T) / _RING)
    return np.lexsort((np.arctan2(points[:, 1], points[:, 0]), ring))
