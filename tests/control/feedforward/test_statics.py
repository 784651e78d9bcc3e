"""Static feedforward of any robot: it holds what it is asked for, and says where it cannot."""

import gymnasium
import numpy as np
import pytest
from support.example_robots import SOME

from softrobot_env.control.base import NOT_FINITE, REASONS, UNREACHABLE
from softrobot_env.control.registry import make_policy
from softrobot_env.robots import ARM, RIG, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene
from softrobot_env.tasks import make_task


def asked(task, times):
    """Observations at times [s], with the start in force."""
    inputs = robot_inputs(task.robot)
    action = (np.array(task.start_input) - inputs.input_centre) / inputs.input_scale
    axes = ["xyz".index(name) for name in task.axes]
    points = task.trajectory.position(times)[:, axes]
    return [{"reference": point, "previous_action": action} for point in points]


@pytest.mark.parametrize("name", ["arm", "rig", *SOME])
def test_the_tip_comes_to_rest_on_the_reference(name):
    """In a scene of its own, after a motion along the reference."""
    robot = find_robot(name)
    task = make_task("circle", robot=robot)
    policy, state = make_policy("static", robot, 0.01), None
    observations = asked(task, np.linspace(0, task.duration / 2, 15))
    for observation in observations:
        action, state = policy.predict(observation, state)
        assert state.status is None
    scene, inputs = build_scene(model_scene(robot)), robot_inputs(robot)
    controls = np.zeros(scene.n_inputs)
    commanded = inputs.command(inputs.input_centre + action * inputs.input_scale)
    controls[: len(robot.tendons)] = commanded
    tip = scene.tip(scene.equilibrium(controls))
    axes = ["xyz".index(axis) for axis in task.axes]
    # Actions are single precision: 6e-8 of full scale.
    assert np.abs(tip[axes] - observations[-1]["reference"]).max() < 2e-5 * robot.reach


def test_a_height_of_its_own_is_met_where_inputs_are_left():
    """A trunk of two sections lifts its tip above where the least inputs hold it; a rod cannot."""
    for name, free in (("hanging_trunk", True), ("silicone_rod", False)):
        task = make_task("circle", robot=name)
        (observation,) = asked(task, np.zeros(1))
        policy = make_policy("static", task.robot, 0.01)
        _, state = policy.predict(observation)
        assert state.status is None
        lifted = observation | {"reference": observation["reference"] + [0.0, 0.0, 2e-3]}
        _, state = policy.predict(lifted, state)
        assert state.status == (None if free else REASONS[UNREACHABLE])


@pytest.mark.parametrize("robot", [ARM, RIG], ids=lambda robot: robot.name)
def test_its_status_is_true(robot):
    policy = make_policy("static", robot, 0.01)
    (good,) = asked(make_task("circle", robot=robot), np.zeros(1))
    far = good | {"reference": good["reference"] + 1.0}
    bad = good | {"reference": good["reference"] * np.nan}
    _, state = policy.predict(good)
    for observation, reason in (
        (far, REASONS[UNREACHABLE]),
        (bad, REASONS[NOT_FINITE]),
        (good, None),
    ):
        action, state = policy.predict(observation, state)
        assert state.status == reason
        assert np.isfinite(action).all() and np.abs(action).max() <= 1


def test_the_same_state_gives_the_same_action_and_stacks():
    policy = make_policy("static", find_robot("planar_finger"), 0.01)
    one, other = asked(make_task("random", robot="planar_finger"), np.array([0.0, 0.8]))
    _, state = policy.predict(one)
    first, again = policy.predict(other, state)[0], policy.predict(other, state)[0]
    np.testing.assert_array_equal(first, again)
    stacked = {key: np.stack([one[key], other[key]]) for key in one}
    actions, states = policy.predict(stacked)
    assert actions.shape == (2, 2) and [s.status for s in states] == [None, None]


def test_an_environment_says_robot_and_period():
    env = gymnasium.make("SoftRobot/Track-v0", robot="planar_finger", control_period=0.02)
    policy = make_policy("static", env)
    observation, _ = env.reset(seed=0)
    action, state = policy.predict(observation)
    assert state.status is None
    *_, info = env.step(action)
    assert info["error"] < 0.01
    with pytest.raises(ValueError, match="control_period"):
        make_policy("static", find_robot("planar_finger"))
