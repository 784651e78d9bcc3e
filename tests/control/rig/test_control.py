"""The rig's feedforward controllers: their parts, bad observations, how well they track."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.flexible_plan import plan
from support.servo_law import ServoLaw

from softrobot_env.control.feedforward.motion import Motion
from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.identification.visits import nominal_lengths
from softrobot_env.robots import LENGTH_SCALE, RIG, SERVO_SPEED
from softrobot_env.tasks import make_task
from softrobot_env.thesis.rig.feedforward import RigFeedforward
from softrobot_env.thesis.rig.inverse import TOTAL, OnePiece, SeveralPieces
from softrobot_env.thesis.rig.parameters import IdentifiedParameters
from softrobot_env.thesis.rig.policies import make_hybrid
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.rig.servo_flexible import FlexibleServoConstraints
from softrobot_env.thesis.trajectories import RoundedTriangle
from studies.truths import rig_piece

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
    """Lengths (k, 3) [m] and states for motions, the first with the action wanted in force."""
    state, action, lengths, states = None, None, [], []
    for motion in wanted:
        action, state = decide(policy, motion, state, action)
        lengths.append(LENGTH_SCALE * action)
        states.append(state)
    return np.array(lengths), states


def at(x, y=0.0):
    """At rest at a place [m]."""
    return Motion(np.array([x, y]), np.zeros(2), np.zeros(2))


def decide(policy, motion, state=None, action=None):
    """One decision; the action in force (3,) is the one wanted unless given."""
    if action is None:
        action, _ = policy.predict(observation(motion), state)
    return policy.predict(observation(motion, action), state)


SERVO = ServoConstraints(RIG)
#: Networks that know the nominal statics.
KNOWN = SimpleNamespace(statics=lambda z: nominal_lengths(RIG, z[None], TOTAL)[0])


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
    still = at(0.06, -0.05)
    for model in (OnePiece(RIG), SeveralPieces(RIG)):
        memory = None
        for _ in range(3):
            pull, memory = model.step(memory, still, still, PERIOD)
            assert np.max(np.abs(pull.dynamic)) < 1e-9
    alone = OnePiece(RIG).step(None, still, still, PERIOD)[0].total
    np.testing.assert_allclose(alone, nominal_lengths(RIG, still.position[None], TOTAL)[0])


@pytest.mark.parametrize("far", [0.08, 0.0049])
def test_after_a_jump_the_model_begins_anew_at_rest(far):
    model = SeveralPieces(RIG)
    here, there = at(0.0), at(far)
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
    wanted = motions(FAST, np.arange(0, 4, PERIOD))
    hybrid = RigFeedforward(RIG, PERIOD, KNOWN, OnePiece(RIG))
    model = RigFeedforward(RIG, PERIOD, None, OnePiece(RIG))
    statics = RigFeedforward(RIG, PERIOD, KNOWN)
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
    backlash, start = 0.2e-3, -0.01 * np.sign(rate)
    known = SimpleNamespace(statics=lambda z: np.full(3, start + 10 * rate * z[0]))
    errors = {}
    for compensated in (True, False):
        policy = RigFeedforward(RIG, PERIOD, known, backlash=backlash / 2 if compensated else None)
        servos = ServoLaw(SERVO_SPEED, np.zeros(3), np.full(3, backlash))
        servos.start(np.full(3, start))
        state, fine = None, np.arange(1, 101) * PERIOD / 100
        for t in np.arange(0, 0.2, PERIOD):
            # The reference's first coordinate tells the middle of the period that follows.
            action, state = policy.predict(observation(at(0.1 * (t + PERIOD / 2))), state)
            path = servos.move(LENGTH_SCALE * action.astype(float), fine)[1:]
            path = np.concatenate([path, np.tile(path[-1], (100 - len(path), 1))])
            errors[compensated] = abs(path.mean() - (start + rate * (t + PERIOD / 2)))
    assert errors[True] < 0.02e-3 < 0.1e-3 < errors[False]


# ---------------------------------------------------------------- observations and options


BOTH = pytest.mark.parametrize("name", ["inverse_dynamics", "hybrid_flexible"])
BAD = at(np.nan)
PREVIOUS = np.array([0.1, -0.2, 0.3])


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
    truth, state = decide(policy, there)
    found, said = policy.predict(observation(there, unknown), None)
    np.testing.assert_array_equal(found, truth)
    assert said.status == "observation not finite"
    kept, _ = policy.predict(observation(at(0.19), unknown), state)
    np.testing.assert_array_equal(kept, truth)


def test_beyond_the_network_s_points_is_said():
    policy = make_policy("rig_nn", RIG, PERIOD)
    for x, status in ((0.121, None), (0.126, "outside the trained workspace")):
        assert decide(policy, at(x))[1].status == status


def test_an_option_by_its_earlier_name_warns():
    with (
        pytest.warns(DeprecationWarning, match="'learnt' of policies is 'identified' now"),
        pytest.raises(FileNotFoundError, match=r"no\.npz"),
    ):
        make_policy("rig_nn", RIG, PERIOD, learnt="no.npz")
    with pytest.raises(ValueError, match="give 'identified' alone"):
        make_policy("rig_nn", RIG, PERIOD, learnt="no.npz", identified="no.npz")


def test_parts_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="choose from one piece, several pieces, calibrated"):
        make_hybrid(RIG, PERIOD, model="two pieces")
    with pytest.raises(ValueError, match="needs identified statics, a model or both"):
        RigFeedforward(RIG, PERIOD)


def test_the_calibrated_hybrid_takes_the_backlash_that_was_identified():
    known = IdentifiedParameters.load(RIG)
    wanted = motions(FAST, np.arange(2, 3, PERIOD))
    none, some = (
        follow(
            make_policy("hybrid_calibrated", RIG, PERIOD, identified=replace(known, backlash=x)),
            wanted,
        )[0]
        for x in (0.0, 0.3e-3)
    )
    assert np.max(np.abs(some - none)) == pytest.approx(0.3e-3, rel=1e-3)


SLACK, SLOW = "tendon would slacken", "servo too slow"


def laps(period, laps=3):
    """Times (n,) [s] and motions of triangle laps, and of what leads to them and away."""
    run = RoundedTriangle(period=period, approach=0.0, laps=laps)
    times = np.arange(0, run.end_time, PERIOD)
    return times, motions(run, times)


def statuses(policy, wanted):
    """Of the decisions for motions."""
    return np.array([state.status for state in follow(policy, wanted)[1]], dtype=object)


def tensions(reduced):
    """Tensions (n, 3) [N] of reduced inputs (n, 2) [N] with the sum wanted, by three equations."""
    offsets = RIG.of_tendons("offset")
    moment_arm = np.hypot(*offsets.T).mean()
    equations = np.vstack([offsets.T / moment_arm, np.ones(3)])
    right = np.column_stack([reduced, np.full(len(reduced), TOTAL)])
    return np.linalg.solve(equations, right.T).T


def test_slack_is_said_exactly_where_a_tension_of_the_plan_is_negative():
    """Statics without a model know no tensions."""
    _, wanted = laps(0.6)
    inverse = rig_piece.plan(SERVO, *(np.array(part) for part in zip(*wanted, strict=True)))
    truth = tensions(inverse.reduced).min(axis=1) < 0
    assert 0.1 < truth.mean() < 0.3
    for identified in (None, KNOWN):
        found = statuses(RigFeedforward(RIG, PERIOD, identified, OnePiece(RIG)), wanted) == SLACK
        np.testing.assert_array_equal(found, truth)
    assert SLACK not in statuses(RigFeedforward(RIG, PERIOD, KNOWN), wanted)


def test_slack_is_said_of_several_pieces_as_well():
    """As a plan with small steps has it, but where it is close."""
    times, wanted = laps(0.6)
    run = RoundedTriangle(period=0.6, approach=0.0)
    found = plan(FlexibleServoConstraints(RIG, pieces=3), run, times, substeps=8)
    least = tensions(found.reduced).min(axis=1)
    found = statuses(RigFeedforward(RIG, PERIOD, None, SeveralPieces(RIG, pieces=3)), wanted)
    clear = np.abs(least) > 1.0
    assert clear.mean() > 0.8 and np.sum(least < -1.0) > 20
    np.testing.assert_array_equal((found == SLACK)[clear], least[clear] < 0)


@pytest.mark.parametrize("period", [0.02, 0.005])
def test_a_servo_is_too_slow_where_it_does_not_arrive_in_time(period):
    """By the simulated servos."""
    rng = np.random.default_rng(0)
    policy = RigFeedforward(RIG, period, None, OnePiece(RIG))
    still = at(0.05, -0.03)
    wanted, _ = decide(policy, still)
    seen = set()
    for _ in range(100):
        way = rng.uniform(-1.3, 1.3, 3) * SERVO_SPEED * period
        before = wanted - way / LENGTH_SCALE
        action, state = decide(policy, still, None, before)
        servos = ServoLaw(SERVO_SPEED, np.zeros(3), np.zeros(3))
        servos.start(LENGTH_SCALE * before)
        servos.move(LENGTH_SCALE * action.astype(float), np.array([period]))
        late = np.abs(servos.motor - LENGTH_SCALE * action).max() > 1e-8
        assert state.status == (SLOW if late else None)
        seen.add(state.status)
    assert seen == {SLOW, None}


@pytest.mark.parametrize("period", [5.0, 1.0])
@pytest.mark.parametrize("model", [None, OnePiece, SeveralPieces])
def test_nothing_is_said_of_laps_that_can_be_done(period, model):
    policy = RigFeedforward(RIG, PERIOD, KNOWN, model and model(RIG), ahead=True, backlash=1e-4)
    assert set(statuses(policy, laps(period, 0)[1])) == {None}


SIDEWAYS = np.array([0.0, 20.0])  # m/s2


@pytest.mark.parametrize(
    ("identified", "x", "status"),
    [
        (SimpleNamespace(statics=lambda z: np.full(3, 0.05)), 0.126, "length limit reached"),
        (KNOWN, 0.126, "outside the trained workspace"),
        (KNOWN, 0.12, SLACK),
        (None, 0.126, SLACK),
    ],
)
def test_what_changes_the_action_is_said_first(identified, x, status):
    """All of these are slack and too slow, too; a missing reference comes before them all."""
    policy = RigFeedforward(RIG, PERIOD, identified, OnePiece(RIG))
    motion = Motion(np.array([x, 0.0]), np.zeros(2), SIDEWAYS)
    _, state = decide(policy, motion, None, np.full(3, -1.0))
    assert state.status == status
    _, state = decide(policy, BAD, state, np.full(3, -1.0))
    assert state.status == "observation not finite"


def test_stacked_decisions_of_the_network_are_those_of_one_after_the_other(monkeypatch):
    """In reach and out of it, slow and too fast, and some that are not finite; twice in a row."""
    policy, rng = make_policy("rig_nn", RIG, PERIOD), np.random.default_rng(0)
    size = {name: 0.2 * rng.uniform(-1, 1, (60, policy.sizes[name])) for name in policy.requires}
    size["previous_action"] *= 5
    size["reference"][3], size["previous_action"][5, 1] = np.nan, np.inf
    calls, batch = [], type(policy._network).batch

    def counted(network, places):
        calls.append(len(places))
        return batch(network, places)

    monkeypatch.setattr(type(policy._network), "batch", counted)
    states, alone = None, [None] * 60
    for _ in range(2):
        actions, states = policy.predict(size, states)
        for i in range(60):
            action, alone[i] = policy.predict({n: v[i] for n, v in size.items()}, alone[i])
            np.testing.assert_array_equal(actions[i], action)
            assert states[i].status == alone[i].status
    assert calls == [58, 58]
    said = {state.status for state in states}
    assert said >= {SLOW, "outside the trained workspace", "observation not finite"}


def errors(policy, period, twin=0, **known):
    """Error [m] after the approach."""
    task = make_task("triangle", period=period)
    rollout = run(Case(task, policy, twin=twin, given=known)).rollout
    # The first command is one to a sum of tensions that the rig does not begin with.
    assert rollout.failure is None and rollout.policy_status[0] == "servo too slow"
    assert set(rollout.policy_status[1:]) == {""}
    return rollout.error[rollout.time > task.trajectory.approach]


@pytest.fixture(scope="module")
def parts():
    """Mean errors [m] of the network alone and of the model alone."""
    return [errors(policy, 5.0).mean() for policy in ("rig_nn", "inverse_dynamics")]


@pytest.mark.parametrize("policy", ["hybrid", "hybrid_flexible"])
def test_the_hybrid_is_better_than_its_parts(parts, policy):
    """The thesis has 2.9 mm in the mean and 8.9 mm at most, 4.5 and 12.5 mm for the parts.

    Half of the dynamic part would leave 3 mm or more, another sign or a turn of the network by 0.12
    rad 8 mm or more.
    """
    network, model = parts
    error = errors(policy, 5.0)
    assert error.mean() < 3.5e-3 and error.max() < 8.9e-3
    assert error.mean() < 0.55 * network and error.mean() < 0.2 * model


def test_the_rig_without_errors_is_the_one_that_the_model_describes():
    assert errors("inverse_dynamics", 5.0, twin=None).mean() < 2e-3


def test_fast_laps_need_the_dynamics_and_their_damping():
    """The thesis has 8.6 mm with both parts, 35.9 mm with the network alone."""
    identified = IdentifiedParameters.load(RIG)
    assert errors("rig_nn", 1.0).mean() > 20e-3
    assert errors("hybrid_calibrated", 1.0).mean() < 4e-3
    light = replace(identified, damping=0.8 * identified.damping)
    assert errors("hybrid_calibrated", 1.0, identified=light).mean() > 5e-3


@pytest.mark.slow
def test_feedback_learns_another_stiffness():
    """A tenth of the error is left, although the camera sees the tip a period late."""
    task = make_task("triangle", period=5.0)
    wrong, learned = (
        run(Case(task, name, {"youngs_modulus": 0.75}, twin=0)).rollout
        for name in ("hybrid_calibrated", "hybrid_feedback")
    )
    late = wrong.time > task.trajectory.approach
    assert learned.failure is None
    assert learned.error[late].mean() < 0.1 * wrong.error[late].mean()
