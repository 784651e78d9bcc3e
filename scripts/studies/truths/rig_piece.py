"""All that the closed form of the rig in one piece tells, beside what its control needs of it.

Notation and equations as in `thesis.rig.spatial_piece`.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.robots import RobotParams
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.rig.spatial_piece import (
    RigPiece,
    add_dynamic,
    add_static,
    inertia_functions,
    make_rig_piece,
    place,
)

_GAUSS_POINTS = 4


def distributed(robot: RobotParams) -> RigPiece:
    """Data of a robot whose mass is in the uniform backbone, by Gauss quadrature, and the head."""
    place, weight = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    bodies = np.zeros((_GAUSS_POINTS + 1, 5))
    bodies[:-1, 0] = (place + 1) / 2
    turning = robot.density * robot.second_moment
    per_length = np.array([robot.mass_per_length, turning, 2 * turning])
    bodies[:-1, 2:] = np.outer(weight / 2 * robot.length, per_length)
    head = robot.head
    bodies[-1] = (1.0, head.centre, head.mass, *head.inertia[1:])
    return make_rig_piece(robot)._replace(bodies=bodies)


class Inverse(NamedTuple):
    """Motion and inputs that put the output on references.

    Attributes:
        y, v, a: (n, 2) [rad, rad/s, rad/s2], coordinates of `RigPiece` and their derivatives.
        reduced: (n, 2) [N], F_red of `ThreeTendons`; the effective tendon force (5.42).
        static: (n, 2) [N], its part that holds y at rest: elastic and gravity.
        tension: (n, 3) [N], least tensions that respect the pretension; the drive's limit does
            not enter.
        pulled: (n, 3) [m], lengths pulled in, s.
        dynamic: (n, 3) [m], its part s_dyn = C^-1 (F(reduced) - F(static)) of (5.36), which a
            quasi-static controller lacks.
    """

    y: ndarray
    v: ndarray
    a: ndarray
    reduced: ndarray
    static: ndarray
    tension: ndarray
    pulled: ndarray
    dynamic: ndarray


def plan(servo: ServoConstraints, *references: ndarray) -> Inverse:
    """The inverse along positions, velocities and accelerations (n, 2) or (n, 3) of the output.

    Errors are those of `ServoConstraints.motion`.
    """
    motion = servo.motion(*(np.ascontiguousarray(x, float) for x in references))
    y, _, _, reduced, static = motion
    tension = servo.tendons.tension(reduced)
    pulled = servo.tendons.pulled(tension, servo.curvature(y))
    dynamic = (tension - servo.tendons.tension(static)) / servo.tendons.stiffness
    return Inverse(*motion, tension, pulled, dynamic)


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
