"""Robots described by files in the one environment: single, many at once, drawn, checked."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.example_robots import SOME

from softrobot_env.core.files import assets_dir
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import Base, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.twin import Twin
from softrobot_env.tasks import make_task

ID = "SoftRobot/Track-v0"


def file_of(name):
    return str(assets_dir() / "robots" / f"{name}.toml")


def actions_of(env, count, size=0.2, seed=0):
    rng = np.random.default_rng(seed)
    return size * rng.uniform(-1, 1, (count, *env.action_space.shape))


@pytest.mark.parametrize("name", SOME)
def test_episodes_of_a_file_start_in_equilibrium_on_the_reference(name):
    """Held there by the start's inputs, the robot stays."""
    env = gymnasium.make(ID, robot=file_of(name), task="circle", observe="all").unwrapped
    assert env.task.robot == find_robot(name)
    _, info = env.reset(seed=0)
    assert info["error"] < 1e-6 * env.task.robot.reach
    action = np.array(env.task.start_input) - robot_inputs(env.task.robot).input_centre
    start = env.reset()[0]["tip_position"]
    for _ in range(20):
        observation, *_ = env.step(action / env.input_scale)
        assert env.observation_space.contains(observation)
    assert_allclose(observation["tip_position"], start, atol=1e-6 * env.task.robot.reach)
    assert len(start) == (2 if env.task.robot.is_planar else 3)


# ---------------------------------------------------------------- other robots, and refusals


def test_a_planar_robot_in_a_turned_plane_is_seen_in_space():
    """It moves as the same robot in the x-z plane, turned."""
    upright = find_robot("planar_finger")
    turned = replace(upright, name="turned", base=Base(roll=np.pi / 3))
    envs = [TrackingEnv("circle", robot=robot) for robot in (upright, turned)]
    tips = []
    for env in envs:
        env.reset(seed=0)
        for row in actions_of(env, 10):
            observation, *_ = env.step(row)
        tips.append(observation["tip_position"])
    (x, z), seen = tips
    assert_allclose(seen, [x * np.cos(np.pi / 3), x * np.sin(np.pi / 3), z], atol=1e-9)


def test_a_finger_with_one_tendon_is_pulled_from_nothing_to_its_limit():
    finger = find_robot("planar_finger")
    one = replace(finger, name="one", tendons=finger.tendons[-2:-1])
    env = TrackingEnv("reach", robot=one, observe="all")
    env.reset(seed=0)
    for action, tension in ((-1.0, 0.0), (0.0, 5.0), (1.0, 10.0)):
        observation, *_ = env.step(np.array([action]))
        assert_allclose(observation["tendon_tension"], tension, atol=1e-12)
    with pytest.raises(ValueError, match="moves on a line: task 'reach' works"):
        make_task("circle", robot=one)


def test_a_built_rod_with_errors_is_a_twin_of_its_own():
    """Any robot driven by length has servos, and a camera in all its coordinates."""
    rod = find_robot("silicone_rod")
    built = Twin(
        robot=rod.vary(youngs_modulus=0.9),
        servo_speed=0.05,
        servo_offset=(1e-3, 0.0, 0.0),
        backlash=(2e-4,) * 3,
        camera_noise=1e-3,
        camera_delay=0.02,
    )
    env = TrackingEnv("circle", robot=rod, twin=built, observe="all")
    _, info = env.reset(seed=0)
    assert info["error"] > 1e-3  # softer, and its servo pulls in 1 mm too much
    observation, *_, info = env.step(np.zeros(3))
    assert info["tip_position"].shape == observation["tip_position"].shape == (3,)
    assert np.abs(info["tip_position"] - observation["tip_position"]).max() > 1e-5
    assert_allclose(np.abs(info["tendon_length"] - observation["tendon_length"]).max(), 1e-3, 0.2)
