"""Reasons given in docs/thesis_audit.md for departing from the printed thesis."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.control.feedforward.statics import least_norm
from softrobot_env.control.observers import linear_model
from softrobot_env.robots import ARM
from softrobot_env.thesis.arm import operating_points as gains


def follow(statics, start, end, guess):
    """Inverse statics along a straight line, by continuation."""
    for share in np.linspace(0, 1, 60):
        solution = least_norm(statics, (1 - share) * np.array(start) + share * np.array(end), guess)
        assert solution.reached
        guess = solution.inputs
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
    assert (7.837 * ARM.bending_stiffness / (9.81 * ARM.mass_per_length)) ** (1 / 3) < ARM.length


def eigenvalues_of_the_printed_loop(bend):
    """(6.28) as printed: operating point at the measured sigma = (beta_1, beta_3, beta_5)."""
    arm = make_planar_arm(ARM)
    a, b, c = linear_model(arm, bend).state_space()
    gain = gains.lqi_design(arm, bend).reshape(3, 14)
    pick = np.zeros((6, 6))  # curvatures of the operating point from those measured
    for third in range(3):
        pick[2 * third : 2 * third + 2, 2 * third] = 1
    hold = np.linalg.lstsq(arm.inputs, arm.stiffness * pick, rcond=None)[0]
    feedback = np.hstack([hold - gain[:, :6] @ (np.eye(6) - pick), -gain[:, 6:12]])
    top = np.hstack([a + b @ feedback, -b @ gain[:, 12:]])
    return np.linalg.eigvals(np.vstack([top, np.hstack([c, np.zeros((2, 2))])]))


@pytest.mark.parametrize("bend", [(3.0, 2.0, 1.0), (-5.0, 2.0, 4.0), (6.0, 6.0, 6.0)])
def test_printed_lqi_law_is_unstable(bend):
    """The corrected one is stable everywhere: `tests/control/test_lqi.py`."""
    assert eigenvalues_of_the_printed_loop(np.repeat(bend, 2)).real.max() > 1e-3


def test_explicit_euler_cannot_predict():
    """Audit: one step of 0.1 s multiplies errors by 1632, those in the first mode by 1.06."""
    a, _, _ = linear_model(make_planar_arm(ARM), np.zeros(6)).state_space()
    assert np.sort(np.abs(1 + 0.1 * np.linalg.eigvals(a)))[-1] == pytest.approx(1632, rel=0.01)
    slowest = np.linalg.eigvals(a)[np.argsort(np.abs(np.linalg.eigvals(a)))[:2]]
    np.testing.assert_allclose(np.abs(1 + 0.1 * slowest), 1.06, atol=0.01)
