from dataclasses import replace

import numpy as np
import pytest
from support.derivatives import differences
from support.flexible_plan import internal_poles, output, plan

from softrobot_env.robots import RIG
from softrobot_env.thesis.rig import servo_flexible
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.rig.servo_dae import hold
from softrobot_env.thesis.rig.servo_flexible import FlexibleServoConstraints, InversionError
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle
from studies.truths import rig_piece

FAST = RoundedTriangle(period=1.0, laps=0, approach=2.0)
RATE = 50
TIMES = np.linspace(0, FAST.end_time, round(FAST.end_time * RATE) + 1)


@pytest.fixture(scope="module")
def one():
    return FlexibleServoConstraints(RIG, 1)


@pytest.fixture(scope="module")
def three():
    return FlexibleServoConstraints(RIG, 3)


def algebraic():
    motion = (FAST.position(TIMES), FAST.velocity(TIMES), FAST.acceleration(TIMES))
    return rig_piece.plan(ServoConstraints(RIG), *motion)


def test_dae_with_one_piece_has_the_algebraic_solution(one):
    """With an error of second order in the step."""
    exact = algebraic()
    plans = [plan(one, FAST, TIMES, n) for n in (4, 8)]
    for name in ("reduced", "tension", "pulled"):
        gaps = [np.abs(getattr(p, name) - getattr(exact, name)).max() for p in plans]
        assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.1)
    assert gaps[1] < 1e-5


def test_stabilisation_keeps_the_output_on_its_trajectory(one, monkeypatch):
    """Without it, the errors of the velocity's integration stay."""
    kept = plan(one, FAST, TIMES, 2)
    monkeypatch.setattr(servo_flexible, "STABILISATION", 0.0)
    free = plan(one, FAST, TIMES, 2)
    gaps = [
        np.abs(output(one, p.q[-1:]) - FAST.position(TIMES[-1:])[:, :2]).max() for p in (kept, free)
    ]
    assert gaps[0] < 0.05 * gaps[1]


def test_motion_and_inputs_of_three_pieces_balance(three):
    found = plan(three, FAST, TIMES, 8)

    def missing(k):
        """With rates by differences over k steps to both sides."""
        rate = (found.v[2 * k :] - found.v[: -2 * k]) / (2 * k * (TIMES[1] - TIMES[0]))
        moved = (part[k:-k] for part in (found.q, found.v))
        series = zip(*moved, rate, found.tension[k:-k], strict=True)
        return np.abs([three.model.residual(*x) for x in series]).max()

    moments = np.abs([three.model.residual(q, 0 * q, 0 * q) for q in found.q]).max()
    # What is left is the error of the difference: of second order in the step.
    assert missing(1) < 0.05 * moments
    assert missing(2) / missing(1) == pytest.approx(4, rel=0.3)
    gap = output(three, found.q) - FAST.position(TIMES)[:, :2]
    assert np.abs(gap).max() < 1e-5


def test_output_is_that_of_the_head(three):
    """The straight rig, and one bent evenly, whose three pieces are one arc."""
    angle = 1.2
    q = np.zeros((2, 6))
    q[1, 1::2] = angle / RIG.length
    x = RIG.length / angle * (1 - np.cos(angle)) + RIG.head.output * np.sin(angle)
    np.testing.assert_allclose(output(three, q), [[0, 0], [0, x]], atol=1e-15)


def test_statics_hold_the_model(three):
    for z in ([0.0, 0.0], [0.09, 0.0], [-0.06, 0.1]):
        q, reduced = three.statics(np.array(z))
        np.testing.assert_allclose(output(three, q[None])[0], z, atol=1e-13)
        held_by = three.model.equilibrium(three.tendons.tension(reduced), load_steps=10)
        np.testing.assert_allclose(held_by, q, atol=1e-7)


