from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.base import Controller
from softrobot_env.control.feedforward.law import Feedforward, FeedforwardPI
from softrobot_env.control.registry import POLICIES, RIG_POLICIES, make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM, RIG
from softrobot_env.tasks import make_task

PERIOD = 0.01
STATICS = ConstantCurvatureStatics(ARM)


def observe(reference, tip=None, action=(0.06, 0.06, 0.06)):
    reference = np.asarray(reference, dtype=float)
    return {
        "reference": reference,
        "tip_position": reference if tip is None else np.asarray(tip, dtype=float),
        "previous_action": np.asarray(action, dtype=float),
    }


@pytest.mark.parametrize("target", [(0.2, 0.44), (-0.3, 0.36), (0.0, 0.5), (0.24, 0.3)])
def test_feedforward_holds_the_tip_on_the_reference(target):
    guess = (0.05, 0.05, 0.05) if target[0] >= 0 else (-0.05, -0.05, -0.05)
    action, state = Feedforward(ARM, PERIOD).predict(observe(target, action=guess), None)
    # float32 actions resolve 80 N to 5e-6 N, which moves the tip by less than a micrometre.
    np.testing.assert_allclose(STATICS.tip(80.0 * action.astype(float)), target, atol=1e-6)
    assert state.status is None


def test_feedforward_leaves_a_straight_arm_alone():
    """Where both its Jacobian's smaller singular value and the gap are exactly zero."""
    straight = observe((0.0, ARM.length), action=(0.0, 0.0, 0.0))
    action, state = Feedforward(ARM, PERIOD).predict(straight, None)
    np.testing.assert_array_equal(action, 0.0)
    assert state.status is None


@pytest.mark.parametrize("targets", [2, 20])
def test_set_points_that_come_again_are_not_solved_again(targets, monkeypatch):
    """A few of them: a path would fill the memory."""
    policy, solved = Feedforward(ARM, PERIOD), []
    hold = policy._statics.hold
    monkeypatch.setattr(
        policy._statics, "hold", lambda target, *how: solved.append(target) or hold(target, *how)
    )
    points, state, actions = [(0.2, 0.44 - 0.002 * k) for k in range(targets)], None, []
    for _ in range(2):
        for point in points:
            action, state = policy.predict(observe(point), state)
            actions.append(action)
    assert len(solved) == (targets if targets < 16 else 2 * targets)
    np.testing.assert_allclose(actions[:targets], actions[targets:], atol=1e-6)
    assert len(state.solved) == min(targets, 16)


def test_feedforward_says_when_the_reference_is_out_of_reach():
    action, state = Feedforward(ARM, PERIOD).predict(observe((0.4, 0.5)), None)
    # The arm is 0.5 m long and the reference 0.64 m away: at least 140 mm are missing.
    assert "out of reach" in state.status
    assert state.rest.error >= np.hypot(0.4, 0.5) - ARM.length
    assert np.all(np.isfinite(action)) and np.all(np.abs(action) <= 1)


def test_feedforward_says_when_tensions_saturate():
    """The L-shape's corner needs about 55 N; this arm's tendons hold 40 N."""
    tendons = tuple(replace(t, tension_limit=40.0) for t in ARM.tendons)
    policy = Feedforward(replace(ARM, tendons=tendons), PERIOD)
    action, state = policy.predict(observe((0.24, 0.30)), None)
    assert state.rest.reached
    assert state.status == "tension limit reached"
    assert np.max(np.abs(action)) == 1.0


def test_integral_rests_while_an_action_is_saturated():
    policy = FeedforwardPI(ARM, PERIOD, proportional=50.0, integral=1.0)
    observation = observe((0.2, 0.44), tip=(-0.3, 0.3))
    state = None
    for _ in range(20):
        action, state = policy.predict(observation, state)
    assert np.max(np.abs(action)) == 1.0
    assert state.status == "tension limit reached"
    np.testing.assert_array_equal(state.feedback.integral, 0.0)


def test_integral_accumulates_the_error_otherwise():
    policy = FeedforwardPI(ARM, PERIOD)
    state = None
    for _ in range(10):
        _, state = policy.predict(observe((0.2, 0.44), tip=(0.199, 0.442)), state)
    np.testing.assert_allclose(state.feedback.integral, [10 * PERIOD * 1e-3, -10 * PERIOD * 2e-3])


def test_hold_keeps_the_arm_where_it_is():
    rollout = run(Case(make_task("step"), "hold")).rollout
    assert np.ptp(rollout.tip, axis=0).max() < 1e-6


