"""The contract of the test rig's environments: that of `TrackingEnv`, servos, twins and camera."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.rig_episodes import TWINS, rig

from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.envs.rendering import lifted
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import Task, make_task
from softrobot_env.thesis.envs import RigEnv

# ---------------------------------------------------------------- the two checkers, spaces


def test_what_a_lab_does_not_measure_is_not_observed_unless_asked_for():
    unmeasured = {"curvature", "curvature_rate", "tendon_tension", "sensors"}
    assert set(RigEnv().observation_space) == set(OBSERVABLES) - unmeasured
    assert set(rig().observation_space) == set(OBSERVABLES) - {"sensors"}
    assert rig().observation_space == rig(twin=1).observation_space


def test_environments_simulate_the_registered_scenes():
    assert rig().scene.config == SCENES["rig"]
    assert TrackingEnv("swing").scene.config == SCENES["arm"]


# ---------------------------------------------------------------- determinism, copies, memory


def test_only_the_camera_of_a_twin_depends_on_the_seed():
    env = rig(twin=0)
    one, two = env.reset(seed=1)[0], env.reset(seed=2)[0]
    different = {name for name in one if np.any(one[name] != two[name])}
    assert different == {"tip_position", "tip_velocity"}


# ---------------------------------------------------------------- records


class Constant:
    """Policy that pulls at one tendon."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.array([0.3, 0.0, 0.0], np.float32), state


@TWINS
def test_run_episode_records_x_and_y(twin):
    env = rig(twin=twin)
    record = run_episode(env, Constant(), seed=0, options={"duration": 1.0})
    assert record.tip.shape == record.reference.shape == (51, 3)
    assert record.curvature.shape == (51, 2)
    np.testing.assert_array_equal(record.tip[:, 2], 0)
    assert record.tip[-1, 0] > 0.03
    np.testing.assert_allclose(record.tip[-1, :2], env.data.site("tip").xpos[:2], atol=1e-12)
    np.testing.assert_allclose(record.error[-1], env._error, rtol=1e-12)


OTHER = replace(RIG, name="other", pieces=2)


@TWINS
def test_starts_are_equilibria(twin):
    start = np.array([0.012, -0.006, -0.002])
    env = rig(twin=twin, control_period=0.05)
    observation, info = env.reset(options={"start_length": start})
    np.testing.assert_allclose(observation["previous_action"], start / 0.03)
    tip = env.data.site("tip").xpos.copy()
    assert np.hypot(*tip[:2]) > 0.05
    for _ in range(10):
        *_, info = env.step((start / 0.03).astype(np.float32))
    np.testing.assert_allclose(env.data.site("tip").xpos, tip, atol=2e-6)
    np.testing.assert_allclose(info["tendon_length"], start + env.twin.servo_offset, atol=1e-9)


def test_other_options_keep_the_tasks_own_robot_and_start():
    start = (0.012, -0.006, -0.002)
    own = replace(make_task("triangle", period=2.0), robot=OTHER, start_input=start)
    env = rig(own)
    observation, _ = env.reset(options={"task": {"period": 3.0}})
    assert observation["curvature"].shape == (4,)
    np.testing.assert_allclose(observation["previous_action"], np.array(start) / 0.03)
    assert env.current_task.robot == OTHER


@pytest.mark.parametrize("broken", ["position", "velocity", "acceleration"])
def test_references_that_are_not_finite_are_refused(broken):
    """A path at rest on the axis, one of whose functions is not a number from 0.5 s on."""

    def function(late):
        return lambda t: np.where(np.asarray(t)[:, None] < 0.5, 0.0, late) * np.ones(3)

    parts = dict.fromkeys(("position", "velocity", "acceleration", "path"), function(0.0))
    path = SimpleNamespace(**parts | {broken: function(np.nan)})
    with pytest.raises(ValueError, match="must be finite"):
        RigEnv(Task("broken", RIG, path, 1.0, (0.0,) * 3, axes="xy"))


def test_a_twin_of_another_robot_may_be_given():
    twin = Twin(OTHER, 0.1, (0.0,) * 3, (0.0,) * 3)
    env = rig(replace(make_task("triangle"), robot=OTHER), twin=twin)
    assert env.twin is twin


def test_curvature_of_the_robots_pieces():
    """Two pieces of the robot on four of the chain, in a posture of known bends."""
    task = replace(make_task("triangle"), robot=replace(RIG, pieces=2))
    env = rig(task)
    env.reset()
    layout = env.scene.layout
    for station, (piece, weight) in enumerate(zip(layout.piece, layout.weights, strict=True)):
        env.data.joint(f"hinge{station}").qpos = weight * (3.0 if piece < 2 else 5.0)
        env.data.joint(f"side{station}").qpos = weight * (-1.0 if piece < 2 else 2.0)
    env._readout.update()
    np.testing.assert_allclose(env._readout.bend, [3.0, -1.0, 5.0, 2.0], rtol=1e-12)


def test_references_are_drawn_on_the_dome():
    """The height of an arc of the angle that puts the head's output there."""
    angle = np.array([1e-6, 0.3, 1.2])
    distance = 0.18 * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle)
    height = 0.18 * np.sin(angle) / angle + 0.022 * np.cos(angle)
    points = np.stack([distance * np.cos(2.0), distance * np.sin(2.0)], axis=1)
    placed = lifted(RIG, points)
    np.testing.assert_array_equal(placed[:, :2], points)
    np.testing.assert_allclose(placed[:, 2], height, atol=2e-5)
