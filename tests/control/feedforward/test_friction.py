"""Inverse dynamics that know how tendons rub, on a robot whose tendons do."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.robots import Drive, read_robot

FINGER = read_robot(Path(__file__).parents[3] / "assets" / "robots" / "planar_finger.toml")
SEEN = ("reference", "reference_velocity", "reference_acceleration", "tip_position")


def rubbing(coefficient, drive):
    """The finger, driven by tension or by length."""
    more = {} if drive == "tension" else {"stiffness": 2e3, "pretension": 0.5}
    tendons = (replace(t, friction_coefficient=coefficient, **more) for t in FINGER.tendons)
    return replace(FINGER, tendons=tuple(tendons), drive=Drive(drive))


def missed(robot, nominal, task):
    """Mean distance [m] from the reference in two seconds."""
    env = gymnasium.make(
        "SoftRobot/Track-v0", robot=robot, task=task, observe=(*SEEN, "previous_action")
    )
    policy = make_policy("chain_dynamics", nominal, env.unwrapped.control_period)
    (observation, _), state, errors = env.reset(seed=0), None, []
    for _ in range(200):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
        errors.append(np.linalg.norm(observation["tip_position"] - observation["reference"]))
    return np.mean(errors)


@pytest.mark.parametrize("task", ["circle", "random"])
@pytest.mark.parametrize("drive", ["tension", "length"])
def test_inverse_dynamics_make_up_for_friction_along_tendons(drive, task):
    robot = rubbing(0.15, drive)
    knows, does_not = (missed(robot, rubbing(mu, drive), task) for mu in (0.15, 0.0))
    assert knows < 0.5 * does_not
