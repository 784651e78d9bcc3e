"""Kinematics of a rod piece of constant bending and torsion, in kernels.

A piece of length l with strain (kx, ky, tau) [1/m] in its section frame turns by the rotation
vector phi = l (kx, ky, tau) from its start to its end. With [phi] the matrix of the cross product
phi x, the end has, in the frame of the start,

    rotation E = exp([phi]) = c0 1 + c1 [phi] + c2 phi phi^T,
    position p = l J e_z,   J = c1 1 + c2 [phi] + c3 phi phi^T (left Jacobian of the rotations),

where c_k are the Stumpff functions of x = phi . phi (Stiefel and Scheifele, Linear and Regular
Celestial Mechanics). They are entire functions of x, hence nothing is singular in the straight
piece, and their derivatives are again Stumpff functions. Without torsion this is (2.4) to (2.8) of
the thesis; with torsion the piece is the exact helix, which (2.8) approximates. A section at the
fraction u of a piece is the end of a piece of length u l and rotation vector u phi.

Vectors are tuples of three numbers, real or complex.
"""

import numpy as np

from softrobot_env.compile.kernels import kernel

from ..numerics.quaternions import add, cross, dot3, mix, scaled

#: Rotation angle squared up to which the power series are summed.
_SERIES_LIMIT = 4.0


@kernel
def stumpff(x):
    """Stumpff functions c_0 to c_7 at x: c_k = sum over j of (-x)^j / (2 j + k)!.

    c_0(t^2) = cos t, c_1 = sin t / t, c_2 = (1 - cos t) / t^2, c_3 = (t - sin t) / t^3, and
    c_k = 1 / k! - x c_{k+2}. The last two are summed where x is small and follow from the first
    two elsewhere: the recurrence is used in the direction in which rounding errors shrink.
    """
    if x.real < _SERIES_LIMIT:
        c6, c7 = _series(x)
        c5 = 1 / 120 - x * c7
        c4 = 1 / 24 - x * c6
        c3 = 1 / 6 - x * c5
        c2 = 0.5 - x * c4
        return 1.0 - x * c2, 1.0 - x * c3, c2, c3, c4, c5, c6, c7
    t = np.sqrt(x)
    c0, c1 = np.cos(t), np.sin(t) / t
    c2, c3 = (1.0 - c0) / x, (1.0 - c1) / x
    c4, c5 = (0.5 - c2) / x, (1 / 6 - c3) / x
    return c0, c1, c2, c3, c4, c5, (1 / 24 - c4) / x, (1 / 120 - c5) / x


@kernel
def _series(x):
    """Sums of the series of c_6 and c_7; the terms left out are below 1e-16 of the first."""
    even, odd = 1.0 - x * (1 / 552), 1.0 - x * (1 / 600)
    even, odd = 1.0 - x * (1 / 462) * even, 1.0 - x * (1 / 506) * odd
    even, odd = 1.0 - x * (1 / 380) * even, 1.0 - x * (1 / 420) * odd
    even, odd = 1.0 - x * (1 / 306) * even, 1.0 - x * (1 / 342) * odd
    even, odd = 1.0 - x * (1 / 240) * even, 1.0 - x * (1 / 272) * odd
    even, odd = 1.0 - x * (1 / 182) * even, 1.0 - x * (1 / 210) * odd
    even, odd = 1.0 - x * (1 / 132) * even, 1.0 - x * (1 / 156) * odd
    even, odd = 1.0 - x * (1 / 90) * even, 1.0 - x * (1 / 110) * odd
    even, odd = 1.0 - x * (1 / 56) * even, 1.0 - x * (1 / 72) * odd
    return even * (1 / 720), odd * (1 / 5040)


@kernel
def blend(c0, c1, c2, phi, a):
    """Product of c0 1 + c1 [phi] + c2 phi phi^T with a vector."""
    return add(mix(c0, a, c1, cross(phi, a)), scaled(c2 * dot3(phi, a), phi))


@kernel
def turn(c, phi, a):
    """The vector E a: from the end's frame into the start's, given c = stumpff(phi . phi)."""
    return blend(c[0], c[1], c[2], phi, a)


@kernel
def turn_back(c, phi, a):
    """The vector E^T a: from the start's frame into the end's."""
    return blend(c[0], -c[1], c[2], phi, a)


@kernel
def position(length, c, phi):
    """Position p [m] of the end in the frame of the start."""
    x, y, z = phi
    k = c[3] * z
    return (length * (c[2] * y + k * x), length * (k * y - c[2] * x), length * (c[1] + k * z))


