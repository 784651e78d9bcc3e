"""Poses of pieces of constant strain, by matrix exponentials."""

import numpy as np
from numpy import ndarray
from scipy.linalg import expm


def pose(curvature: ndarray, edges: ndarray, s: float) -> ndarray:
    """Pose (4, 4) of the section at arc length s: product of exponentials of constant twists.

    Args:
        curvature: (k, 3) [1/m] of each piece, in its own axes; complex for complex steps.
        edges: (k + 1,) [m], ends of the pieces.
        s: [m].
    """
    out = np.eye(4)
    for (x, y, z), low, high in zip(curvature, edges[:-1], edges[1:], strict=True):
        twist = np.array([[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 1], [0, 0, 0, 0]])
        out = out @ expm((np.clip(s, low, high) - low) * twist)
    return out
