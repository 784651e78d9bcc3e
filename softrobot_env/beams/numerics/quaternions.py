"""Vectors and quaternions as tuples, for kernels with real or complex numbers.

A vector is (x, y, z), a quaternion (real part, x, y, z). A unit quaternion u stands for the
rotation R that turns x into the imaginary part of u x conj(u). Complex numbers carry derivatives,
so products never conjugate them.
"""

import numpy as np

from softrobot_env.compile.kernels import kernel


@kernel
def row3(a, i):
    """Row i of an array (n, 3)."""
    return a[i, 0], a[i, 1], a[i, 2]


@kernel
def column3(a, j):
    """Column j of an array (3, n)."""
    return a[0, j], a[1, j], a[2, j]


@kernel
def row4(a, i):
    """Row i of an array (n, 4)."""
    return a[i, 0], a[i, 1], a[i, 2], a[i, 3]


@kernel
def vector_at(a, j):
    """Three elements of an array (n,) from j."""
    return a[j], a[j + 1], a[j + 2]


@kernel
def quaternion_at(a, j):
    """Four elements of an array (n,) from j."""
    return a[j], a[j + 1], a[j + 2], a[j + 3]


@kernel
def add_scaled(a, i, factor, x):
    """Add factor x, a vector, to row i of an array (n, 3)."""
    a[i, 0] += factor * x[0]
    a[i, 1] += factor * x[1]
    a[i, 2] += factor * x[2]


@kernel
def vector(row):
    """Row (3,) as a vector."""
    return (row[0], row[1], row[2])


@kernel
def store(row, a):
    """Set a row (3,) to a vector."""
    row[0], row[1], row[2] = a


@kernel
def set_axes(out, x, y, z):
    """Set out (3, 3) to three vectors, as columns."""
    for i in range(3):
        out[i, 0], out[i, 1], out[i, 2] = x[i], y[i], z[i]


@kernel
def accumulate(row, a):
    """Add a vector to a row (3,)."""
    row[0] += a[0]
    row[1] += a[1]
    row[2] += a[2]


@kernel
def dot3(x, y):
    """Inner product of vectors."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@kernel
def dot4(p, r):
    """Inner product of quaternions."""
    return p[0] * r[0] + p[1] * r[1] + p[2] * r[2] + p[3] * r[3]


@kernel
def cross(x, y):
    """Vector product."""
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@kernel
def add(a, b):
    """Sum of vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def difference(a, b):
    """Vector a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def stretched(factors, a):
    """A vector times factors (3,), one for each component."""
    return (factors[0] * a[0], factors[1] * a[1], factors[2] * a[2])


@kernel
def scaled(factor, a):
    """A vector times a number."""
    return (factor * a[0], factor * a[1], factor * a[2])


@kernel
def mix(f, a, g, b):
    """Linear combination f a + g b of vectors."""
    return (f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2])


@kernel
def transformed(matrix, a):
    """Product of a matrix (3, 3) with a vector."""
    return dot3(row3(matrix, 0), a), dot3(row3(matrix, 1), a), dot3(row3(matrix, 2), a)


@kernel
def unit(p):
    """Unit quaternion of the direction of p."""
    scale = 1 / np.sqrt(dot4(p, p))
    return scale * p[0], scale * p[1], scale * p[2], scale * p[3]


@kernel
def quotient(p, r):
    """Quaternion product conj(p) r."""
    return (
        dot4(p, r),
        p[0] * r[1] - p[1] * r[0] - p[2] * r[3] + p[3] * r[2],
        p[0] * r[2] - p[2] * r[0] - p[3] * r[1] + p[1] * r[3],
        p[0] * r[3] - p[3] * r[0] - p[1] * r[2] + p[2] * r[1],
    )


@kernel
def times_vector(p, x):
    """Quaternion product p (0, x)."""
    return (
        -p[1] * x[0] - p[2] * x[1] - p[3] * x[2],
        p[0] * x[0] + p[2] * x[2] - p[3] * x[1],
        p[0] * x[1] + p[3] * x[0] - p[1] * x[2],
        p[0] * x[2] + p[1] * x[1] - p[2] * x[0],
    )


@kernel
def rotate(u, x):
    """Rotated vector R x."""
    turned = cross(u[1:], x)
    return add(x, scaled(2.0, add(scaled(u[0], turned), cross(u[1:], turned))))


@kernel
def rotate_back(u, x):
    """Vector R^T x: seen from the rotated frame."""
    return rotate((u[0], -u[1], -u[2], -u[3]), x)


@kernel
def relative(first, second):
    """Unit quaternion of the rotation from a first to a second frame, with real part >= 0.

    Both signs stand for the same rotation; this one has the smaller angle.
    """
    w = quotient(first, second)
    if w[0].real < 0:
        return -w[0], -w[1], -w[2], -w[3]
    return w


@kernel
def relative_rate(w, first, second):
    """Rate of `relative` w, given the angular velocities of both frames in themselves [rad/s]."""
    change, twist = difference(second, first), cross(w[1:], add(second, first))
    x, y, z = scaled(0.5, add(scaled(w[0], change), twist))
    return -0.5 * dot3(w[1:], change), x, y, z


#: sin^2 below which theta / sin(theta) is summed as a series: eight terms are then exact.
_SERIES = 0.01


@kernel
def weighting(kind, w):
    """Weighting xi_1 to xi_5 of a relative unit quaternion and its derivative by the real part.

    With cos(theta) the real part, theta half the angle of rotation (thesis sec. 2.2.5). xi_3 has
    no value at theta = pi/2, sections turned by 180 degrees: there it is infinite.
    """
    c = w[0]
    if kind == 2:
        root = np.sqrt(2 / (1 + c))
        return root, -0.5 * root / (1 + c)
    if kind == 3:
        return 1 / c, -1 / (c * c)
    if kind == 4:
        value = 2 / (1 + c)
        return value, -value / (1 + c)
    if kind == 5:
        square = dot3(w[1:], w[1:])
        if square.real < _SERIES:
            return _arc_over_sine(square), -2 * c * _arc_over_sine_slope(square)
        sine = np.sqrt(square)
        value = 2 * np.arctan(sine / (1 + c)) / sine
        return value, (value * c - 1) / square
    return c * 0 + 1, c * 0


@kernel
def _arc_over_sine(z):
    """Series of arcsin(x) / x in z = x^2."""
    high = 63 / 2816 + z * (231 / 13312 + z * (143 / 10240 + z * 6435 / 557056))
    return 1 + z * (1 / 6 + z * (3 / 40 + z * (5 / 112 + z * (35 / 1152 + z * high))))


@kernel
def _arc_over_sine_slope(z):
    """Its derivative by z."""
    high = 5 * 63 / 2816 + z * (6 * 231 / 13312 + z * (7 * 143 / 10240 + z * 8 * 6435 / 557056))
    return 1 / 6 + z * (2 * 3 / 40 + z * (3 * 5 / 112 + z * (4 * 35 / 1152 + z * high)))
