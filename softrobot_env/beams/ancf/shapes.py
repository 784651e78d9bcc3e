"""Shape functions of the ANCF beam, their masses, and where loads and tendons are.

Functions have the slots (2 (d + 1),) of the vectors r, r_,1, r_,2 (, r_,3) of an element's nodes.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams

from .section import legendre

#: World axes of the components.
AXES = {2: (0, 2), 3: (0, 1, 2)}


def straight_vectors(d: int, piece: float, pieces: int) -> ndarray:
    """Nodal vectors (pieces + 1, d + 1, d) of the straight robot: r, r_,1, r_,2 (, r_,3)."""
    out = np.zeros((pieces + 1, d + 1, d))
    out[:, 0, -1] = piece * np.arange(pieces + 1)
    out[:, 1, -1] = 1
    for k in range(d - 1):
        out[:, k + 2, k] = 1
    return out


class Shapes:
    """Shape functions of an element of length `piece` [m] at X1 / piece = xi (k,), (2.57).

    Attributes:
        centre, slope: (k, slots), of the centreline and of its derivative by X1.
        hermite_slope: (k, 4), the slots of `slope` that are not zero.
        gradients, changes: (d - 1, k, slots), of r_,2 (, r_,3) and of their derivatives.
    """

    def __init__(self, xi: ndarray, piece: float, d: int) -> None:
        ends = [0, 1, d + 1, d + 2]
        self.centre, self.slope = np.zeros((2, len(xi), 2 * (d + 1)))
        self.gradients, self.changes = np.zeros((2, d - 1, len(xi), 2 * (d + 1)))
        columns = [1 - 3 * xi**2 + 2 * xi**3, xi - 2 * xi**2 + xi**3, 3 * xi**2 - 2 * xi**3]
        self.centre[:, ends] = np.column_stack([*columns, xi**3 - xi**2]) * [1, piece, 1, piece]
        bump = 6 * (xi - xi**2) / piece
        columns = [-bump, 1 - 4 * xi + 3 * xi**2, bump, 3 * xi**2 - 2 * xi]
        self.hermite_slope = np.column_stack(columns)
        self.slope[:, ends] = self.hermite_slope
        for k in range(d - 1):
            self.gradients[k][:, [k + 2, d + 3 + k]] = np.column_stack([1 - xi, xi])
            self.changes[k][:, [k + 2, d + 3 + k]] = np.array([-1, 1]) / piece

    def points(self, offset: ndarray) -> ndarray:
        """(k, d, slots), of points with offsets (k, 2) [m], and of r_,2 (, r_,3) there."""
        return np.stack([self._beside(self.centre, self.gradients, offset), *self.gradients], 1)

    def tangents(self, offset: ndarray) -> ndarray:
        """(k, slots), of the tangents of channels with offsets (k, 2) [m]."""
        return self._beside(self.slope, self.changes, offset)

    @staticmethod
    def _beside(centre: ndarray, gradients: ndarray, offset: ndarray) -> ndarray:
        across = offset.T[: len(gradients), :, None]
        return centre + (across * gradients).sum(axis=0)


def element_mass(robot: RobotParams, piece: float, d: int) -> ndarray:
    """Mass (2.58) of an element (slots, slots).

    Terms between r and r_,2 vanish with the section's first moments. A planar model has the same
    ones, as its r_,3 is constant.
    """
    xi, weight = legendre(4)  # products of the functions have degree 6
    shapes, rotary = Shapes(xi, piece, d), robot.density * robot.second_moment
    masses = [robot.mass_per_length, *[rotary] * (d - 1)]
    functions = np.stack([shapes.centre, *shapes.gradients])
    return piece * np.einsum("f,k,fki,fkj->ij", masses, weight, functions, functions)


def whole_mass(element: ndarray, d: int, pieces: int) -> ndarray:
    """Mass between the slots of all nodes, assembled from that of an element."""
    size, block = len(element), d + 1
    mass = np.zeros((block * (pieces + 1),) * 2)
    for first in range(0, block * pieces, block):
        mass[first : first + size, first : first + size] += element
    return mass


def mass_factor(mass: ndarray, width: int) -> ndarray:
    """Field of `AncfData` for a mass (m, m) with `width` diagonals from the main one down."""
    lower, width = np.linalg.cholesky(mass), min(width, len(mass))
    out = np.zeros((len(mass), width))
    for k in range(width):
        out[k:, k] = np.diagonal(lower, -k)
    out[:, 0] = 1 / out[:, 0]
    return out
