"""The planar arm in closed form: against the general model, the exact rod and an optimiser."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from support.derivatives import differences

from softrobot_env.beams import planar_arm
from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.control.feedforward.statics import least_norm
from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.robots.actuation import TendonMap
from studies.truths.tendon_rod import tendon_rod

# ---------------------------------------------------------------- statics

INPUTS = [(0.0, 0.0, 0.0), (5.0, 5.0, 5.0), (-30.0, 12.0, 40.0), (60.0, -55.0, 20.0)]


@pytest.fixture(scope="module")
def statics():
    return ConstantCurvatureStatics(ARM)


def exact_tip(reduced):
    """Of the rod in space that the tendons pull."""
    tension = TendonMap(ARM).tension(np.array(reduced))
    return tendon_rod(ARM, tension, [ARM.length]).tip[[0, 2]]


@pytest.mark.parametrize("reduced", INPUTS)
def test_tip_is_that_of_the_exact_rod(statics, reduced):
    np.testing.assert_allclose(statics.tip(np.array(reduced)), exact_tip(reduced), atol=1e-9)


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
    u = np.array(reduced)
    np.testing.assert_allclose(statics.jacobian(u), differences(statics.tip, u, 1e-4), atol=1e-10)


@pytest.mark.parametrize("target", [(0.2, 0.43), (-0.31, 0.3), (0.05, 0.48), (0.35, 0.25)])
def test_inverse_holds_the_target_with_least_tension(statics, target):
    found = least_norm(statics, np.array(target), np.full(3, 5.0 * np.sign(target[0])))
    assert found.reached
    np.testing.assert_allclose(exact_tip(found.inputs), target, atol=1e-8)
    general = minimize(
        lambda u: u @ u,
        found.inputs * 1.1,
        jac=lambda u: 2 * u,
        constraints={"type": "eq", "fun": lambda u: statics.tip(u) - target},
        options={"ftol": 1e-13, "maxiter": 300},
    )
    assert general.success
    # SLSQP stops at a relative change of 1e-13 in |u|^2, hence about 1e-6 in u.
    np.testing.assert_allclose(found.inputs, general.x, atol=1e-3)


def test_inverse_passes_through_the_straight_pose(statics):
    found = least_norm(statics, statics.tip(np.full(3, 4.0)), np.zeros(3))
    assert found.reached


@pytest.mark.parametrize("target", [(0.0, 0.6), (0.45, 0.45)])
def test_inverse_admits_a_target_out_of_reach(statics, target):
    found = least_norm(statics, np.array(target), np.full(3, 5.0))
    assert not found.reached
    # No tip is farther from the base than the arm is long.
    assert found.error >= np.hypot(*target) - ARM.length
    tip = statics.tip(found.inputs)
    assert found.error == pytest.approx(np.hypot(*(tip - target)), rel=1e-9)


# ---------------------------------------------------------------- dynamics

MODEL = PCC(ARM, axes="planar")
DATA = make_planar_arm(ARM)
MAP = TendonMap(ARM)


@pytest.fixture(params=[0.0, 1e-6, 0.1, 3.0, 20.0], ids="bend {}".format)
def state(request):
    """q, v, a, u of some size; the first piece is straight, where the closed form is 0 / 0."""
    rng = np.random.default_rng(1)
    q, v, a = rng.normal(size=(3, 6)) * np.array([[request.param], [5.0], [50.0]])
    q[0] = 0.0
    return q, v, a, rng.normal(size=3) * 20


def test_equations_of_motion_are_those_of_the_general_model(state):
    q, v, a, u = state
    out = np.empty(6)
    planar_arm.residual(DATA, q, v, a, u, out)
    expected = MODEL.residual(q, v, a, MAP.tension(u))
    np.testing.assert_allclose(out, expected, rtol=1e-10, atol=1e-13 * np.abs(expected).max())


def test_inertia_is_that_of_the_general_model(state):
    q, v, _, _ = state
    mass, gyroscopic = np.empty((6, 6)), np.empty(6)
    planar_arm.inertia_forces(DATA, q, v, mass, gyroscopic)
    form = MODEL.control_affine(q, v)
    np.testing.assert_allclose(mass, form.mass, rtol=1e-10, atol=1e-16)
    np.testing.assert_allclose(gyroscopic, form.gyroscopic, rtol=1e-8, atol=1e-12)


def test_tip_and_its_derivative(state):
    q = state[0]
    point, jacobian = np.empty(2), np.empty((2, 6))
    planar_arm.tip(DATA, q, point, jacobian)
    np.testing.assert_allclose(point, MODEL.tip(q)[[0, 2]], atol=1e-14)
    np.testing.assert_allclose(jacobian, differences(MODEL.tip, q, 1e-6)[[0, 2]], atol=1e-9)


def test_derivatives_are_those_of_the_residual(state):
    q, v, a, u = state
    by_q, by_v = np.empty((2, 6, 6))
    planar_arm.derivatives(DATA, q, v, a, u, by_q, by_v)

    def residual(q, v):
        out = np.empty(6)
        planar_arm.residual(DATA, q, v, a, u, out)
        return out

    for found, slope in (
        (by_q, differences(lambda x: residual(x, v), q, 1e-5)),
        (by_v, differences(lambda x: residual(q, x), v, 1e-5)),
    ):
        np.testing.assert_allclose(found, slope, rtol=1e-5, atol=1e-9)


def test_series_and_closed_form_meet():
    """E and its derivatives (x, z) just below and above the angle at which the form changes."""
    below, above = planar_arm._turned(0.3 - 1e-9), planar_arm._turned(0.3 + 1e-9)
    np.testing.assert_allclose(below, above, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "robot", "reason"),
    [
        *(
            (make, robot, "continuous channels and no gravity")
            for make in (ConstantCurvatureStatics, make_planar_arm)
            for robot in (
                CANTILEVER_WEAK,
                replace(ARM, gravity=(0.0, 0.0, -9.81)),
                replace(ARM, tendons=tuple(replace(t, guides=(0.1,)) for t in ARM.tendons)),
            )
        ),
        (make_planar_arm, replace(ARM, pieces=4), "ends inside a piece"),
    ],
)
def test_other_robots_are_refused(make, robot, reason):
    with pytest.raises(ValueError, match=reason):
        make(robot)
