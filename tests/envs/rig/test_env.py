"""The contract of the test rig's environments: that of `TrackingEnv`, servos, twins and camera."""

import copy
from dataclasses import replace
from functools import partial

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils import seeding
from support.rig_episodes import TWINS, act, flatten, rig, steps

from softrobot_env.envs.disturbances import noise_seed
from softrobot_env.envs.observations.readouts import Cameras, filmed
from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.envs.options import REAL_OPTIONS, parse_options
from softrobot_env.envs.rendering import lifted
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import LENGTH_SCALE, RIG
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.registry import SCENES
from softrobot_env.scene.servos import Servos
from softrobot_env.tasks import RIG_TASKS, Task, make_task
from softrobot_env.thesis.envs import RigEnv

# ---------------------------------------------------------------- the two checkers, spaces


def test_spaces_are_finite_and_alike():
    environments = [rig(name) for name in RIG_TASKS] + [rig(twin=1), rig(pieces=2)]
    first = environments[0]
    assert all(env.observation_space == first.observation_space for env in environments[:4])
    for box in first.observation_space.values():
        assert np.all(np.isfinite([box.low, box.high]))
        assert np.all(box.low < box.high)
        assert box.dtype == np.float64
    assert first.action_space == gymnasium.spaces.Box(-1, 1, (3,), np.float32)
    unmeasured = {"curvature", "curvature_rate", "tendon_tension", "sensors"}
    assert set(RigEnv().observation_space) == set(OBSERVABLES) - unmeasured
    assert set(rig().observation_space) == set(OBSERVABLES) - {"sensors"}


def test_environments_simulate_the_registered_scene():
    assert rig().scene.config == SCENES["rig"]


# ---------------------------------------------------------------- determinism, copies, memory


def test_only_the_camera_depends_on_the_seed():
    env = rig()
    assert flatten(env.reset(seed=1)) == flatten(env.reset(seed=2))
    env = rig(twin=0)
    one, two = env.reset(seed=1)[0], env.reset(seed=2)[0]
    different = {name for name in one if np.any(one[name] != two[name])}
    assert different == {"tip_position", "tip_velocity"}


# ---------------------------------------------------------------- time, actions, order of calls


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


def test_options_hold_for_one_episode():
    env = rig("reach", seed=3)
    first = env.reset()[0]["reference"]
    np.testing.assert_array_equal(first, make_task("reach", seed=3).trajectory.points[0][:2])
    other = env.reset(options={"task": {"seed": 4}})[0]["reference"]
    np.testing.assert_array_equal(other, make_task("reach", seed=4).trajectory.points[0][:2])
    np.testing.assert_array_equal(env.reset()[0]["reference"], first)


def test_other_options_keep_the_tasks_own_robot_and_start():
    start = (0.012, -0.006, -0.002)
    own = replace(make_task("triangle", period=2.0), robot=OTHER, start_input=start)
    env = rig(own)
    observation, _ = env.reset(options={"task": {"period": 3.0}})
    assert observation["curvature"].shape == (4,)
    np.testing.assert_allclose(observation["previous_action"], np.array(start) / 0.03)
    assert env.current_task.robot == OTHER


def test_other_options_keep_the_real_rigs_robot():
    own = replace(make_task("triangle", period=2.0), robot=OTHER)
    found = parse_options({"task": {"period": 3.0}}, REAL_OPTIONS).changed(own)
    assert found == replace(make_task("triangle", period=3.0), robot=OTHER)


def test_a_sharp_bend_ends_the_episode():
    """A rig of a hundredth of the stiffness is folded by its tendon."""
    soft = replace(RIG, youngs_modulus=RIG.youngs_modulus / 100, gravity=(0.0, 0.0, 0.0))
    near = tuple(replace(t, offset=tuple(0.3 * x for x in t.offset)) for t in RIG.tendons)
    env = rig(replace(make_task("triangle"), robot=replace(soft, tendons=near)))
    env.reset()
    results = []
    for _ in range(500):
        results.append(env.step(np.array([1, -1, -1], np.float32)))
        if results[-1][2]:
            break
    observation, reward, terminated, truncated, info = results[-1]
    assert terminated
    assert not truncated
    assert "left the workspace: curvature" in info["failure"]
    assert reward == -10
    for name, value in observation.items():
        np.testing.assert_array_equal(value, results[-2][0][name])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(act(env))


class Broken:
    """A path at rest on the axis, one of whose functions is not a number from 0.5 s on."""

    def __init__(self, broken):
        self.broken = broken

    def __getattr__(self, name):
        if name not in ("position", "velocity", "acceleration", "path"):
            raise AttributeError(name)
        late = np.nan if name == self.broken else 0.0
        return lambda t: np.where(np.asarray(t)[:, None] < 0.5, 0.0, late) * np.ones(3)


@pytest.mark.parametrize("broken", ["position", "velocity", "acceleration"])
def test_references_that_are_not_finite_are_refused(broken):
    with pytest.raises(ValueError, match="must be finite"):
        RigEnv(Task("broken", RIG, Broken(broken), 1.0, (0.0,) * 3, axes="xy"))