def test_feedback_removes_the_error_of_a_wrong_model():
    """A 25 % softer arm: feedforward misses the step for good, the integral brings it there."""
    wrong, learned = (
        run(Case(make_task("step"), name, {"youngs_modulus": 0.75}, duration=30.0)).rollout
        for name in ("feedforward", "feedforward_pi")
    )
    assert wrong.error[-1] > 20e-3 and learned.error[-1] < 0.2e-3


# Control periods that are long for the arm.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("task", "period"),
    [
        *(("step", period) for period in (0.05, 0.1, 0.2)),
        ("lshape", 0.2),
        *(
            pytest.param(task, period, marks=pytest.mark.slow)
            for task in ("swing", "lshape")
            for period in (0.002, 0.05, 0.1)
        ),
    ],
)
def test_feedback_is_stable_at_every_control_period(task, period):
    """Slow sampling costs accuracy, but the tip comes to rest near the reference."""
    scene = {"control_period": period}
    rollout = run(Case(make_task(task), "feedforward_pi", duration=20.0, scene=scene)).rollout
    last = rollout.error[rollout.time > 18.0]
    # An unstable loop ends at 100 mm and more; the open loop's swing has decayed to 1 mm by then.
    assert rollout.failure is None and last.max() < 5e-3


class Broken(Controller):
    """Computes NaN in its second decision; its state counts decisions."""

    requires = ("reference", "previous_action")

    def start(self, observation):
        return 0

    def act(self, observation, state):
        action = np.array([0.1, 0.2, 0.3])
        return action / 0 * 0 if state == 1 else action, state + 1


@pytest.mark.parametrize("hold", [1, 2])
@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value):RuntimeWarning")
def test_an_action_that_cannot_be_computed_is_told_as_such(hold):
    policy = Broken()
    policy.hold = hold
    seen, state = observe((0.1, 0.4), action=(0.5, 0.6, 2.0)), None
    for _ in range(hold):
        action, state = policy.predict(seen, state)
    np.testing.assert_allclose(action, [0.1, 0.2, 0.3], rtol=1e-6)
    for _ in range(3 * hold):  # its state stays at the decision before
        action, state = policy.predict(seen, state)
        np.testing.assert_allclose(action, [0.5, 0.6, 1.0], rtol=1e-6)
        assert state.status == "computation not finite"
    many = {name: np.stack([value, value]) for name, value in seen.items()}
    actions, states = policy.predict(many, [state, state], np.array([False, True]))
    assert states[0].status == "computation not finite"
    np.testing.assert_allclose(actions[1], [0.1, 0.2, 0.3], rtol=1e-6)


@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value):RuntimeWarning")
def test_an_observation_that_is_not_finite_is_blamed_by_name():
    policy = Broken()
    seen = observe((np.nan, 0.4)) | {"previous_action": np.array([np.nan, 0.5, 0.0])}
    action, state = policy.predict(seen, 1)
    np.testing.assert_allclose(action, [0.0, 0.5, 0.0])
    assert state.status == "observation not finite: reference, previous_action"


@pytest.mark.parametrize("name", ["lqi", "lq_preview"])
def test_scheduled_laws_that_compute_no_number_are_blamed_themselves(name):
    """Curvature and rate are finite, and yet too large for their product with the gains."""
    with TrackingEnv("swing", **policy_environment(name)) as env:
        observation, _ = env.reset(seed=0)
    weak = replace(ARM, tendons=tuple(replace(t, tension_limit=1.0) for t in ARM.tendons))
    policy = make_policy(name, weak, 1e-3)
    _, state = policy.predict(observation, None)
    absurd = observation | {"curvature_rate": np.full(6, 1e308)}
    action, reported = policy.predict(absurd, state)
    np.testing.assert_allclose(action, observation["previous_action"], rtol=1e-6)
    assert reported.status == "computation not finite"
    _, state = policy.predict(observation, reported)
    assert state.status != reported.status


@pytest.mark.parametrize("period", [np.nan, np.inf, 0.0, -0.01, "x", None, True], ids=str)
def test_what_is_no_control_period_or_no_robot_is_refused(period):
    for name, robot in {**dict.fromkeys(POLICIES, ARM), **dict.fromkeys(RIG_POLICIES, RIG)}.items():
        with pytest.raises(ValueError, match="control_period must be finite and positive, got"):
            make_policy(name, robot, period)
    with pytest.raises(ValueError, match="robot must be a RobotParams or an Env, got 'arm'"):
        make_policy("hold", "arm", 0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, "x", True], ids=str)
def test_gains_of_feedback_are_numbers(value):
    for gain in ("proportional", "integral"):
        with pytest.raises(ValueError, match=f"{gain} must be"):
            FeedforwardPI(ARM, PERIOD, **{gain: value})
