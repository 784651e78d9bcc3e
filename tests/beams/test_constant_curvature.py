"""Constant-curvature statics against direct integration, differences and a general optimiser."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.feedforward.motion import least_norm
from softrobot_env.robots import ARM, CANTILEVER_WEAK

INPUTS = [(0.0, 0.0, 0.0), (5.0, 5.0, 5.0), (-30.0, 12.0, 40.0), (60.0, -55.0, 20.0)]


@pytest.fixture(scope="module")
def statics():
    return ConstantCurvatureStatics(ARM)


def integrate(robot, reduced):
    """Tip by integrating x' = sin t, z' = cos t, t' = sum of F r / EI of the pairs beyond s."""
    radius, ends = robot.tendons[0].offset[0], [t.end for t in robot.tendons[::2]]
    state, start = np.zeros(3), 0.0
    for end in ends:
        bend = sum(f * radius for f, e in zip(reduced, ends, strict=True) if e >= end)
        k = bend / robot.bending_stiffness
        span = solve_ivp(
            lambda s, y, k=k: [k, np.sin(y[0]), np.cos(y[0])],
            (start, end),
            state,
            rtol=1e-11,
            atol=1e-12,
        )
        state, start = span.y[:, -1], end
    return state[1:]


@pytest.mark.parametrize("reduced", INPUTS)
def test_tip_is_the_integral_of_the_tangent(statics, reduced):
    np.testing.assert_allclose(statics.tip(np.array(reduced)), integrate(ARM, reduced), atol=1e-9)


# Audit, "arm2d equilibria", printed to 0.1 mm.
@pytest.mark.parametrize(
    ("reduced", "tip"),
    [
        ((0, 0, 20), (0.2636, 0.3905)),
        ((0, 20, 0), (0.2438, 0.4167)),
        ((20, 0, 0), (0.1611, 0.4699)),
        ((5, 5, 5), (0.1750, 0.4603)),
        ((20, 20, 20), (0.3863, 0.0338)),
    ],
)
def test_equilibria_are_the_audits(statics, reduced, tip):
    np.testing.assert_allclose(statics.tip(np.array(reduced, float)), tip, atol=6e-5)


def test_curvature_adds_the_pairs_that_reach_a_station(statics):
    reduced, unit = np.array([7.0, -3.0, 2.0]), 0.025 / ARM.bending_stiffness
    found = statics.curvature(reduced, np.array([0.1, 0.3, 0.45]))
    np.testing.assert_allclose(found, unit * np.array([6.0, -1.0, 2.0]), rtol=1e-13)


@pytest.mark.parametrize("reduced", INPUTS)
def test_jacobian_is_the_derivative_of_the_tip(statics, reduced):
    u, step = np.array(reduced), 1e-4
    columns = [(statics.tip(u + e) - statics.tip(u - e)) / (2 * step) for e in step * np.eye(3)]
    np.testing.assert_allclose(statics.jacobian(u), np.transpose(columns), atol=1e-10)


@pytest.mark.parametrize("target", [(0.2, 0.43), (-0.31, 0.3), (0.05, 0.48), (0.35, 0.25)])
def test_inverse_holds_the_target_with_least_tension(statics, target):
    found = least_norm(statics, np.array(target), np.full(3, 5.0 * np.sign(target[0])))
    assert found.converged
    np.testing.assert_allclose(integrate(ARM, found.reduced), target, atol=1e-8)
    general = minimize(
        lambda u: u @ u,
        found.reduced * 1.1,
        jac=lambda u: 2 * u,
        constraints={"type": "eq", "fun": lambda u: statics.tip(u) - target},
        options={"ftol": 1e-13, "maxiter": 300},
    )
    assert general.success
    # SLSQP stops at a relative change of 1e-13 in |u|^2, hence about 1e-6 in u.
    np.testing.assert_allclose(found.reduced, general.x, atol=1e-3)


def test_inverse_passes_through_the_straight_pose(statics):
    found = least_norm(statics, statics.tip(np.full(3, 4.0)), np.zeros(3))
    assert found.converged


@pytest.mark.parametrize("target", [(0.0, 0.6), (0.45, 0.45)])
def test_inverse_admits_a_target_out_of_reach(statics, target):
    found = least_norm(statics, np.array(target), np.full(3, 5.0))
    assert not found.converged
    # No tip is farther from the base than the arm is long.
    assert found.residual >= np.hypot(*target) - ARM.length
    tip = statics.tip(found.reduced)
    assert found.residual == pytest.approx(np.hypot(*(tip - target)), rel=1e-9)


@pytest.mark.parametrize(
    "robot",
    [
        CANTILEVER_WEAK,
        replace(ARM, gravity=(0.0, 0.0, -9.81)),
        replace(ARM, tendons=tuple(replace(t, guides=(0.1,)) for t in ARM.tendons)),
    ],
    ids=["no_tendons", "gravity", "guides"],
)
def test_robots_without_constant_curvature_are_refused(robot):
    with pytest.raises(ValueError, match="continuous channels and no gravity"):
        ConstantCurvatureStatics(robot)
