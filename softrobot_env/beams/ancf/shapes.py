"""Constants of the ANCF beam: shape functions, masses, places of loads and tendons."""

import numpy as np
from numpy import ndarray
from scipy.linalg import cholesky_banded

from softrobot_env.robots import RobotParams

from ..actuation import Actuation
from .section import legendre

#: Integration points of a channel in each element; its length is no polynomial.
_CHANNEL_POINTS = 4
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


def hermite(xi: ndarray, piece: float) -> ndarray:
    """Functions (k, 4) [1, m, 1, m] s_1, s_2, s_5, s_6 of (2.57) at X1 / piece = xi (k,)."""
    columns = [1 - 3 * xi**2 + 2 * xi**3, xi - 2 * xi**2 + xi**3, 3 * xi**2 - 2 * xi**3]
    return np.stack([*columns, xi**3 - xi**2], axis=-1) * [1, piece, 1, piece]


def hermite_slopes(xi: ndarray, piece: float) -> ndarray:
    """Derivatives (..., 4) [1/m, 1, 1/m, 1] of these by X1."""
    bump = 6 * (xi - xi**2) / piece
    return np.stack([-bump, 1 - 4 * xi + 3 * xi**2, bump, 3 * xi**2 - 2 * xi], axis=-1)


def element_mass(robot: RobotParams, piece: float) -> tuple[ndarray, ndarray]:
    """Mass (2.58) of an element for [r, r_,1] at both ends, (4, 4), and for r_,2, (2, 2).

    Terms between them vanish with the section's first moments. A planar model has the same ones,
    as its r_,3 is constant.
    """
    xi, weight = legendre(4)  # products of the functions have degree 6
    bending, linear = hermite(xi, piece), np.stack([1 - xi, xi], axis=1)
    rotary = robot.density * robot.second_moment
    return (
        robot.mass_per_length * piece * np.einsum("k,ki,kj->ij", weight, bending, bending),
        rotary * piece * np.einsum("k,ki,kj->ij", weight, linear, linear),
    )


def mass_factor(element: ndarray, vectors: int, pieces: int, fixed: int) -> ndarray:
    """Cholesky factor for `dynamics._substitute` of the mass assembled from elements."""
    size, m = len(element), vectors * (pieces + 1)
    mass = np.zeros((m, m))
    for first in range(0, vectors * pieces, vectors):
        mass[first : first + size, first : first + size] += element
    mass = mass[vectors * fixed :, vectors * fixed :]
    width = min(size, len(mass))
    band = np.zeros((width, len(mass)))
    for k in range(width):
        band[k, : len(mass) - k] = np.diagonal(mass, -k)
    columns = cholesky_banded(band, lower=True)
    rows = np.zeros((len(mass), width))
    for k in range(width):
        rows[k:, k] = columns[k, : len(mass) - k]
    rows[:, 0] = 1 / rows[:, 0]
    return rows


def gravity_force(robot: RobotParams, bending: ndarray, d: int, pieces: int) -> ndarray:
    """Generalised force (pieces + 1, d + 1, d) of gravity: mass times that acceleration of r."""
    out = np.zeros((pieces + 1, d + 1, d))
    along = np.array(robot.own_gravity)[list(AXES[d])]
    share = bending[:, 0] + bending[:, 2]
    out[:-1, :2] += share[:2, None] * along
    out[1:, :2] += share[2:, None] * along
    return out


def places(station: ndarray, piece: float, pieces: int) -> tuple[ndarray, ndarray]:
    """Element (k,) and X1 / piece (k,) of stations (k,) [m]; nodes are hit exactly."""
    at = station / piece
    at = np.where(np.abs(at - np.round(at)) < 1e-9, np.round(at), at)
    element = np.minimum(at.astype(int), pieces - 1)
    return element, at - element


def point_shapes(position: ndarray, piece: float, offset: ndarray, d: int) -> ndarray:
    """Shape functions (k, 2, d + 1) of [r, r_,1, r_,2 (, r_,3)] at both nodes of points."""
    out = np.empty((len(position), 2, d + 1))
    out[:, :, :2] = hermite(position, piece).reshape(-1, 2, 2)
    out[:, 0, 2:] = (1 - position)[:, None] * offset[:, : d - 1]
    out[:, 1, 2:] = position[:, None] * offset[:, : d - 1]
    return out


def channel_rules(actuation: Actuation, piece: float, pieces: int) -> dict[str, ndarray]:
    """Fields of `AncfData` about the channels."""
    at = actuation.channel_end / piece
    sampled, entered = np.nonzero(np.arange(pieces) < np.maximum(at[:, None] - 1e-9, 1e-9))
    share = np.minimum(at[sampled] - entered, 1)[:, None]  # of an element
    xi, weight = legendre(_CHANNEL_POINTS)
    return {
        "sampled": sampled,
        "entered": entered,
        "channel_weight": piece * share * weight,
        "channel_slope": hermite_slopes(share * xi, piece),
    }
