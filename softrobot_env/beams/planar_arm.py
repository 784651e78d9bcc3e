"""Planar piecewise-constant-curvature arm in closed form: the thesis' test system (6.4).

The same equations of motion as `pcc.PCC(robot, axes="planar")` with tendons in channels and
without gravity, written out for the plane, which makes them several times cheaper: controllers
evaluate them in every step. Kernels take real or complex states, so that complex steps
differentiate them.

With the position of a section as a complex number w = z + i x and the angle a_i = l beta_i of
piece i, the end of piece j lies at w_j = sum_(i<=j) l exp(i theta_i) E(a_i), where
E(a) = (exp(i a) - 1) / (i a) and theta_i is the angle at the start of piece i. Hence
dw_j / da_k = d_k + i (w_j - w_k) for k <= j, with d_k = l exp(i theta_k) E'(a_k).
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, reference, structure
from softrobot_env.robots import RobotParams

from .constant_curvature import channel_pairs

#: Angle [rad] below which E is summed as a series, to full precision.
_SMALL = 0.3
_STEP = 1e-30  # imaginary: its square vanishes beside one


@structure
class PlanarArm(NamedTuple):
    """Data of the kernels; coordinates are the curvatures (n,) [1/m] of the pieces.

    Attributes:
        n: Number of pieces.
        length: [m] of a piece.
        stiffness: [N m3], l EI: force on a curvature per curvature.
        damping_time: mu [s].
        mass, inertia: (n,) [kg, kg m2] of the discs at the ends of the pieces.
        inputs: B (n, n_inputs) [m2], force on a curvature per reduced input [N].
    """

    n: int
    length: float
    stiffness: float
    damping_time: float
    mass: ndarray
    inertia: ndarray
    inputs: ndarray


def make_planar_arm(robot: RobotParams) -> PlanarArm:
    """Data of a robot with its own number of pieces, discs by the trapezoidal rule.

    Raises:
        ValueError: The robot has gravity or guides, or tendons ending inside a piece.
    """
    n, length = robot.pieces, robot.length / robot.pieces
    share = np.ones(n)
    share[-1] = 0.5
    return reference(
        PlanarArm(
            n=n,
            length=length,
            stiffness=length * robot.bending_stiffness,
            damping_time=float(robot.damping_time),
            mass=share * length * robot.mass_per_length,
            inertia=share * length * robot.density * robot.second_moment,
            inputs=_inputs(robot, n, length),
        )
    )


def _inputs(robot: RobotParams, n: int, length: float) -> ndarray:
    """B (n, n_inputs): a pair bends the pieces up to its end with its moment arm."""
    _, pairs = channel_pairs(robot, "a planar arm in closed form")
    out = np.zeros((n, len(pairs)))
    for j, tendon in enumerate(pairs):
        reached = tendon.end / length
        if abs(reached - round(reached)) > 1e-9:
            raise ValueError(
                f"robot {robot.name!r}: tendon {tendon.name!r} ends inside a piece, at "
                f"{reached:g} pieces"
            )
        out[: round(reached), j] = length * abs(tendon.offset[0])
    return out


@kernel
def _turned(a):
    """E, E' and E'' at an angle, each as (imaginary, real) part along (x, z)."""
    if abs(a.real) < _SMALL:
        s = a * a
        x = a / 2 * (1 - s / 12 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90))))
        z = 1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72)))
        dx = 0.5 * (1 - s / 4 * (1 - s / 18 * (1 - s / 40 * (1 - s / 70))))
        dz = -a / 3 * (1 - s / 10 * (1 - s / 28 * (1 - s / 54)))
        ddx = -a / 4 * (1 - s / 9 * (1 - 3 * s / 80 * (1 - 2 * s / 105)))
        ddz = -1 / 3 * (1 - 3 * s / 10 * (1 - 5 * s / 84 * (1 - 7 * s / 270)))
        return x, z, dx, dz, ddx, ddz
    sine, cosine = np.sin(a), np.cos(a)
    x, z = (1 - cosine) / a, sine / a
    dx, dz = (sine - x) / a, (cosine - z) / a
    return x, z, dx, dz, (cosine - 2 * dx) / a, (-sine - 2 * dz) / a


@kernel
def _ends(arm, q, x, z, own_x, own_z):
    """Set ends x, z (n,) [m] of the pieces, and derivatives (n,) of each by its own curvature."""
    length = arm.length
    angle, here_x, here_z = 0 * q[0], 0 * q[0], 0 * q[0]
    for i in range(arm.n):
        ex, ez, dx, dz, _, _ = _turned(length * q[i])
        s, c = np.sin(angle), np.cos(angle)
        here_x, here_z = here_x + length * (s * ez + c * ex), here_z + length * (c * ez - s * ex)
        x[i], z[i] = here_x, here_z
        own_x[i] = length * length * (s * dz + c * dx)
        own_z[i] = length * length * (c * dz - s * dx)
        angle = angle + length * q[i]


