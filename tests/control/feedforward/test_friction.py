"""Inverse dynamics that know how tendons rub, on a robot whose tendons do."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.robots import Drive, read_robot
from softrobot_env.robots.twin import with_real_drive

FILES = Path(__file__).parents[3] / "assets" / "robots"
FINGER = read_robot(FILES / "planar_finger.toml")
SEEN = ("reference", "reference_velocity", "reference_acceleration", "tip_position")


def rubbing(coefficient, drive):
    """The finger, driven by tension or by length."""
    more = {} if drive == "tension" else {"stiffness": 2e3, "pretension": 0.5}
    tendons = (replace(t, friction_coefficient=coefficient, **more) for t in FINGER.tendons)
    return replace(FINGER, tendons=tuple(tendons), drive=Drive(drive))


def missed(robot, nominal, task, since=0, name="chain_dynamics"):
    """Mean distance [m] from the reference in 200 control periods, from some on."""
    env = gymnasium.make(
        "SoftRobot/Track-v0", robot=robot, task=task, observe=(*SEEN, "previous_action")
    )
    policy = make_policy(name, nominal, env.unwrapped.control_period)
    (observation, _), state, errors = env.reset(seed=0), None, []
    for _ in range(200):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
        errors.append(np.linalg.norm(observation["tip_position"] - observation["reference"]))
    return np.mean(errors[since:])


@pytest.mark.parametrize("task", ["circle", "random"])
@pytest.mark.parametrize("drive", ["tension", "length"])
def test_inverse_dynamics_make_up_for_friction_along_tendons(drive, task):
    robot = rubbing(0.15, drive)
    knows, does_not = (missed(robot, rubbing(mu, drive), task) for mu in (0.15, 0.0))
    assert knows < 0.5 * does_not


@pytest.mark.parametrize("name", ["silicone_rod", "ftdcr_v4"])
def test_inverse_dynamics_make_up_for_servos_that_give_way_lag_and_wait(name):
    robot = read_robot(FILES / f"{name}.toml")
    real = with_real_drive(robot)
    assert missed(real, real, "circle") < 0.2 * missed(real, robot, "circle")


# What the integrator may be off by is a twentieth of what the finger misses.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_a_finger_that_rubs_gets_near_where_it_should_rest():
    robot = read_robot(FILES / "gripper_finger.toml")
    rubbing = with_real_drive(robot)
    knows, does_not = (missed(rubbing, one, "reach", since=150) for one in (rubbing, robot))
    assert knows < 0.4 * does_not


def test_feedback_by_servos_that_lag_and_wait_is_about_as_good_as_none():
    real = with_real_drive(read_robot(FILES / "silicone_rod.toml"))
    fed_back, not_so = (
        missed(real, real, "circle", name=name) for name in ("chain_dynamics_pi", "chain_dynamics")
    )
    assert fed_back < 1.5 * not_so


def test_servos_that_are_asked_for_more_force_than_they_have_are_said():
    robot = with_real_drive(read_robot(FILES / "silicone_rod.toml"))
    weak = replace(robot, drive=replace(robot.drive, force_limit=1.0))
    env = gymnasium.make(
        "SoftRobot/Track-v0", robot=weak, task="circle", observe=(*SEEN, "previous_action")
    )
    policy = make_policy("chain_dynamics", weak, env.unwrapped.control_period)
    (observation, _), state, said = env.reset(seed=0), None, set()
    for _ in range(100):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
        said.add(state.status)
    assert "force limit of a servo reached" in said
