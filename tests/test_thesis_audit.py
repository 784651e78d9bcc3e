"""Reasons given in docs/thesis_audit.md for departing from the printed thesis."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.robots import ARM


def follow(statics, start, end, guess):
    """Inverse statics along a straight line, by continuation."""
    for share in np.linspace(0, 1, 60):
        solution = statics.inverse((1 - share) * np.array(start) + share * np.array(end), guess)
        assert solution.converged
        guess = solution.reduced
    return guess


def test_corner_of_the_lshape_needs_about_55_newton():
    start = np.array([5.4, 7.4, 7.9])
    corner = follow(ConstantCurvatureStatics(ARM), (0.24, 0.42), (0.24, 0.30), start)
    # Audit: about (-55, 2, 52) N, beyond the 20 N of the quasi-static training set.
    np.testing.assert_allclose(corner, [-55, 2, 52], atol=0.6)


def test_printed_radii_would_hardly_move():
    """With 25 and 50 mm radii 20 N move the tip by 10 to 19 mm: no 200 mm step is possible."""
    stiff = ConstantCurvatureStatics(replace(ARM, outer_radius=0.05, inner_radius=0.025))
    straight = stiff.tip(np.zeros(3))
    moved = [np.linalg.norm(stiff.tip(20.0 * pair) - straight) for pair in np.eye(3)]
    assert min(moved) > 0.009 and max(moved) < 0.02
    assert np.linalg.norm(stiff.tip(np.full(3, 20.0)) - straight) == pytest.approx(0.045, abs=2e-3)


def test_upright_arm_would_buckle_under_its_weight():
    """Greenhill's length (7.837 EI / q)^(1/3) of a standing column is below the arm's."""
    weight = 9.81 * ARM.mass_per_length
    assert (7.837 * ARM.bending_stiffness / weight) ** (1 / 3) < ARM.length
