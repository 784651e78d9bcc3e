from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams import planar_arm
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.robots.actuation import TendonMap

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
    step = 1e-6
    for k, direction in enumerate(step * np.eye(6)):
        slope = (MODEL.tip(q + direction) - MODEL.tip(q - direction))[[0, 2]] / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-9)


def test_derivatives_are_those_of_the_residual(state):
    q, v, a, u = state
    by_q, by_v = np.empty((2, 6, 6))
    planar_arm.derivatives(DATA, q, v, a, u, by_q, by_v)

    def residual(q, v):
        out = np.empty(6)
        planar_arm.residual(DATA, q, v, a, u, out)
        return out

    for k, e in enumerate(1e-5 * np.eye(6)):
        slope_q = (residual(q + e, v) - residual(q - e, v)) / 2e-5
        slope_v = (residual(q, v + e) - residual(q, v - e)) / 2e-5
        np.testing.assert_allclose(by_q[:, k], slope_q, rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(by_v[:, k], slope_v, rtol=1e-5, atol=1e-9)


def test_series_and_closed_form_meet():
    """E and its derivatives (x, z) just below and above the angle at which the form changes."""
    below, above = planar_arm._turned(0.3 - 1e-9), planar_arm._turned(0.3 + 1e-9)
    np.testing.assert_allclose(below, above, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        (CANTILEVER_WEAK, "continuous channels and no gravity"),
        (replace(ARM, gravity=(0.0, 0.0, -9.81)), "no gravity"),
        (replace(ARM, pieces=4), "ends inside a piece"),
    ],
)
def test_other_robots_are_refused(robot, reason):
    with pytest.raises(ValueError, match=reason):
        make_planar_arm(robot)
