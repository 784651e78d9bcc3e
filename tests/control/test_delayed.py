"""Policies that make up for a known delay of their actions."""

import gymnasium
import numpy as np
import pytest

from softrobot_env.control.base import Controller
from softrobot_env.control.delayed import DelayCompensation
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import play
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots import ARM, find_robot
from softrobot_env.tasks import make_task

DELAY = 0.02


class Waves(Controller):
    """Moves gently whatever it sees, and keeps what it was shown."""

    requires = ("curvature", "curvature_rate", "tip_position", "reference", "previous_action")

    def __init__(self, size):
        self.size, self.shown = size, []

    def start(self, observation):
        return 0

    def act(self, observation, state):
        self.shown.append(observation)
        phase = 0.15 * state + np.arange(self.size)
        return 0.2 * np.sin(phase) * min(1, state / 50), state + 1


def track(robot, period, **options):
    options = {"control_period": period, "observe": "all"} | options
    return gymnasium.make("SoftRobot/Track-v0", robot=robot, **options).unwrapped


@pytest.mark.parametrize("name", ["arm", "planar_finger", "hanging_trunk"])
def test_what_is_shown_is_the_robot_when_the_action_arrives(name):
    robot, period, late = find_robot(name), 0.005, 4
    env = track(robot, period, preview=(DELAY, 0.1))
    waves = Waves(env.action_space.shape[0])
    policy = DelayCompensation(waves, robot, period, DELAY)
    moments = list(play(env, policy, 0, {"vary": {"delay": DELAY}, "duration": 2.0}))
    seen = [moment.observation for moment in moments]
    for key in ("curvature", "curvature_rate", "tip_position", "reference"):
        shown = np.array([one[key] for one in waves.shown])[100:-late]
        true = np.array([one[key] for one in seen])[100:][: len(shown) + late]
        now, then = true[: len(shown)], true[late:][: len(shown)]
        way = np.abs(then - now).max()
        assert np.abs(shown - then).max() < 0.15 * way if way else np.all(shown == then), key


def test_velocity_and_acceleration_are_shown_as_they_are_when_the_action_arrives():
    seen = {}
    for lead in (0.0, DELAY):
        env = gymnasium.make("SoftRobot/ArmSwing-v0", observe="all", lead=lead)
        waves = Waves(env.action_space.shape[0])
        moments = play(env, waves, 0, {"duration": 0.5})
        seen[lead] = [moment.observation for moment in moments]
    for key in ("reference_velocity", "reference_acceleration"):
        now, led = ([one[key] for one in seen[lead]] for lead in (0.0, DELAY))
        assert np.any(led[0] != now[0]) or np.any(led[10] != now[10])
        assert np.allclose(led[:-2], now[2:], atol=1e-6)
    with pytest.raises(ValueError, match="lead must be 0 with vectors"):
        gymnasium.make("SoftRobot/ArmSwing-v0", observe_as="vector", lead=DELAY)


class Wound(Waves):
    """The same for tendons that servos wind up, all of them taut."""

    requires = (*Waves.requires[:3], "tendon_length", *Waves.requires[3:])

    def act(self, observation, state):
        action, state = super().act(observation, state)
        return 0.1 * (1 - np.exp(-state / 50)) + 0.1 * action, state


@pytest.mark.parametrize("name", ["ftdcr_v4", "rig"])
def test_tendons_wound_up_by_servos_are_shown_as_they_then_are(name):
    robot, period, late = find_robot(name), 0.005, 4
    env = track(robot, period, preview=(DELAY,))
    wound = Wound(env.action_space.shape[0])
    policy = DelayCompensation(wound, robot, period, DELAY)
    moments = list(play(env, policy, 0, {"vary": {"delay": DELAY}, "duration": 1.0}))
    shown = np.array([one["tendon_length"] for one in wound.shown])[:-late]
    true = np.array([one.observation["tendon_length"] for one in moments])
    assert np.abs(true[late:] - true[:-late]).max() > 1e-4
    assert np.allclose(shown, true[late : late + len(shown)], atol=1e-9)


def error_of(task, policy, delay, known, kind="e_max", **options):
    """Error [mm] of an episode."""
    robot = options.pop("robot", None)
    variation = {"delay": delay} if delay else {}
    case = Case(make_task(task, robot=robot), policy, variation, delay=known, **options)
    return 1e3 * getattr(run(case).row(), kind)


