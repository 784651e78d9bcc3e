"""Where the output point of the one-piece rig is, and the motion that puts it on a target.

Beside the axis the output is z = P(t) d with d = (nu, -mu), t = y . y and P = L c_2 + h c_1 (the
function G of `rig_piece` at the end). Its distance from the axis grows with the bending angle up
to `reach`; within, z and y determine each other (N = 1 is flat, thesis sec. 5.2.3).
"""

import numpy as np

from softrobot_env.beams.closed_forms.spatial_piece import RigPiece, place
from softrobot_env.beams.numerics.compilation import kernel

_ITERATIONS = 60  # Newton takes up to seven between 1 and 140 mm; bisection is the safeguard
_CONVERGED = 1e-15


@kernel
def output(piece, y, point, jacobian):
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
def output_bias(piece, y, v, out):
    """Set out (3,) [m/s2] to the acceleration of the output at constant rates v (2,)."""
    t, p = y[0] * y[0] + y[1] * y[1], y[0] * v[0] + y[1] * v[1]
    square = v[0] * v[0] + v[1] * v[1]
    _, dg, ddg, _, dh, ddh = place(piece.length, piece.height, 1.0, t)
    along = 2 * dg * square + 4 * ddg * p * p
    out[0] = 4 * dg * p * v[1] + along * y[1]
    out[1] = -4 * dg * p * v[0] - along * y[0]
    out[2] = 2 * dh * square + 4 * ddh * p * p


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
