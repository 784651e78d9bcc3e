"""The section of the ANCF beam: integration over it, strain and stress resultants.

Thesis (2.61), (2.62) and (2.68). A round section is a disc, a ring the difference of two discs: a
rule for a ring has the points of both, those of the hole with negative weights.

The section's state is the g = 2 d - 1 vectors G = [c', r_,2', (r_,3',) r_,2 (, r_,3)] with d = 2 or
3 components, primes being derivatives by X1 along the centreline c. The strain at any point of it
follows from the symmetric E = (G_i . G_j - G0_i . G0_j) / 2, (g, g), of the straight pose G0:

    e_11 = sum_ij X_i X_j E_ij,  e_1k = sum_j X_j E_j,k,  e_kl = E_kl,  writing 1 for X_1.

The integral of stress times strain over the section is N : E with resultants N (g, g) that are
linear in E. Their coefficients are moments of the section: those in closed form, so that an exact
volume integral needs points along X1 only, or those that a rule gives. The force on G_i is
sum_j N_ij G_j.
"""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure
from softrobot_env.robots import RobotParams


@structure
class SectionLaw(NamedTuple):
    """Hooke's law (2.62) of a section.

    Attributes:
        stretch, lame, shear: [Pa], s_11 = stretch e_11 + lame (e_22 + e_33),
            s_12 = 2 shear e_12 and so forth.
        area, second, fourth, mixed: `Moments`.
    """

    stretch: float
    lame: float
    shear: float
    area: float
    second: tuple[float, float]
    fourth: tuple[float, float]
    mixed: float


def hooke(robot: RobotParams, plane: str | None) -> tuple[float, float, float]:
    """Coefficients (stretch, lame, shear) [Pa] of Hooke's law, of a plane one unless None."""
    modulus, nu = robot.youngs_modulus, robot.poisson_ratio
    shear = modulus / (2 * (1 + nu))
    if plane == "stress":
        return modulus / (1 - nu**2), nu * modulus / (1 - nu**2), shear
    lame = nu * modulus / ((1 + nu) * (1 - 2 * nu))
    return lame + 2 * shear, lame, shear


class Moments(NamedTuple):
    """Integrals over a section about its centre; those odd in X2 or X3 vanish.

    Attributes:
        area: [m2].
        second: [m4], of X2^2 and of X3^2.
        fourth: [m6], of X2^4 and of X3^4.
        mixed: [m6], of X2^2 X3^2.
    """

    area: float
    second: tuple[float, float]
    fourth: tuple[float, float]
    mixed: float


class Rule(NamedTuple):
    """Points (k, 2) [m] in a section and their weights (k,) [m2]."""

    points: ndarray
    weights: ndarray


def section_moments(outer: float, inner: float = 0.0) -> Moments:
    """Moments of a ring of given radii [m] in closed form."""
    p2, p4, p6 = (outer**k - inner**k for k in (2, 4, 6))
    return Moments(pi * p2, (pi / 4 * p4,) * 2, (pi / 8 * p6,) * 2, pi / 24 * p6)


def moments_by(rule: Rule) -> Moments:
    """Moments of a section by a rule that is symmetric in X2 and X3."""
    squares, weights = rule.points**2, rule.weights
    second, fourth = (tuple((weights @ x).tolist()) for x in (squares, squares**2))
    return Moments(float(weights.sum()), second, fourth, float(weights @ squares.prod(axis=1)))


def legendre(n: int) -> tuple[ndarray, ndarray]:
    """Points in (0, 1) and weights of n-point Gauss-Legendre integration, exact to 2 n - 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    return (1 + x) / 2, w / 2


def legendre_rule(n: int, outer: float, inner: float = 0.0) -> Rule:
    """The thesis' n x n Gauss-Legendre rule, (2.68), (2.70) and (2.71), for radii [m].

    The height sqrt(r^2 - X2^2) of the section is no polynomial, so that the rule converges
    slowly in n: its area errs by 8.65e-4 for n = 8.
    """
    x, w = np.polynomial.legendre.leggauss(n)
    return _ring(x, w * np.sqrt(1 - x**2), outer, inner)


def chebyshev_rule(n: int, outer: float, inner: float = 0.0) -> Rule:
    """n x n rule for radii [m], exact for polynomials of degree 2 n - 1 (audit of (2.68)).

    Gauss-Chebyshev integration of the second kind in X2, whose weight function is the height of
    the section, and Gauss-Legendre in X3.
    """
    angle = pi * np.arange(1, n + 1) / (n + 1)
    return _ring(np.cos(angle), pi / (n + 1) * np.sin(angle) ** 2, outer, inner)


def _ring(x: ndarray, w: ndarray, outer: float, inner: float) -> Rule:
    """Rule from one for int sqrt(1 - x^2) f(x) dx over (-1, 1), with as many points in X3."""
    y, v = np.polynomial.legendre.leggauss(len(x))
    height = np.sqrt(1 - x**2)
    points = np.stack([np.repeat(x, len(y)), np.outer(height, y).ravel()], axis=1)
    weights = np.outer(w, v).ravel()
    if inner == 0:
        return Rule(outer * points, outer**2 * weights)
    return Rule(
        np.concatenate([outer * points, inner * points]),
        np.concatenate([outer**2 * weights, -(inner**2) * weights]),
    )


@kernel
def set_strain(axes, gradients, advanced, out):
    """Set out (g, g) to E + mu dE/dt, given G and G + 2 mu dG/dt (g, d)."""
    d = len(axes)
    for i in range(2 * d - 1):
        for j in range(i + 1):
            total = gradients.dtype.type(0)
            for b in range(d):
                total += gradients[i, b] * advanced[j, b] + advanced[i, b] * gradients[j, b]
            out[i, j] = 0.25 * total
            out[j, i] = out[i, j]
    out[0, 0] -= 0.5
    for k in range(d, 2 * d - 1):
        out[k, k] -= 0.5


@kernel
def set_resultants(law, axes, strain, out):
    """Set out (g, g) to the resultants N [N, N m, N m2] of E (g, g)."""
    d = len(axes)
    area, second, fourth = law.area, law.second, law.fourth
    stretch, lame, shear = law.stretch, law.lame, law.shear
    axial, lateral = strain[0, 0], strain.dtype.type(0)
    mean, bent = area * axial, strain.dtype.type(0)  # integral of e_11
    for k in range(1, d):
        mean += second[k - 1] * strain[k, k]
        bent += strain[k, k]
        lateral += strain[d - 1 + k, d - 1 + k]
    out[0, 0] = stretch * mean + lame * area * lateral
    for k in range(1, d):
        square = second[k - 1]
        out[0, k] = 2 * stretch * square * strain[0, k]
        out[k, 0] = out[0, k]
        for j in range(1, d):
            out[j, k] = 2 * stretch * law.mixed * strain[j, k]
        across = law.mixed * (bent - strain[k, k])
        moment = square * axial + fourth[k - 1] * strain[k, k] + across
        out[k, k] = stretch * moment + lame * square * lateral
    for k in range(d, 2 * d - 1):
        for j in range(d):
            moment = area if j == 0 else second[j - 1]
            out[j, k] = 2 * shear * moment * strain[j, k]
            out[k, j] = out[j, k]
        for j in range(d, 2 * d - 1):
            out[j, k] = 2 * shear * area * strain[j, k]
        out[k, k] += lame * (mean + area * lateral)
