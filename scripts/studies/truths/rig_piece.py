"""All that the closed form of the rig in one piece tells, beside what its control needs of it.

Notation and equations as in `thesis.rig.spatial_piece`.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.thesis.rig.spatial_piece import (
    RigPiece,
    add_dynamic,
    add_static,
    inertia_functions,
    place,
)


@kernel
def residual(
    piece: RigPiece, y: ndarray, v: ndarray, a: ndarray, tension: ndarray, out: ndarray
) -> None:
    """Set out (2,) [N m] to M a + k - q - B F, zero on every motion, (5.18).

    Args:
        piece: `RigPiece`.
        y, v, a: (2,) [rad, rad/s, rad/s2].
        tension: F (3,) [N].
        out: Set.
    """
    for i in range(2):
        out[i] = 0 * y[0]
        for k in range(len(tension)):
            out[i] -= piece.inputs[i, k] * tension[k]
    add_static(piece, y, out)
    add_dynamic(piece, y, v, a, out)


@kernel
def acceleration(piece: RigPiece, y: ndarray, v: ndarray, tension: ndarray, out: ndarray) -> None:
    """Set out (2,) [rad/s2] to the acceleration in state y, v under tensions (3,) [N]."""
    zero = np.zeros(2, y.dtype)
    force = np.empty(2, y.dtype)
    residual(piece, y, v, zero, tension, force)
    # (C 1 + E y y^T)^-1 = (1 - E y y^T / (C + E t)) / C
    t = y[0] * y[0] + y[1] * y[1]
    c, _, e, _ = inertia_functions(piece, t)
    share = e * (y[0] * force[0] + y[1] * force[1]) / (c + e * t)
    for i in range(2):
        out[i] = (share * y[i] - force[i]) / c


@kernel
def energies(piece: RigPiece, y: ndarray, v: ndarray) -> tuple[float, float]:
    """Kinetic and potential energy [J]; the latter is zero in the straight pose."""
    t = y[0] * y[0] + y[1] * y[1]
    c, _, e, _ = inertia_functions(piece, t)
    p, square = y[0] * v[0] + y[1] * v[1], v[0] * v[0] + v[1] * v[1]
    potential = 0.5 * piece.stiffness * t
    gx, gy, gz = piece.gravity
    for k in range(len(piece.bodies)):
        u, height, mass = piece.bodies[k, 0], piece.bodies[k, 1], piece.bodies[k, 2]
        g, _, _, h, _, _ = place(piece.length, height, u, t)
        rise = h - piece.length * u - height
        potential -= mass * (g * (gx * y[1] - gy * y[0]) + gz * rise)
    return 0.5 * (c * square + e * p * p), potential


@kernel
def output(piece: RigPiece, y: ndarray, point: ndarray, jacobian: ndarray) -> None:
    """Set the output point (3,) [m] and its derivative (3, 2) [m/rad] at y (2,)."""
    g, dg, _, h, dh, _ = place(piece.length, piece.height, 1.0, y[0] * y[0] + y[1] * y[1])
    point[0], point[1], point[2] = g * y[1], -g * y[0], h
    for i in range(2):
        jacobian[0, i] = 2 * dg * y[1] * y[i]
        jacobian[1, i] = -2 * dg * y[0] * y[i]
        jacobian[2, i] = 2 * dh * y[i]
    jacobian[0, 1] += g
    jacobian[1, 0] -= g


@kernel
def output_bias(piece: RigPiece, y: ndarray, v: ndarray, out: ndarray) -> None:
    """Set out (3,) [m/s2] to the acceleration of the output at constant rates v (2,)."""
    t, p = y[0] * y[0] + y[1] * y[1], y[0] * v[0] + y[1] * v[1]
    square = v[0] * v[0] + v[1] * v[1]
    _, dg, ddg, _, dh, ddh = place(piece.length, piece.height, 1.0, t)
    along = 2 * dg * square + 4 * ddg * p * p
    out[0] = 4 * dg * p * v[1] + along * y[1]
    out[1] = -4 * dg * p * v[0] - along * y[0]
    out[2] = 2 * dh * square + 4 * ddh * p * p