@pytest.mark.parametrize("policy", ["hybrid", "rig_nn_pi"])
def test_a_rig_that_sees_its_tip_late_too_goes_on_as_if_nothing_were_late(policy):
    options = {"kind": "e_rms", "twin": 0}
    best = error_of("triangle", policy, 0.0, 0.0, **options)
    assert error_of("triangle", policy, 0.04, 0.0, **options) > 1.4 * best
    assert error_of("triangle", policy, 0.04, 0.04, **options) < 1.05 * best


def test_a_plan_on_a_learned_model_knows_what_is_under_way():
    options = {"twin": 0, "duration": 4.0}
    best = error_of("triangle", "ssm_mpc", 0.0, 0.0, **options)
    assert error_of("triangle", "ssm_mpc", 0.04, 0.04, **options) < 1.2 * best
    with pytest.raises(ValueError, match="action_delay: must be a multiple"):
        make_policy("ssm_mpc", find_robot("rig"), 0.001, delay=0.003)


@pytest.mark.parametrize("name", ["ftdcr_v4", "hanging_trunk"])
def test_feedback_of_any_robot_knows_how_late_it_sees_the_tip(name):
    options = {"robot": find_robot(name), "duration": 4.0}
    best = error_of("circle", "feedforward_pi", 0.0, 0.0, **options)
    assert error_of("circle", "feedforward_pi", DELAY, 0.0, **options) > 3 * best
    known = error_of("circle", "feedforward_pi", DELAY, DELAY, **options)
    assert known < 2.5 * best  # its gains are lower


@pytest.mark.parametrize(("policy", "most"), [("imitation", 3.0), ("ppo_randomized", 4.0)])
def test_networks_stand_a_known_delay(policy, most):
    assert error_of("swing", policy, DELAY, DELAY) < most
    assert error_of("swing", policy, DELAY, 0.0) > 1.5 * most


@pytest.mark.parametrize("policy", ["lq_preview", "lqi"])
@pytest.mark.parametrize(("modulus", "most"), [(1.0, 3.0), (0.75, 10.0), (1.5, 10.0)])
def test_a_known_delay_costs_little(policy, modulus, most):
    errors = {}
    for known in (DELAY, 0.0):
        needed = policy_environment(policy, ARM, known)
        env = gymnasium.make("SoftRobot/ArmSwing-v0", observe="all", **needed)
        made = make_policy(policy, env, delay=known)
        vary = {"delay": DELAY, "youngs_modulus": modulus}
        moments = play(env, made, 0, {"vary": vary, "duration": 4.0})
        errors[known] = 1e3 * max(moment.info["error"] for moment in moments)
    if policy == "lq_preview":
        assert errors[DELAY] < most and errors[0.0] > 2 * errors[DELAY]
    else:
        assert errors[DELAY] < 15


def test_a_policy_that_reads_what_is_not_predicted_is_refused():
    waves = Waves(3)
    waves.requires = (*waves.requires, "tendon_length")
    with pytest.raises(ValueError, match="Waves reads tendon_length, which are not predicted"):
        DelayCompensation(waves, ARM, 0.01, DELAY)


def test_a_policy_that_is_no_controller_is_refused():
    with pytest.raises(ValueError, match="object is no"):
        DelayCompensation(object(), ARM, 0.01, DELAY)


@pytest.mark.parametrize(
    ("policy", "robot", "options", "message"),
    [
        ("lq_preview", ARM, {"delay": 0.0205}, "multiple of 0.001 s"),
        ("lq_preview", ARM, {"delay": -0.02}, "delay"),
        ("lq_preview", ARM, {"delay": 0.02, "feedback": "output"}, "only with feedback 'state'"),
        ("hold", ARM, {"delay": 0.02}, "follows no reference"),
        ("rig_nn", "rig", {"delay": 0.03}, "multiple of 0.02 s"),
    ],
)
def test_what_cannot_be_predicted_is_refused(policy, robot, options, message):
    robot = find_robot(robot)
    usual = 0.02 if robot.name == "rig" else 0.01
    period = policy_environment(policy, robot).get("control_period", usual)
    with pytest.raises(ValueError, match=message):
        make_policy(policy, robot, period, **options)