def test_forward_integration_grows_where_a_pole_says_so():
    """Undamped, on a slow circle: at 120 mm a pole grows by 8 1/s, at 90 mm none does."""
    servo = FlexibleServoConstraints(replace(RIG, damping_time=0.0), 3)
    times = np.linspace(0, 6, 301)
    inside, outside = (LapCircle(radius=r, approach=4.0, ramp=1.0) for r in (0.09, 0.12))
    force = np.linalg.norm(plan(servo, inside, times, 8).reduced, axis=1)
    assert np.ptp(force[260:]) < 0.01 * force[-1]  # on the lap, steady
    with pytest.raises(InversionError) as error:
        plan(servo, outside, times, 8)
    assert error.value.time > 4


def test_one_piece_has_no_internal_dynamics(one):
    assert internal_poles(one, *one.statics(np.array([0.05, 0.0]))).size == 0


def poles(pieces, radius, damping_time=RIG.damping_time):
    robot = replace(RIG, damping_time=damping_time)
    servo = FlexibleServoConstraints(robot, pieces)
    return internal_poles(servo, *servo.statics(np.array([0.0, radius])))


def test_internal_poles_are_zeros_of_the_transfer_matrix(three):
    """There the inputs can move the rig while the output rests."""
    q, reduced = three.statics(np.array([0.09, 0.0]))
    found = internal_poles(three, q, reduced)
    assert len(found) == 8
    space = three.model.linearize(three.model.start()._replace(q=q), three.tendons.tension(reduced))
    c = np.hstack([differences(lambda x: output(three, x[None])[0], q, 1e-6), np.zeros((2, 6))])
    b = space.b @ three.tendons.spread

    def smallest_gain(s):
        return np.linalg.svd(c @ np.linalg.solve(s * np.eye(12) - space.a, b))[1][-1]

    for s in found:
        assert smallest_gain(s) < 1e-4 * smallest_gain(1.1 * s)


@pytest.mark.parametrize("pieces", [2, 3])
def test_the_rigs_damping_makes_the_internal_dynamics_stable_up_to_130_mm(pieces):
    for radius in (0.0, 0.05, 0.09, 0.12, 0.13):
        assert poles(pieces, radius).real.max() < -20
    assert poles(pieces, 0.14).real.max() > 50


def test_without_damping_far_bends_are_not_minimum_phase():
    """Up to there two undamped oscillations; then they meet and one of them grows."""
    near, far, beyond = (poles(3, radius, 0.0).real.max() for radius in (0.0, 0.09, 0.12))
    assert max(near, far) < 1e-6 and beyond > 5


def test_out_of_reach_is_refused_with_the_time(three):
    run = LapCircle(radius=0.2, approach=1.0)
    with pytest.raises(InversionError, match="take smaller steps or a reference in reach") as error:
        plan(three, run, np.linspace(0, 1.2, 61))
    assert 0.3 < error.value.time < 1.0
    with pytest.raises(InversionError, match="cannot be held"):
        three.statics(np.array([0.0, 0.2]))


@pytest.mark.parametrize("rate", [1e100, np.inf, np.nan])
def test_rates_that_no_rig_has_are_refused(three, rate):
    """The matrix of Newton's method overflows."""
    here = np.array([0.05, 0.0])
    progress = three.start(here)
    with pytest.raises(InversionError, match="Newton's iteration failed"):
        three.step(progress._replace(v=progress.v + rate), 1 / RATE, here, np.zeros(2))
    held = hold(three.data, here, three.model.rest() + rate, np.zeros(2))
    assert not held


def test_a_velocity_on_whose_way_the_matrix_is_singular_is_refused(one):
    place = np.array([0.05793314649197409, -0.08145090489532386])
    velocity = np.array([-31771.267735722904, -66865.51457666243])
    with pytest.raises(InversionError, match="Newton's iteration failed"):
        one.step(one.start(place), 0.02927777766172623, place, velocity)


def test_robots_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="needs a head"):
        FlexibleServoConstraints(replace(RIG, head=None), 2)
    short = tuple(replace(tendon, end=0.12) for tendon in RIG.tendons)
    with pytest.raises(ValueError, match=r"must end at its tip, at 0\.18 m, got ends 0\.12"):
        FlexibleServoConstraints(replace(RIG, tendons=short), 2)
