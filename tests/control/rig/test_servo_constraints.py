from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.signals import held
from softrobot_env.robots import RIG
from softrobot_env.thesis.rig.servo_constraints import OutOfReachError, ServoConstraints
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle
from studies.truths import rig_piece

SERVO = ServoConstraints(RIG)
FAST = RoundedTriangle(period=1.0)
L = RIG.length


def along(run, t):
    return run.position(t), run.velocity(t), run.acceleration(t)


def outputs(q):
    """Output (k, 2) [m] of PCC's curvatures (k, 2)."""
    point, jacobian, out = np.empty(3), np.empty((3, 2)), np.empty((len(q), 2))
    for i, (beta, gamma) in enumerate(q):
        rig_piece.output(SERVO.data.piece, L * np.array([-gamma, beta]), point, jacobian)
        out[i] = point[:2]
    return out


def curvatures(y):
    return np.stack([y[..., 1], -y[..., 0]], axis=-1) / L


@pytest.fixture(scope="module")
def plan():
    t = np.linspace(0, FAST.end_time, 400)
    return t, rig_piece.plan(SERVO, *along(FAST, t))


def test_motion_has_the_output_wanted(plan):
    t, inverse = plan
    np.testing.assert_allclose(outputs(curvatures(inverse.y)), FAST.position(t)[:, :2], atol=1e-15)
    h = 1e-4
    ahead, behind = (rig_piece.plan(SERVO, *along(FAST, t + s)) for s in (h, -h))
    np.testing.assert_allclose(inverse.v, (ahead.y - behind.y) / (2 * h), atol=1e-4)
    np.testing.assert_allclose(inverse.a, (ahead.v - behind.v) / (2 * h), atol=1e-2)


def test_inputs_balance_the_general_model(plan):
    """By tension and by length, of another implementation of the same rig."""
    _, inverse = plan
    motion = [curvatures(x) for x in (inverse.y, inverse.v, inverse.a)]
    for drive, inputs in (("tension", inverse.tension), ("length", inverse.pulled)):
        model = PCC(RIG, 1, axes="spatial", inertia=SUBPIECES, drive=drive)
        missing = [model.residual(*x) for x in zip(*motion, inputs, strict=True)]
        assert np.abs(missing).max() < 1e-14


def test_static_part_is_the_inverse_at_rest(plan):
    """Hence lengths at rest plus the dynamic part are the lengths (5.36)."""
    t, inverse = plan
    rest = rig_piece.plan(SERVO, FAST.position(t), *np.zeros((2, len(t), 3)))
    np.testing.assert_allclose(inverse.static, rest.reduced, atol=1e-13)
    np.testing.assert_allclose(rest.pulled + inverse.dynamic, inverse.pulled, atol=1e-16)
    assert np.abs(rest.dynamic).max() < 1e-16


def test_the_guess_does_not_matter(plan):
    t, inverse = plan
    motion = along(FAST, t[200:203])
    for i, guess in enumerate((None, inverse.y[199], np.array([0.0, -1.9]))):
        step = SERVO.motion(*(x[i : i + 1] for x in motion), guess)[:, 0]
        for found, expected in zip(step, inverse, strict=False):
            np.testing.assert_allclose(found, expected[200 + i], atol=1e-11)


def test_the_height_of_a_reference_is_ignored():
    t = np.linspace(11, 12, 5)
    flat = rig_piece.plan(SERVO, *(x[:, :2] for x in along(FAST, t)))
    raised = rig_piece.plan(
        SERVO, FAST.position(t) + np.array([0, 0, 0.2]), FAST.velocity(t), FAST.acceleration(t)
    )
    assert all(np.array_equal(a, b) for a, b in zip(flat, raised, strict=True))


# ---------------------------------------------------------------- forward simulation


def errors(run, inputs, drive="length", samples=2e-3):
    """Distance [m] of the forward model's output from the reference, after the approach."""
    model = PCC(RIG, 1, axes="spatial", inertia=SUBPIECES, drive=drive)
    motion = model.simulate(run.end_time, inputs, samples=samples, tolerance=1e-7)
    gap = outputs(motion.q) - run.position(motion.time)[:, :2]
    return np.linalg.norm(gap, axis=1)[motion.time >= run.approach]


def hold(run, rate, shift=0.0, field="pulled"):
    """Inputs of the plan, held from instant to instant; `shift` in periods."""
    t = (np.arange(round(run.end_time * rate)) + shift) / rate
    return held(getattr(rig_piece.plan(SERVO, *along(run, t)), field), 1 / rate)


@pytest.mark.parametrize("field", ["tension", "pulled"])
@pytest.mark.parametrize(
    ("period", "mean", "largest"), [(5.0, 0.7e-3, 1.3e-3), (1.0, 3.3e-3, 6.6e-3)]
)
def test_triangle_is_followed_as_the_audit_says(period, mean, largest, field):
    run = RoundedTriangle(period=period)
    drive = "length" if field == "pulled" else "tension"
    found = errors(run, hold(run, 50, field=field), drive, samples=0.01)
    assert found.mean() == pytest.approx(mean, abs=0.06e-3)
    assert found.max() == pytest.approx(largest, abs=0.06e-3)


def test_held_inputs_lag_by_half_a_period():
    """So the error is of first order, and of second with inputs for the middle of the period."""
    late = [errors(FAST, hold(FAST, rate)).max() for rate in (50, 100)]
    timely = [errors(FAST, hold(FAST, rate, shift=0.5)).max() for rate in (50, 100)]
    assert late[0] / late[1] == pytest.approx(2, rel=0.05)
    assert timely[0] / timely[1] == pytest.approx(4, rel=0.1)
    assert timely[0] < 0.02 * late[0]


# ---------------------------------------------------------------- bad input


def test_out_of_reach_is_refused_with_the_first_place():
    run = LapCircle(radius=0.16)
    t = np.linspace(0, run.end_time, 300)
    with pytest.raises(OutOfReachError, match=r"mm from the axis of robot 'rig', whose") as error:
        rig_piece.plan(SERVO, *along(run, t))
    distance = np.hypot(*run.position(t)[:, :2].T)
    assert error.value.index == np.argmax(distance >= SERVO.reach)
    with pytest.raises(OutOfReachError, match=r"reference 0 is 200\.0 mm"):
        rig_piece.plan(SERVO, np.array([[0.0, 0.2]]), *np.zeros((2, 1, 2)))


@pytest.mark.parametrize("part", range(3))
def test_references_that_are_not_finite_are_refused(part):
    motion = np.zeros((3, 4, 2))
    motion[part, 2, 0] = np.inf
    with pytest.raises(ValueError, match="reference 2 is not finite"):
        SERVO.motion(*motion)


def test_stiff_tendons_have_no_length_to_be_driven_by():
    tendons = tuple(replace(t, stiffness=np.inf) for t in RIG.tendons)
    with pytest.raises(ValueError, match="finite stiffness"):
        ServoConstraints(replace(RIG, tendons=tendons))