@kernel
def _swing(arm, q, v):
    """Of the ends of the pieces, derivatives jx, jz (n, n) by q and accelerations ax, az (n,).

    The latter at constant rates v (n,).
    """
    length = arm.length
    x, z, own_x, own_z = np.empty((4, arm.n), q.dtype)
    turn_x, turn_z, speed_x, speed_z, ax, az = np.zeros((6, arm.n), q.dtype)
    jx, jz = np.zeros((2, arm.n, arm.n), q.dtype)
    _ends(arm, q, x, z, own_x, own_z)
    angle, rate = 0 * q[0], 0 * q[0]
    for i in range(arm.n):
        for k in range(i + 1):
            jx[i, k] = own_x[k] + length * (z[i] - z[k])
            jz[i, k] = own_z[k] - length * (x[i] - x[k])
            speed_x[i] += jx[i, k] * v[k]
            speed_z[i] += jz[i, k] * v[k]
        _, _, _, _, ddx, ddz = _turned(length * q[i])
        s, c = np.sin(angle), np.cos(angle)
        turning = length * v[i]
        turn_x[i] = rate * jz[i, i] + length * length * (s * ddz + c * ddx) * turning
        turn_z[i] = -rate * jx[i, i] + length * length * (c * ddz - s * ddx) * turning
        angle, rate = angle + length * q[i], rate + turning
    for i in range(arm.n):
        for k in range(i + 1):
            ax[i] += (turn_x[k] + length * (speed_z[i] - speed_z[k])) * v[k]
            az[i] += (turn_z[k] - length * (speed_x[i] - speed_x[k])) * v[k]
    return jx, jz, ax, az


@kernel
def residual(arm, q, v, a, u, out):
    """Set out (n,) to M a + k + K (q + mu v) - B u, at rates and accelerations v, a (n,)."""
    n, length = arm.n, arm.length
    jx, jz, ax, az = _swing(arm, q, v)
    for i in range(n):
        out[i] = arm.stiffness * (q[i] + arm.damping_time * v[i])
        for j in range(len(u)):
            out[i] -= arm.inputs[i, j] * u[j]
    turning = 0 * q[0]
    for i in range(n):
        turning = turning + length * a[i]
        for k in range(i + 1):
            ax[i] += jx[i, k] * a[k]
            az[i] += jz[i, k] * a[k]
        for k in range(i + 1):
            out[k] += arm.mass[i] * (jx[i, k] * ax[i] + jz[i, k] * az[i])
            out[k] += arm.inertia[i] * length * turning


@kernel
def inertia_forces(arm, q, v, mass, gyroscopic):
    """Set the mass matrix M (n, n) and the forces k (n,) quadratic in the rates v (n,)."""
    n, length = arm.n, arm.length
    jx, jz, ax, az = _swing(arm, q, v)
    mass[:], gyroscopic[:] = 0, 0
    for i in range(n):
        for k in range(i + 1):
            gyroscopic[k] += arm.mass[i] * (jx[i, k] * ax[i] + jz[i, k] * az[i])
            for m in range(k + 1):
                mass[k, m] += arm.mass[i] * (jx[i, k] * jx[i, m] + jz[i, k] * jz[i, m])
                mass[k, m] += arm.inertia[i] * length * length
    for k in range(n):
        for m in range(k):
            mass[m, k] = mass[k, m]


@kernel
def tip(arm, q, point, jacobian):
    """Set the tip (x, z) (2,) [m] and its derivative (2, n) [m2] by the curvatures q (n,)."""
    x, z = np.empty((2, arm.n), q.dtype)
    _ends(arm, q, x, z, jacobian[0], jacobian[1])
    point[0], point[1] = x[-1], z[-1]
    for i in range(arm.n):
        jacobian[0, i] += arm.length * (point[1] - z[i])
        jacobian[1, i] -= arm.length * (point[0] - x[i])


@kernel
def derivatives(arm, q, v, a, u, by_q, by_v):
    """Set the derivatives (n, n) of the residual by q and by v; that by a is the mass matrix."""
    out = np.empty(arm.n, np.complex128)
    q1, v1 = q.astype(np.complex128), v.astype(np.complex128)
    a1, u1 = a.astype(np.complex128), u.astype(np.complex128)
    for moved, slopes in ((q1, by_q), (v1, by_v)):
        for j in range(arm.n):
            moved[j] += _STEP * 1j
            residual(arm, q1, v1, a1, u1, out)
            for i in range(arm.n):
                slopes[i, j] = out[i].imag / _STEP
            moved[j] = moved[j].real
