"""The spatial test rig as one piece of constant curvature, in closed form (thesis sec. 5.2.1).

The same equations of motion as `pcc.PCC(robot, pieces=1, axes="spatial", inertia=bodies)` with
tendons in channels, written out, with what PCC does not have: bodies on the head, beyond the end
of the backbone. (5.5) to (5.18) with the audit's corrections.

Coordinates y = (mu, nu) [rad] are the components of the rotation vector from base to end, (5.2).
In PCC's curvatures, beta towards +x and gamma towards +y, mu = -L gamma and nu = L beta. The rig
bends towards d = (nu, -mu) by the angle theta = |y|. With the Stumpff functions c_k of
(u theta)^2, a body at the fraction u of the backbone, or a height h above it on the end's tangent,
is at G d beside the axis and at the height H,

    G = L u^2 c_2 + h u c_1,    H = L u c_1 + h c_0.

Its energy depends on y only through t = y . y, as the rig is symmetric about its axis: with
p = y . v, kinetic energy = (C(t) v . v + E(t) p^2) / 2. Hence the mass matrix is C 1 + E y y^T and
Lagrange's equations have the forces k = 2 p C' v + ((E - C') v . v + E' p^2) y. C and E are entire
functions of t, so nothing is singular in the straight pose.

The output point is the one at the end (u = 1) and its height. Its distance from the axis grows with
the bending angle up to `reach`; within, the place z beside the axis and y determine each other
(N = 1 is flat, thesis sec. 5.2.3).
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams.pcc.constant_strain import stumpff
from softrobot_env.beams.pcc.model import Station, check_stations
from softrobot_env.compile.kernels import kernel, reference, structure
from softrobot_env.robots import RobotParams

from .three_tendons import ThreeTendons, head_of

#: The three subpieces of Tab. 5.1, the last with the cube (audit: moments in 1e-6 kg m2).
SUBPIECES: tuple[Station, ...] = (
    (0.032, 0.04, (13.96e-6, 13.96e-6, 3.99e-6)),
    (0.092, 0.04, (13.96e-6, 13.96e-6, 3.99e-6)),
    (0.1786, 0.095, (70.04e-6, 70.04e-6, 9.88e-6)),
)

_ITERATIONS = 60  # Newton takes up to seven between 1 and 140 mm; bisection is the safeguard
_CONVERGED = 1e-15


@structure
class RigPiece(NamedTuple):
    """Data of the kernels.

    Attributes:
        length: [m] of the backbone.
        height: [m] of the output point above its end.
        stiffness: EI / L [N m].
        damping: c_theta [N m s].
        gravity: (3,) [m/s2].
        bodies: (k, 5) fraction u, height h [m], mass [kg], moments of inertia [kg m2] across and
            along.
        inputs: B (2, 3) [m], force on the coordinates per tension.
    """

    length: float
    height: float
    stiffness: float
    damping: float
    gravity: ndarray
    bodies: ndarray
    inputs: ndarray


def make_rig_piece(robot: RobotParams) -> RigPiece:
    """Data of a robot, as a reference for kernels; friction of its tendons is ignored.

    `SUBPIECES` hold all its mass.

    Args:
        robot: A robot with three tendons in channels and a head; its number of pieces is ignored.

    Raises:
        ValueError: Other tendons, no head, anisotropy or precurvature, or a backbone that is too
            short.
    """
    head = head_of(robot)
    check_stations(robot, SUBPIECES)
    if not robot.is_symmetric:
        raise ValueError(
            f"robot {robot.name!r}: the closed form needs a robot without anisotropy and "
            "precurvature"
        )
    tendons = ThreeTendons(robot)
    towards_x, towards_y = tendons.arc.T / robot.length
    bodies = [(s / robot.length, 0.0, m, *moments[1:]) for s, m, moments in SUBPIECES]
    return reference(
        RigPiece(
            length=robot.length,
            height=head.output,
            stiffness=robot.bending_stiffness / robot.length,
            damping=robot.damping_time * robot.bending_stiffness / robot.length,
            gravity=np.array(robot.gravity, float),
            bodies=np.array(bodies),
            inputs=np.stack([-towards_y, towards_x]),
        )
    )


@kernel
def place(length, height, u, t):
    """G, H of the module's text and their first and second derivatives by t."""
    w = u * u
    c0, c1, c2, c3, c4, c5, c6, _ = stumpff(w * t)
    # Derivatives by the argument of the Stumpff functions: c_k' = (k c_(k+2) - c_(k+1)) / 2.
    d1, d2 = 0.5 * (c3 - c2), 0.5 * (2 * c4 - c3)
    dd1, dd2 = 0.25 * (3 * c5 - 3 * c4 + c3), 0.25 * (8 * c6 - 5 * c5 + c4)
    lu, hu = length * u, height * u
    return (
        lu * u * c2 + hu * c1,
        w * (lu * u * d2 + hu * d1),
        w * w * (lu * u * dd2 + hu * dd1),
        lu * c1 + height * c0,
        w * (lu * d1 - 0.5 * height * c1),
        w * w * (lu * dd1 - 0.5 * height * d1),
    )


