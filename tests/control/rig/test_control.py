"""The rig's feedforward controllers: their parts, bad observations, how well they track."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.servo_law import ServoLaw

from softrobot_env.control.feedforward.motion import Motion
from softrobot_env.control.registry import RIG_POLICIES, home_robot, make_policy
from softrobot_env.identification.visits import nominal_lengths
from softrobot_env.robots import RIG, SERVO_SPEED
from softrobot_env.thesis.rig.feedforward import LENGTH_SCALE, RigFeedforward
from softrobot_env.thesis.rig.inverse import TOTAL, OnePiece, SeveralPieces
from softrobot_env.thesis.rig.parameters import IdentifiedParameters
from softrobot_env.thesis.rig.policies import make_hybrid
from softrobot_env.thesis.trajectories import RoundedTriangle

PERIOD = 0.02
FAST = RoundedTriangle(period=1.0, approach=0.0)


def motions(trajectory, times):
    parts = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    return [Motion(*(x[:2] for x in row)) for row in zip(*(f(times) for f in parts), strict=True)]


def observation(motion, previous=None):
    names = ("reference", "reference_velocity", "reference_acceleration")
    seen = dict(zip(names, motion, strict=True))
    return seen | {"previous_action": np.zeros(3) if previous is None else previous}


def follow(policy, wanted):
    """Lengths (k, 3) [m] and states for motions."""
    state, action, lengths, states = None, None, [], []
    for motion in wanted:
        action, state = policy.predict(observation(motion, action), state)
        lengths.append(LENGTH_SCALE * action)
        states.append(state)
    return np.array(lengths), states


def settled(policy, motion, state=None):
    """Action and state for a motion, the action in force being the same already."""
    wanted, _ = policy.predict(observation(motion), state)
    return policy.predict(observation(motion, wanted), state)


# ---------------------------------------------------------------- parts


def test_a_motion_of_constant_jerk_goes_on_exactly():
    cubic = np.array([[0.3, -0.2, 0.5, 0.7], [0.1, 0.4, -0.6, 0.2]])
    at = [np.polynomial.Polynomial(c) for c in cubic]

    def motion(t):
        return Motion(*(np.array([p.deriv(k)(t) if k else p(t) for p in at]) for k in range(3)))

    jerk = np.array([p.deriv(3)(0.0) for p in at])
    for mine, truth in zip(motion(0.1).after(0.25, jerk), motion(0.35), strict=True):
        np.testing.assert_allclose(mine, truth, atol=1e-14)


def test_the_dynamic_part_vanishes_at_rest():
    still = Motion(np.array([0.06, -0.05]), np.zeros(2), np.zeros(2))
    for model in (OnePiece(RIG), SeveralPieces(RIG)):
        memory = None
        for _ in range(3):
            pull, memory = model.step(memory, still, still, PERIOD)
            assert np.max(np.abs(pull.dynamic)) < 1e-9
    alone = OnePiece(RIG).step(None, still, still, PERIOD)[0].total
    np.testing.assert_allclose(alone, nominal_lengths(RIG, still.position[None], TOTAL)[0])


def test_the_dae_of_one_piece_gives_the_closed_form():
    """Two ways to the same inputs: integration in time, and algebra."""
    times = np.arange(0, 3, PERIOD)
    now, then = motions(FAST, times), motions(FAST, times + PERIOD / 2)
    exact, integrated = OnePiece(RIG), SeveralPieces(RIG, pieces=1)
    one = two = None
    off, size = [], []
    for a, b in zip(now, then, strict=True):
        truth, one = exact.step(one, a, b, PERIOD)
        found, two = integrated.step(two, a, b, PERIOD)
        off.append(found.dynamic - truth.dynamic)
        size.append(truth.dynamic)
    assert np.max(np.abs(size)) > 4e-3
    assert np.max(np.abs(off)) < 0.03 * np.max(np.abs(size))


@pytest.mark.parametrize("far", [0.08, 0.0049])
def test_after_a_jump_the_model_begins_anew_at_rest(far):
    model = SeveralPieces(RIG)
    here, there = (Motion(np.array([x, 0.0]), np.zeros(2), np.zeros(2)) for x in (0.0, far))
    _, memory = model.step(None, here, here, PERIOD)
    pull, _ = model.step(memory, there, there, PERIOD)
    fresh, _ = model.step(None, there, there, PERIOD)
    np.testing.assert_allclose(pull.total, fresh.total, atol=1e-12)
    assert np.max(np.abs(pull.dynamic)) < 1e-9


@pytest.mark.parametrize("period", [0.05, 0.1])
def test_a_fast_reference_is_no_jump(period):
    """Its dynamic part is large all the time, as in closed form."""
    exact, model, memory = OnePiece(RIG), SeveralPieces(RIG), None
    for motion in motions(FAST, np.arange(0, 5, period)):
        truth, _ = exact.step(None, motion, motion, period)
        found, memory = model.step(memory, motion, motion, period)
        if np.max(np.abs(truth.dynamic)) > 3e-3:
            assert np.max(np.abs(found.dynamic)) > 1e-3


def test_a_network_that_knows_the_nominal_statics_makes_the_hybrid_the_model():
    """(5.37) without s_err and (5.36) are (5.38)."""
    known = SimpleNamespace(statics=lambda z: nominal_lengths(RIG, z[None], TOTAL)[0])
    wanted = motions(FAST, np.arange(0, 4, PERIOD))
    hybrid = RigFeedforward(RIG, PERIOD, known, OnePiece(RIG))
    model = RigFeedforward(RIG, PERIOD, None, OnePiece(RIG))
    statics = RigFeedforward(RIG, PERIOD, known)
    lengths, _ = follow(hybrid, wanted)
    np.testing.assert_allclose(lengths, follow(model, wanted)[0], atol=2e-9)
    assert np.max(np.abs(lengths - follow(statics, wanted)[0])) > 4e-3


def test_ahead_is_half_a_period_ahead():
    wanted = motions(FAST, np.arange(0, 4, PERIOD))
    later = motions(FAST, np.arange(0, 4, PERIOD) + PERIOD / 2)
    ahead, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG), ahead=True), wanted)
    truth, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG)), later)
    now, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG)), wanted)
    assert np.max(np.abs(ahead - truth)) < 0.25 * np.max(np.abs(now - truth))


@pytest.mark.parametrize("rate", [0.01, 0.05, -0.09])
def test_servos_are_on_average_where_they_should_be(rate):
    """At a steady rate, in the middle of each period, by the simulated servo."""
    play, start = 0.2e-3, -0.01 * np.sign(rate)
    known = SimpleNamespace(statics=lambda z: np.full(3, start + 10 * rate * z[0]))
    errors = {}
    for compensated in (True, False):
        policy = RigFeedforward(RIG, PERIOD, known, backlash=play / 2 if compensated else None)
        servos = ServoLaw(SERVO_SPEED, np.zeros(3), np.full(3, play))
        servos.start(np.full(3, start))
        state, fine = None, np.arange(1, 101) * PERIOD / 100
        for t in np.arange(0, 0.2, PERIOD):
            # The reference's first coordinate tells the middle of the period that follows.
            motion = Motion(np.array([0.1 * (t + PERIOD / 2), 0.0]), np.zeros(2), np.zeros(2))
            action, state = policy.predict(observation(motion), state)
            path = servos.move(LENGTH_SCALE * action.astype(float), fine)[1:]
            path = np.concatenate([path, np.tile(path[-1], (100 - len(path), 1))])
            errors[compensated] = abs(path.mean() - (start + rate * (t + PERIOD / 2)))
    assert errors[True] < 0.02e-3 < 0.1e-3 < errors[False]


# ---------------------------------------------------------------- observations and options


BOTH = pytest.mark.parametrize("name", ["inverse_dynamics", "hybrid_flexible"])
FAR = Motion(np.array([0.19, 0.0]), np.zeros(2), np.zeros(2))
BAD = Motion(np.array([np.nan, 0.0]), np.zeros(2), np.zeros(2))
PREVIOUS = np.array([0.1, -0.2, 0.3])


@BOTH
@pytest.mark.parametrize(
    ("motion", "status"), [(FAR, "reference out of reach"), (BAD, "observation not finite")]
)
def test_what_cannot_be_done_is_said(name, motion, status):
    """At the start, with nothing to go on from."""
    policy = make_policy(name, RIG, PERIOD)
    action, state = policy.predict(observation(motion, PREVIOUS), None)
    np.testing.assert_allclose(action, PREVIOUS, atol=1e-7)
    assert state.status == status
    action, state = settled(policy, motions(FAST, np.zeros(1))[0], state)
    assert state.status is None and np.all(np.isfinite(action))


@BOTH
def test_one_bad_reference_is_bridged(name):
    """On the fast laps; to begin anew at rest would cost 8 mm."""
    policy = make_policy(name, RIG, PERIOD)
    wanted = motions(FAST, np.arange(2, 4, PERIOD))
    truth, _ = follow(policy, wanted)
    wanted[50] = BAD
    found, states = follow(policy, wanted)
    assert states[50].status == "observation not finite" and states[51].status is None
    assert np.max(np.abs(found - truth)) < 1e-3


@BOTH
def test_a_reference_that_stays_away_is_given_up(name):
    policy = make_policy(name, RIG, PERIOD)
    wanted = [*motions(FAST, np.arange(2, 3, PERIOD)), *[BAD] * 20]
    _, states = follow(policy, wanted)
    assert {state.status for state in states[50:]} == {"observation not finite"}
    action, _ = policy.predict(observation(BAD, PREVIOUS), states[-1])
    np.testing.assert_allclose(action, PREVIOUS, atol=1e-7)


@BOTH
def test_the_action_in_force_matters_only_where_it_is_kept(name):
    policy = make_policy(name, RIG, PERIOD)
    there, unknown = motions(FAST, np.array([3.0]))[0], np.full(3, np.nan)
    truth, state = settled(policy, there)
    found, said = policy.predict(observation(there, unknown), None)
    np.testing.assert_array_equal(found, truth)
    assert said.status == "observation not finite"
    kept, _ = policy.predict(observation(FAR, unknown), state)
    np.testing.assert_array_equal(kept, truth)


def test_beyond_the_network_s_points_is_said():
    policy = make_policy("rig_nn", RIG, PERIOD)
    for x, status in ((0.121, None), (0.126, "outside the trained workspace")):
        still = Motion(np.array([x, 0.0]), np.zeros(2), np.zeros(2))
        assert settled(policy, still)[1].status == status


def test_parts_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="choose from one piece, several pieces, calibrated"):
        make_hybrid(RIG, PERIOD, model="two pieces")
    with pytest.raises(ValueError, match="needs identified statics, a model or both"):
        RigFeedforward(RIG, PERIOD)


@pytest.mark.parametrize("period", [0.0, -0.02, np.nan, np.inf])
def test_periods_that_are_none_are_refused(period):
    with pytest.raises(ValueError, match="control_period must be finite and positive"):
        make_policy("hybrid_calibrated", RIG, period)


def test_the_calibrated_hybrid_takes_the_play_that_was_learnt():
    known = IdentifiedParameters.load(RIG)
    wanted = motions(FAST, np.arange(2, 3, PERIOD))
    none, some = (
        follow(
            make_policy("hybrid_calibrated", RIG, PERIOD, learnt=replace(known, backlash=x)), wanted
        )[0]
        for x in (0.0, 0.3e-3)
    )
    assert np.max(np.abs(some - none)) == pytest.approx(0.3e-3, rel=1e-3)


def test_the_rig_s_policies_are_not_the_arm_s():
    assert {home_robot(name) for name in RIG_POLICIES} == {RIG}
