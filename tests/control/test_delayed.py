"""Policies that make up for a known delay of their actions."""

import gymnasium
import numpy as np
import pytest

from softrobot_env.control.base import Controller
from softrobot_env.control.delayed import DelayCompensation
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import play
from softrobot_env.robots import ARM, find_robot

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


def test_a_policy_that_is_no_controller_is_refused():
    with pytest.raises(ValueError, match="object is no"):
        DelayCompensation(object(), ARM, 0.01, DELAY)


@pytest.mark.parametrize(
    ("policy", "robot", "options", "message"),
    [
        ("lq_preview", ARM, {"delay": 0.0205}, "multiple of 0.001 s"),
        ("lq_preview", ARM, {"delay": -0.02}, "delay"),
        ("lq_preview", ARM, {"delay": 0.02, "feedback": "output"}, "only with feedback 'state'"),
        ("chain_dynamics", ARM, {"delay": 0.02}, "reads reference_acceleration"),
        ("hold", ARM, {"delay": 0.02}, "follows no reference"),
        ("rig_nn", "rig", {"delay": 0.02}, "must be driven by tension"),
    ],
)
def test_what_cannot_be_predicted_is_refused(policy, robot, options, message):
    robot = find_robot(robot)
    period = policy_environment(policy, robot).get("control_period", 0.01)
    with pytest.raises(ValueError, match=message):
        make_policy(policy, robot, period, **options)