@kernel
def inertia_functions(piece, t):
    """C, C', E, E' of the module's text at t, [kg m2]."""
    c, dc, e, de = 0 * t, 0 * t, 0 * t, 0 * t
    for k in range(len(piece.bodies)):
        u, height, mass, across, along = piece.bodies[k]
        g, dg, ddg, _, dh, ddh = place(piece.length, height, u, t)
        c += mass * g * g
        dc += 2 * mass * g * dg
        e += 4 * mass * (g * dg + t * dg * dg + dh * dh)
        de += 4 * mass * (2 * dg * dg + g * ddg + 2 * t * dg * ddg + 2 * dh * ddh)
        # Turning: u^2 (across c_1^2 + along t c_2^2 u^2) and what bends less what it costs.
        w = u * u
        _, c1, c2, c3, c4, c5, _, _ = stumpff(w * t)
        d1, d2, d3 = 0.5 * (c3 - c2), 0.5 * (2 * c4 - c3), 0.5 * (3 * c5 - c4)
        c += w * (across * c1 * c1 + along * w * t * c2 * c2)
        dc += w * w * (2 * across * c1 * d1 + along * (c2 * c2 + 2 * w * t * c2 * d2))
        e += w * w * (across * c3 * (1 + c1) - along * c2 * c2)
        de += w * w * w * (across * (d3 * (1 + c1) + c3 * d1) - 2 * along * c2 * d2)
    return c, dc, e, de


@kernel
def add_weight(piece, y, sign, out):
    """Add sign times gravity's force [N m] on the coordinates to out (2,)."""
    t = y[0] * y[0] + y[1] * y[1]
    side, dside, drise = 0 * t, 0 * t, 0 * t
    for k in range(len(piece.bodies)):
        u, height, mass = piece.bodies[k, 0], piece.bodies[k, 1], piece.bodies[k, 2]
        g, dg, _, _, dh, _ = place(piece.length, height, u, t)
        side, dside, drise = side + mass * g, dside + mass * dg, drise + mass * dh
    gx, gy, gz = piece.gravity
    along = 2 * (gz * drise + (gx * y[1] - gy * y[0]) * dside)
    out[0] += sign * (along * y[0] - gy * side)
    out[1] += sign * (along * y[1] + gx * side)


@kernel
def add_static(piece, y, out):
    """Add to out (2,) the force [N m] that holds the coordinates y (2,): elastic less gravity."""
    out[0] += piece.stiffness * y[0]
    out[1] += piece.stiffness * y[1]
    add_weight(piece, y, -1.0, out)


@kernel
def add_dynamic(piece, y, v, a, out):
    """Add to out (2,) the force [N m] of inertia and damping, M a + k + c_theta v."""
    c, dc, e, de = inertia_functions(piece, y[0] * y[0] + y[1] * y[1])
    p, square = y[0] * v[0] + y[1] * v[1], v[0] * v[0] + v[1] * v[1]
    outward = e * (y[0] * a[0] + y[1] * a[1]) + (e - dc) * square + de * p * p
    for i in range(2):
        out[i] += c * a[i] + (2 * p * dc + piece.damping) * v[i] + outward * y[i]


# ---------------------------------------------------------------- the output point


@kernel
def _distance(piece, angle):
    """Distance [m] of the output from the axis and its derivative by the bending angle [rad]."""
    t = angle * angle
    g, dg, _, _, _, _ = place(piece.length, piece.height, 1.0, t)
    return angle * g, g + 2 * t * dg


@kernel
def reach(piece: RigPiece) -> tuple[float, float]:
    """Bending angle [rad] at which the output is farthest from the axis, and that distance [m]."""
    low, high = 0.0, np.pi  # the slope falls from L / 2 + h at 0 to below 0 at pi
    for _ in range(_ITERATIONS):
        middle = 0.5 * (low + high)
        if _distance(piece, middle)[1] > 0:
            low = middle
        else:
            high = middle
    return low, _distance(piece, low)[0]


@kernel
def bending_angle(piece, distance, guess, limit):
    """Bending angle [rad] that puts the output at a distance [m] below the reach.

    Args:
        piece: `RigPiece`.
        distance: [m], within the reach.
        guess: [rad], start of Newton's iteration.
        limit: [rad], angle of the reach.
    """
    if distance == 0:
        return 0.0
    low, high = 0.0, limit
    angle = min(max(guess, low), high)
    for _ in range(_ITERATIONS):
        value, slope = _distance(piece, angle)
        if value < distance:
            low = angle
        else:
            high = angle
        step = (distance - value) / slope
        if not low <= angle + step <= high:
            step = 0.5 * (low + high) - angle
        angle += step
        if abs(step) <= _CONVERGED * limit:
            break
    return angle


@kernel
def invert_output(piece, limit, z, dz, ddz, y, v, a):
    """Set the motion that moves the output beside the axis as wanted.

    Args:
        piece: `RigPiece`.
        limit: [rad], angle of the reach.
        z, dz, ddz: (2,) [m, m/s, m/s2], z within the reach.
        y, v, a: (2,), set; y is the start of Newton's iteration.
    """
    distance = np.hypot(z[0], z[1])
    guess = np.hypot(y[0], y[1])
    angle = bending_angle(piece, distance, guess, limit)
    t = angle * angle
    g, dg, ddg, _, _, _ = place(piece.length, piece.height, 1.0, t)
    slope = g + 2 * t * dg
    dx, dy = z[0] / g, z[1] / g
    p = (dx * dz[0] + dy * dz[1]) / slope
    vx, vy = (dz[0] - 2 * dg * p * dx) / g, (dz[1] - 2 * dg * p * dy) / g
    along = 2 * dg * (vx * vx + vy * vy) + 4 * ddg * p * p
    wx = ddz[0] - 4 * dg * p * vx - along * dx
    wy = ddz[1] - 4 * dg * p * vy - along * dy
    q = (dx * wx + dy * wy) / slope
    y[0], y[1] = -dy, dx
    v[0], v[1] = -vy, vx
    a[0], a[1] = -(wy - 2 * dg * q * dy) / g, (wx - 2 * dg * q * dx) / g
