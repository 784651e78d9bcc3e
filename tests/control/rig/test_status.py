"""What the rig's feedforward controllers say of motions that the rig cannot do."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.flexible_plan import plan
from support.servo_law import ServoLaw

from softrobot_env.control.feedforward.motion import Motion
from softrobot_env.control.registry import make_policy
from softrobot_env.robots import LENGTH_SCALE, RIG, SERVO_SPEED
from softrobot_env.thesis.rig.feedforward import RigFeedforward
from softrobot_env.thesis.rig.inverse import TOTAL, OnePiece, SeveralPieces
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.rig.servo_flexible import FlexibleServoConstraints
from softrobot_env.thesis.rig.three_tendons import ThreeTendons
from softrobot_env.thesis.trajectories import RoundedTriangle

PERIOD = 0.02
SLACK, SLOW = "tendon would slacken", "servo too slow"
SERVO, TENDONS = ServoConstraints(RIG), ThreeTendons(RIG)


def nominal_statics(place):
    """Lengths (3,) [m] that hold the nominal rig's output at (2,) [m]."""
    y, _, _, reduced, _ = SERVO.motion(place[None], *np.zeros((2, 1, 2)))[:, 0]
    return TENDONS.pulled(TENDONS.with_total(reduced, TOTAL), SERVO.curvature(y))


KNOWN = SimpleNamespace(statics=nominal_statics)


def laps(period):
    """Times (n,) [s] and motions of triangle laps."""
    run = RoundedTriangle(period=period, approach=0.0)
    times = np.arange(0, run.end_time, PERIOD)
    columns = (f(times)[:, :2] for f in (run.position, run.velocity, run.acceleration))
    return times, [Motion(*row) for row in zip(*columns, strict=True)]


def decide(policy, motion, state=None, action=None):
    """One decision; the action in force (3,) is the one wanted unless given."""
    seen = {
        "reference": motion.position,
        "reference_velocity": motion.velocity,
        "reference_acceleration": motion.acceleration,
    }
    if action is None:
        action, _ = policy.predict(seen | {"previous_action": np.zeros(3)}, state)
    return policy.predict(seen | {"previous_action": action}, state)


def statuses(policy, wanted):
    """Of the decisions for motions, the first of them with the action wanted in force."""
    action = state = None
    found = []
    for motion in wanted:
        action, state = decide(policy, motion, state, action)
        found.append(state.status)
    return np.array(found, dtype=object)


def tensions(reduced):
    """Tensions (n, 3) [N] of reduced inputs (n, 2) [N] with the sum wanted, by three equations."""
    offsets = np.array([tendon.offset for tendon in RIG.tendons])
    lever = np.hypot(*offsets.T).mean()
    equations = np.vstack([offsets.T / lever, np.ones(3)])
    right = np.column_stack([reduced, np.full(len(reduced), TOTAL)])
    return np.linalg.solve(equations, right.T).T


def test_slack_is_said_exactly_where_a_tension_of_the_plan_is_negative():
    _, wanted = laps(0.6)
    inverse = SERVO.plan(*(np.array(part) for part in zip(*wanted, strict=True)))
    truth = tensions(inverse.reduced).min(axis=1) < 0
    assert 0.1 < truth.mean() < 0.3
    for learnt in (None, KNOWN):
        found = statuses(RigFeedforward(RIG, PERIOD, learnt, OnePiece(RIG)), wanted) == SLACK
        np.testing.assert_array_equal(found, truth)


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
    still = Motion(np.array([0.05, -0.03]), np.zeros(2), np.zeros(2))
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
    assert set(statuses(policy, laps(period)[1])) == {None}


SIDEWAYS = np.array([0.0, 20.0])  # m/s2
NOWHERE = Motion(*np.full((3, 2), np.nan))


@pytest.mark.parametrize(
    ("learnt", "x", "status"),
    [
        (SimpleNamespace(statics=lambda z: np.full(3, 0.05)), 0.126, "length limit reached"),
        (KNOWN, 0.126, "outside the trained workspace"),
        (KNOWN, 0.12, SLACK),
        (None, 0.126, SLACK),
    ],
)
def test_what_changes_the_action_is_said_first(learnt, x, status):
    """All of these are slack and too slow, too; a missing reference comes before them all."""
    policy = RigFeedforward(RIG, PERIOD, learnt, OnePiece(RIG))
    motion = Motion(np.array([x, 0.0]), np.zeros(2), SIDEWAYS)
    _, state = decide(policy, motion, None, np.full(3, -1.0))
    assert state.status == status
    _, state = decide(policy, NOWHERE, state, np.full(3, -1.0))
    assert state.status == "observation not finite"


def test_statics_without_a_model_know_no_tensions():
    found = statuses(RigFeedforward(RIG, PERIOD, KNOWN), laps(0.6)[1])
    assert SLACK not in found


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
    assert {s.status for s in states} >= {
        SLOW,
        "outside the trained workspace",
        "observation not finite",
    }
