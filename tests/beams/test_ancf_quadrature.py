"""Integration rules of the ANCF beam against moments of disc and ring in closed form."""

from math import factorial, pi

import numpy as np
import pytest

from softrobot_env.beams.ancf.section import (
    chebyshev_rule,
    legendre,
    legendre_rule,
    moments_by,
    section_moments,
)

rings = pytest.mark.parametrize(
    ("outer", "inner"), [(0.04, 0.0), (0.025, 0.0125)], ids=["disc", "ring"]
)


#: Powers of X2 and X3 of the moments that a section's law needs.
POWERS = [(0, 0), (2, 0), (0, 2), (4, 0), (0, 4), (2, 2)]


def odd_product(n):
    """(n - 1)!! = n! / (2^(n / 2) (n / 2)!) of an even n."""
    return factorial(n) // (2 ** (n // 2) * factorial(n // 2))


def moment(a, b, outer, inner):
    """Integral of X2^a X3^b over a ring, from the Gaussian moments: for even a and b

    pi (a - 1)!! (b - 1)!! / (2^((a + b) / 2) ((a + b) / 2 + 1)!) (R^(a+b+2) - r^(a+b+2)).
    """
    if a % 2 or b % 2:
        return 0.0
    half = (a + b) // 2
    unit = odd_product(a) * odd_product(b) / (2**half * factorial(half + 1))
    return pi * unit * (outer ** (a + b + 2) - inner ** (a + b + 2))


@rings
def test_moments_are_the_closed_forms(outer, inner):
    expected = [moment(a, b, outer, inner) for a, b in POWERS]
    for found in (section_moments(outer, inner), moments_by(chebyshev_rule(3, outer, inner))):
        flat = [found.area, *found.second, *found.fourth, found.mixed]
        np.testing.assert_allclose(flat, expected, rtol=1e-14)


@rings
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_chebyshev_rule_is_exact_up_to_its_degree_and_no_further(n, outer, inner):
    points, weights = chebyshev_rule(n, outer, inner)
    for degree in range(2 * n + 1):
        errors = []
        for a in range(degree + 1):
            b = degree - a
            found = weights @ (points[:, 0] ** a * points[:, 1] ** b)
            errors.append(abs(found - moment(a, b, outer, inner)) / outer ** (degree + 2))
        if degree < 2 * n:
            assert max(errors) < 1e-14
        else:
            assert max(errors) > 1e-4


def test_legendre_rule_errs_as_the_audit_says():
    outer = 0.04
    area, second = moment(0, 0, outer, 0), moment(2, 0, outer, 0)
    for n, expected in ((6, 1.95e-3), (8, 8.65e-4)):
        weights = legendre_rule(n, outer).weights
        assert weights.sum() / area - 1 == pytest.approx(expected, rel=3e-3)
    points, weights = legendre_rule(8, outer)
    error = abs(weights @ points[:, 0] ** 2 / second - 1)
    assert error == pytest.approx(3.6e-3, rel=0.02)


def test_legendre_rule_converges_as_the_root_at_the_rim_allows():
    """Gauss-Legendre errors fall as n^-3 for an integrand like sqrt(1 - x^2)."""
    errors = [legendre_rule(n, 1.0).weights.sum() / pi - 1 for n in (10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 3, atol=0.15)


@pytest.mark.parametrize("n", [1, 4, 5])
def test_integration_along_an_element_is_exact_to_its_degree(n):
    x, w = legendre(n)
    for degree in range(2 * n):
        assert w @ x**degree == pytest.approx(1 / (degree + 1), rel=1e-13)
    assert abs(w @ x ** (2 * n) - 1 / (2 * n + 1)) > 1e-7