@kernel
def _slopes(c):
    """Derivatives of c_1, c_2, c_3 by x, from d c_k / dx = (k c_{k+2} - c_{k+1}) / 2."""
    return 0.5 * (c[3] - c[2]), c[4] - 0.5 * c[3], 1.5 * c[5] - 0.5 * c[4]


@kernel
def motion(length, c, phi, rate):
    """Change of position [m/s] and rotation [rad/s] of the end at the rate of change of phi.

    The products P rate and J rate, where P is the derivative of p by phi.
    """
    e1, e2, e3 = _slopes(c)
    growth, z = 2 * dot3(phi, rate), phi[2]
    # p / l = c1 e_z + c2 phi x e_z + c3 z phi
    x, y, _ = mix(growth * e2, phi, c[2], rate)
    k, m = growth * e3 * z + c[3] * rate[2], c[3] * z
    shift = mix(k, phi, m, rate)
    shift = (shift[0] + y, shift[1] - x, shift[2] + growth * e1)
    return scaled(length, shift), blend(c[1], c[2], c[3], phi, rate)


@kernel
def motion_transpose(length, c, phi, force, moment):
    """Generalised force P^T force + J^T moment on phi of a force and a moment at the end."""
    e1, e2, e3 = _slopes(c)
    z, along = phi[2], dot3(phi, force)
    bend = phi[1] * force[0] - phi[0] * force[1]
    shift = mix(2 * (e1 * force[2] + e2 * bend + e3 * z * along), phi, c[3] * z, force)
    shift = (shift[0] - c[2] * force[1], shift[1] + c[2] * force[0], shift[2] + c[3] * along)
    return add(scaled(length, shift), blend(c[1], -c[2], c[3], phi, moment))


@kernel
def motion_bias(length, c, phi, rate):
    """Acceleration [m/s2, rad/s2] of the end while the rate of phi is constant.

    The products of the time derivatives of P and J with the rate.
    """
    e1, e2, e3 = _slopes(c)
    e4, e5 = 2 * c[6] - 0.5 * c[5], 2.5 * c[7] - 0.5 * c[6]
    f1, f2, f3 = 0.5 * (e3 - e2), e4 - 0.5 * e3, 1.5 * e5 - 0.5 * e4
    half, square, z = dot3(phi, rate), dot3(rate, rate), phi[2]
    growth, bend = 2 * half, 2 * square
    # Second derivatives of c1, c2, c3 along the motion, then of the products with phi.
    g1 = growth * growth * f1 + bend * e1
    g2 = growth * growth * f2 + bend * e2
    g3 = growth * growth * f3 + bend * e3
    x, y, _ = mix(g2, phi, 2 * growth * e2, rate)
    k = 2 * growth * e3
    shift = mix(g3 * z + k * rate[2], phi, k * z + 2 * c[3] * rate[2], rate)
    shift = (shift[0] + y, shift[1] - x, shift[2] + g1)
    spin = mix(growth * e3 * half + c[3] * square, phi, growth * e1 + c[3] * half, rate)
    return scaled(length, shift), add(spin, scaled(growth * e2, cross(phi, rate)))


@kernel
def transmit(length, c, phi, force, moment):
    """Carry a force and a moment at the end to the start.

    Returns:
        Generalised force on phi, then the force and the moment about the start in its frame.
    """
    force, moment = turn(c, phi, force), turn(c, phi, moment)
    load = motion_transpose(length, c, phi, force, moment)
    return load, force, add(moment, cross(position(length, c, phi), force))


@kernel
def clamp(zero):
    """Axes and position of the clamp, of numbers of the type of zero."""
    o, e = zero, zero + 1.0
    return ((e, o, o), (o, e, o), (o, o, e)), (o, o, o)


@kernel
def compose(axes, c, phi):
    """Axes of the end in the world, three vectors, given those of the start."""
    o = 0 * c[0]
    e = o + 1.0
    return (
        to_world(axes, turn(c, phi, (e, o, o))),
        to_world(axes, turn(c, phi, (o, e, o))),
        to_world(axes, turn(c, phi, (o, o, e))),
    )


@kernel
def to_world(axes, a):
    """A vector in the world, given its coordinates along axes."""
    x, y, z = axes
    return add(mix(a[0], x, a[1], y), scaled(a[2], z))


@kernel
def to_axes(axes, a):
    """Coordinates along axes of a vector in the world."""
    return (dot3(axes[0], a), dot3(axes[1], a), dot3(axes[2], a))
