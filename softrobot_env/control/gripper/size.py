"""The diameter of an unknown bar from the curvatures of fingers that enclose it."""

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from softrobot_env.robots.gripper import Gripper

#: Order of the polynomial, and the curvature [1/m] and diameter [m] that make its variables 1.
_ORDER, _BEND, _SIZE = 3, 30.0, 0.05


def mean_bends(gripper: Gripper, curvature: np.ndarray) -> np.ndarray:
    """Means over the fingers (..., pieces) [1/m], of curvatures (..., all pieces) of like fingers.

    Raises:
        ValueError: The fingers have different numbers of pieces.
    """
    pieces = {finger.robot.pieces for finger in gripper.fingers}
    if len(pieces) > 1:
        raise ValueError(f"gripper {gripper.name!r}: need fingers of as many pieces each")
    shape = (*np.shape(curvature)[:-1], len(gripper.fingers), pieces.pop())
    return np.reshape(curvature, shape).mean(axis=-2)


def size_by_sensor(gripper: Gripper, curvature: np.ndarray, piece: int = 1) -> np.ndarray:
    """Diameters (...) [m] of bars on which a piece of each finger lies altogether.

    Its curvature is then 1 / (d / 2 + the distance of the fibre from the surface).
    """
    width = gripper.fingers[0].robot.backbone.widest
    return 2 / mean_bends(gripper, curvature)[..., piece] - 2 * float(width)


@dataclass(frozen=True)
class SizeEstimator:
    """A polynomial in the mean curvatures of the fingers' pieces.

    Where a finger is straight, near its clamp, tells of the size as well as how it bends further
    out, and both hardly depend on how stiff it is.

    Attributes:
        gripper: The gripper.
        tension: [N], with which the fingers have to close.
        weights: (terms,) [1].
    """

    gripper: Gripper
    tension: float
    weights: np.ndarray

    def __call__(self, curvature: np.ndarray) -> np.ndarray:
        """Diameters (...) [m] from curvatures (..., all pieces) [1/m]."""
        return _SIZE * (_terms(mean_bends(self.gripper, curvature)) @ self.weights)

    @classmethod
    def fitted(
        cls, gripper: Gripper, tension: float, curvature: np.ndarray, diameter: np.ndarray
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


def _terms(bends: np.ndarray) -> np.ndarray:
    """Monomials (..., terms) up to the order, of curvatures (..., pieces) [1/m]."""
    x = bends / _BEND
    columns = [np.ones(x.shape[:-1])]
    for order in range(1, _ORDER + 1):
        for chosen in combinations_with_replacement(range(x.shape[-1]), order):
            columns.append(np.prod(x[..., list(chosen)], axis=-1))
    return np.stack(columns, axis=-1)