def test_a_twin_of_another_robot_may_be_given():
    twin = Twin(OTHER, 0.1, (0.0,) * 3, (0.0,) * 3)
    env = rig(replace(make_task("triangle"), robot=OTHER), twin=twin)
    assert env.twin is twin


@pytest.mark.parametrize("options", [{}, {"pieces": 3, "rule": "gauss3"}, {"integrator": "RK4"}])
def test_sensors_are_current(options):
    env = rig(**options)
    env.reset()
    model, tip = env.model, env.model.site("tip").id
    jacobian = np.zeros((3, model.nv))
    hinge = np.array([model.joint(i).name.startswith("hinge") for i in range(model.njnt)])
    for observation, *_, info in steps(env, 10):
        data = copy.copy(env.data)
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, tip)
        close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-11)
        close(observation["tip_position"], data.site_xpos[tip, :2])
        close(observation["tip_velocity"], (jacobian @ data.qvel)[:2])
        for name, angles in (("curvature", data.qpos), ("curvature_rate", data.qvel)):
            close(observation[name], [angles[hinge].sum() / 0.18, angles[~hinge].sum() / 0.18])
        close(info["tendon_length"], data.ctrl)
        bend = np.array([angles.sum() for angles in (data.qpos[hinge], data.qpos[~hinge])])
        pull = np.array([t.offset for t in RIG.tendons]) @ bend
        tension = np.maximum(0, 0.5 + 980 * (data.ctrl - pull))
        np.testing.assert_allclose(info["tendon_tension"], tension, atol=1e-9)
        np.testing.assert_allclose(observation["tendon_tension"], tension, atol=1e-9)
        close(info["error"], np.hypot(*(observation["tip_position"] - observation["reference"])))


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


COUNT = 3
MEASURED = ("tip_position", "tip_velocity", "curvature", "curvature_rate", "tendon_tension")


@pytest.mark.parametrize("seed", [3, 8])
def test_many_rigs_are_the_single_environment(seed):
    env = rig(twin=seed)
    observation, info = env.reset(seed=5)
    setting, twin = env._parts, env.twin
    batch = BatchSimulation(setting.plant.nominal, COUNT)
    servos = Servos(twin.servo_speed, twin.servo_offset, twin.backlash, COUNT)
    batch.drive_by(servos)
    everyone, start = np.arange(COUNT), np.zeros(3)
    servos.start(start)
    posture = setting.plant.equilibrium(start + np.array(twin.servo_offset))
    batch.reset(everyone, np.tile(posture, (COUNT, 1)), servos.horn)
    exact = setting.plant.readout(batch, servos)
    cameras = Cameras(COUNT, twin.camera_noise, 1, env.control_period)
    seeds = [noise_seed(seeding.np_random(s)[0]) for s in (4, 5, 6)]
    cameras.start(everyone, seeds, exact.tip)
    readout = filmed(exact, cameras)
    readout.update()
    rng = np.random.default_rng(0)
    for _ in range(60):
        for name in (*MEASURED, "tendon_length"):
            seen = getattr(readout, name)()
            np.testing.assert_allclose(seen[1], observation[name], atol=1e-9, err_msg=name)
        np.testing.assert_allclose(readout.truth()["tip_position"][1], info["tip_position"])
        np.testing.assert_allclose(exact.true_length()[1], info["tendon_length"], atol=1e-15)
        actions = rng.uniform(-0.5, 0.5, (COUNT, 3))
        servos.command[:] = LENGTH_SCALE * actions
        assert not batch.advance().any()
        readout.update()
        observation, *_, info = env.step(actions[1])
        assert not exact.outside.any()


def test_references_are_drawn_on_the_dome():
    """The height of an arc of the angle that puts the head's output there."""
    angle = np.array([1e-6, 0.3, 1.2])
    distance = 0.18 * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle)
    height = 0.18 * np.sin(angle) / angle + 0.022 * np.cos(angle)
    points = np.stack([distance * np.cos(2.0), distance * np.sin(2.0)], axis=1)
    placed = lifted(RIG, points)
    np.testing.assert_array_equal(placed[:, :2], points)
    np.testing.assert_allclose(placed[:, 2], height, atol=2e-5)


def test_frames_show_the_rig():
    from softrobot_env.envs.rendering import RenderError

    env = rig("triangle", render_mode="rgb_array", width=160, height=120)
    env.reset()
    try:
        start = env.render().astype(int)
    except RenderError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
    for _ in range(40):
        env.step(np.array([0.5, 0.0, 0.0], np.float32))
    bent = env.render().astype(int)
    assert start.shape == (120, 160, 3)
    body = [np.argwhere(f[..., 0] - f[..., 2] > 60) for f in (start, bent)]  # the orange skin
    assert all(len(pixels) > 100 for pixels in body)
    assert body[1][:, 1].max() > body[0][:, 1].max() + 5  # it leans towards +x, to the right
    env.close()
