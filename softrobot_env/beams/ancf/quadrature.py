"""Integration over the volume of a beam element with a circular or ring section.

A round section is a disc, a ring the difference of two discs: a rule for a ring has the points
of both, those of the hole with negative weights.
"""

from math import pi
from typing import NamedTuple

import numpy as np


class Moments(NamedTuple):
    """Integrals over a section about its centre; those odd in X2 or X3 vanish.

    Attributes:
        area: [m2].
        second: [m4], of X2^2 and of X3^2.
        fourth: [m6], of X2^4 and of X3^4.
        mixed: [m6], of X2^2 X3^2.
    """

    area: float
    second: float
    fourth: float
    mixed: float


class Rule(NamedTuple):
    """Points (k, 2) [m] in a section and their weights (k,) [m2]."""

    points: np.ndarray
    weights: np.ndarray


def section_moments(outer: float, inner: float = 0.0) -> Moments:
    """Moments of a ring of given radii [m] in closed form."""
    p2, p4, p6 = (outer**k - inner**k for k in (2, 4, 6))
    return Moments(pi * p2, pi / 4 * p4, pi / 8 * p6, pi / 24 * p6)


def legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in (0, 1) and weights of n-point Gauss-Legendre integration, exact to 2 n - 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    return (1 + x) / 2, w / 2


def legendre_rule(n: int, outer: float, inner: float = 0.0, planar: bool = False) -> Rule:
    """The thesis' n x n Gauss-Legendre rule, (2.68), (2.70) and (2.71).

    The height sqrt(r^2 - X2^2) of the section is no polynomial, so that the rule converges
    slowly in n: its area errs by 8.65e-4 for n = 8.

    Args:
        n: Order.
        outer, inner: [m], radii.
        planar: Whether the integrand does not depend on X3, so that n points suffice.
    """
    x, w = np.polynomial.legendre.leggauss(n)
    return _ring(x, w * np.sqrt(1 - x**2), 1 if planar else n, outer, inner)


def chebyshev_rule(n: int, outer: float, inner: float = 0.0, planar: bool = False) -> Rule:
    """n x n rule, exact for polynomials of degree 2 n - 1 (audit of (2.68)).

    Gauss-Chebyshev integration of the second kind in X2, whose weight function is the height of
    the section, and Gauss-Legendre in X3. Arguments as in `legendre_rule`.
    """
    angle = pi * np.arange(1, n + 1) / (n + 1)
    weights = pi / (n + 1) * np.sin(angle) ** 2
    return _ring(np.cos(angle), weights, 1 if planar else n, outer, inner)


def _ring(x: np.ndarray, w: np.ndarray, across: int, outer: float, inner: float) -> Rule:
    """Rule from one for int sqrt(1 - x^2) f(x) dx over (-1, 1) and `across` points in X3."""
    y, v = np.polynomial.legendre.leggauss(across)
    height = np.sqrt(1 - x**2)
    points = np.stack([np.repeat(x, across), np.outer(height, y).ravel()], axis=1)
    weights = np.outer(w, v).ravel()
    if inner == 0:
        return Rule(outer * points, outer**2 * weights)
    return Rule(
        np.concatenate([outer * points, inner * points]),
        np.concatenate([outer**2 * weights, -(inner**2) * weights]),
    )
