"""The contract of the test rig's environments: that of `TrackingEnv`, servos, twins and camera."""

import copy
import pickle
import warnings
from dataclasses import replace
from functools import partial
from itertools import pairwise

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from softrobot_env.envs.rig import RigEnv
from softrobot_env.envs.rig_observables import DEFAULT_RIG_OBSERVABLES, RIG_OBSERVABLES
from softrobot_env.envs.rig_options import OPTIONS
from softrobot_env.envs.rig_picture import lifted
from softrobot_env.evaluation.run import run_episode
from softrobot_env.registration import RIG_ENVIRONMENTS
from softrobot_env.rig_tasks import (
    RIG_OPTIONS,
    RIG_TASKS,
    WORKSPACE,
    RigTask,
    SetPoints,
    make_rig_task,
)
from softrobot_env.rig_trajectories import LapCircle, RoundedTriangle
from softrobot_env.robots import RIG
from softrobot_env.scene.registry import SCENES
from softrobot_env.twin import Twin, nominal_twin, rig3d_twin

TRIANGLE, CIRCLE, REACH = RIG_ENVIRONMENTS
TWINS = pytest.mark.parametrize("twin", [None, 3], ids=["nominal", "twin"])


@pytest.fixture
def rig():
    """Factory of bare environments that observe everything."""
    return partial(RigEnv, observe="all")


def act(env, rng=None):
    """A random action, or none."""
    size = env.action_space.shape
    values = np.zeros(size) if rng is None else rng.uniform(-1, 1, size)
    return values.astype(np.float32)


def steps(env, count, seed=0):
    """Results of `count` steps at most with random actions."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        result = env.step(act(env, rng))
        yield result
        if result[2] or result[3]:
            return


def flatten(result):
    """Every number of a result of `reset` or `step`, for bitwise comparison."""
    if isinstance(result, dict):
        return [part for key in sorted(result) for part in (key, *flatten(result[key]))]
    if isinstance(result, tuple):
        return [part for item in result for part in flatten(item)]
    return [result.tobytes() if isinstance(result, np.ndarray) else result]


def arrays(result):
    """Arrays of an observation or info."""
    return [value for value in result.values() if isinstance(value, np.ndarray)]


# ---------------------------------------------------------------- the two checkers, spaces


@pytest.mark.parametrize("env_id", RIG_ENVIRONMENTS)
@TWINS
def test_gymnasium_checker(env_id, twin):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(env_id, twin=twin).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("env_id", RIG_ENVIRONMENTS)
def test_stable_baselines3_checker(env_id):
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs the rl extra")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3.check_env(gymnasium.make(env_id), warn=True, skip_render_check=True)


def test_spaces_are_finite_and_alike(rig):
    environments = [rig(name) for name in RIG_TASKS] + [rig(twin=1), rig(pieces=2)]
    first = environments[0]
    assert all(env.observation_space == first.observation_space for env in environments[:4])
    for box in first.observation_space.values():
        assert np.all(np.isfinite([box.low, box.high]))
        assert np.all(box.low < box.high)
        assert box.dtype == np.float64
    assert first.action_space == gymnasium.spaces.Box(-1, 1, (3,), np.float32)
    assert tuple(RigEnv().observation_space) == tuple(sorted(DEFAULT_RIG_OBSERVABLES))
    assert tuple(rig().observation_space) == tuple(sorted(RIG_OBSERVABLES))


@TWINS
def test_observations_stay_inside_the_space(twin, rig):
    env = rig("reach", twin=twin)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for observation, reward, terminated, truncated, info in steps(env, 300):
        assert env.observation_space.contains(observation)
        assert isinstance(reward, float)
        assert type(terminated) is type(truncated) is bool
        assert np.all(info["tendon_tension"] >= 0)
    assert not terminated


# ---------------------------------------------------------------- determinism, copies, memory


@TWINS
def test_episodes_repeat_bitwise(twin, rig):
    env, other = rig(twin=twin), rig(twin=twin)
    runs = []
    for each in (env, other, env):
        start = each.reset(seed=7)
        runs.append(flatten((*start, *steps(each, 60))))
    assert runs[0] == runs[1] == runs[2]


def test_only_the_camera_depends_on_the_seed(rig):
    env = rig()
    assert flatten(env.reset(seed=1)) == flatten(env.reset(seed=2))
    env = rig(twin=0)
    one, two = env.reset(seed=1)[0], env.reset(seed=2)[0]
    different = {name for name in one if np.any(one[name] != two[name])}
    assert different == {"tip_position", "tip_velocity"}


@pytest.mark.parametrize("way", [lambda e: pickle.loads(pickle.dumps(e)), copy.deepcopy])
@TWINS
def test_copies_continue_bitwise(way, twin, rig):
    env = rig(twin=twin)
    env.reset(seed=0)
    list(steps(env, 20))
    other = way(env)
    assert flatten(tuple(steps(other, 40, 1))) == flatten(tuple(steps(env, 40, 1)))
    assert flatten(other.reset()) == flatten(env.reset())


@pytest.mark.parametrize("way", [lambda e: pickle.loads(pickle.dumps(e)), copy.deepcopy])
@TWINS
def test_copies_are_independent(way, twin, rig):
    env, untouched = rig(twin=twin), rig(twin=twin)
    env.reset(seed=0), untouched.reset(seed=0)
    list(steps(way(env), 20, 1))
    assert flatten(tuple(steps(env, 5))) == flatten(tuple(steps(untouched, 5)))


@TWINS
def test_results_share_no_memory(twin, rig):
    env = rig(twin=twin)
    calls = [env.reset()]
    calls += [(obs, info) for obs, _, _, _, info in steps(env, 4)]
    calls += [env.reset()]
    held = [[*arrays(obs), *arrays(info)] for obs, info in calls]
    held.append([env.data.qpos, env.data.qvel, env.data.ctrl, env.data.sensordata])
    for i, first in enumerate(held):
        for second in held[i + 1 :]:
            assert not any(np.shares_memory(a, b) for a in first for b in second)


# ---------------------------------------------------------------- time, actions, order of calls


@pytest.mark.parametrize("period", [0.004, 0.02, 0.03, 0.2])
def test_episode_lasts_as_long_as_the_task(period, rig):
    env = rig(control_period=period)
    env.reset(options={"duration": 0.6})
    results = list(steps(env, 1000))
    assert len(results) == round(0.6 / period)
    assert [truncated for *_, truncated, _ in results] == [False] * (len(results) - 1) + [True]
    assert results[-1][-1]["time"] == pytest.approx(0.6)
    assert env.data.time == pytest.approx(0.6)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(act(env))


def test_no_step_before_the_first_reset(rig):
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        rig().step(np.zeros(3, np.float32))


@pytest.mark.parametrize("bad", [np.full(3, np.nan), np.full(3, 1.1), np.zeros(2), [0, 0, 0], None])
def test_bad_actions_are_named_and_change_nothing(bad, rig):
    env, untouched = rig(), rig()
    env.reset(), untouched.reset()
    with pytest.raises(ValueError, match=r"3 numbers in \[-1, 1\]"):
        env.step(bad)
    assert flatten(tuple(steps(env, 3))) == flatten(tuple(steps(untouched, 3)))


# ---------------------------------------------------------------- what is measured


@pytest.mark.parametrize("options", [{}, {"pieces": 3, "rule": "gauss3"}, {"integrator": "RK4"}])
def test_sensors_are_current(options, rig):
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


@pytest.mark.parametrize("name", RIG_TASKS)
def test_reference_is_the_trajectory(name, rig):
    preview = (0.0, 0.033, 2.0)
    env = rig(name, preview=preview)
    trajectory = env.task.trajectory
    for observation, *_, info in [env.reset(), *steps(env, 300)]:
        t = info["time"]
        close = partial(np.testing.assert_allclose, atol=1e-8)
        now, later = np.array([t]), t + np.array(preview)
        close(observation["reference"], trajectory.position(now)[0, :2])
        close(observation["reference_preview"], trajectory.position(later)[:, :2].ravel())
        close(observation["reference_velocity"], trajectory.velocity(now)[0, :2])
        close(observation["reference_acceleration"], trajectory.acceleration(now)[0, :2])


def test_curvature_of_the_robots_pieces(rig):
    """Two pieces of the robot on four of the chain, in a posture of known bends."""
    task = replace(make_rig_task("triangle"), robot=replace(RIG, pieces=2))
    env = rig(task)
    env.reset()
    layout = env.scene.layout
    for station, (piece, weight) in enumerate(zip(layout.piece, layout.weights, strict=True)):
        env.data.joint(f"hinge{station}").qpos = weight * (3.0 if piece < 2 else 5.0)
        env.data.joint(f"side{station}").qpos = weight * (-1.0 if piece < 2 else 2.0)
    env._readout.update()
    np.testing.assert_allclose(env._readout.curvature, [3.0, -1.0, 5.0, 2.0], rtol=1e-12)


# ---------------------------------------------------------------- servos


def test_servos_wind_at_their_speed(rig):
    env = rig(control_period=0.02)
    env.reset()
    *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    speed = nominal_twin().servo_speed
    np.testing.assert_allclose(info["tendon_length"], [0.02 * speed, -1.5e-3, 0], atol=1e-9)
    for _ in range(20):
        observation, *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [0.03, -1.5e-3, 0], atol=1e-9)
    np.testing.assert_array_equal(observation["tendon_length"], info["tendon_length"])


def test_horns_move_within_the_control_period(rig):
    """Ten short periods with one command are one long period, but for the timestep."""
    twin = nominal_twin()
    coarse, fine = (rig(twin=twin, control_period=p, timestep=1e-3) for p in (0.2, 0.02))
    coarse.reset(), fine.reset()
    action = np.array([0.7, -0.3, 0.1], np.float32)
    far, *_ = coarse.step(action)
    for _ in range(10):
        near, *_ = fine.step(action)
    for name in ("tip_position", "tip_velocity", "tendon_length", "tendon_tension"):
        np.testing.assert_allclose(far[name], near[name], rtol=1e-9, atol=1e-12)


def test_interpolated_horns_converge_with_the_timestep(rig):
    def after(timestep):
        env = rig(timestep=timestep)
        env.reset()
        for k in range(10):
            observation, *_ = env.step(np.array([0.1 * k, 0.0, -0.05 * k], np.float32))
        return observation["tip_position"]

    truth = after(2.5e-5)
    coarse, fine = (np.linalg.norm(after(h) - truth) for h in (1e-3, 5e-4))
    assert 1e-7 < fine < 0.6 * coarse < 0.1e-3


def test_offsets_and_backlash_of_a_twin_are_applied(rig):
    twin = replace(nominal_twin(), servo_offset=(1e-3, 0.0, 0.0), backlash=(0.0, 4e-4, 0.0))
    env = rig(twin=twin)
    _, info = env.reset()
    np.testing.assert_allclose(info["tendon_length"], [1e-3, 0, 0], atol=1e-15)
    for _ in range(5):
        *_, info = env.step(np.array([0.1, 0.1, 0.1], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [4e-3, 2.8e-3, 3e-3], atol=1e-9)


# ---------------------------------------------------------------- twins and their camera


def test_a_seed_stands_for_its_twin(rig):
    env = rig(twin=5)
    assert env.twin == rig3d_twin(5)
    assert env.task.robot is RIG
    assert env.scene.config.robot == env.twin.robot
    assert rig().twin == nominal_twin()
    np.testing.assert_allclose(
        env.model.tendon_frictionloss, [t.friction for t in env.twin.robot.tendons]
    )


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_camera_sees_late_and_not_exactly(delay, rig):
    noise = 3e-4
    twin = replace(nominal_twin(), camera_noise=noise, camera_delay=delay * 0.02 + 0.004)
    env, exact = rig(twin=twin), rig()
    observation, info = env.reset(seed=0)
    truth, seen, speed = [info["tip_position"]], [observation["tip_position"]], []
    exact.reset()
    for (observation, *_, info), (other, *_) in zip(
        steps(env, 300), steps(exact, 300), strict=True
    ):
        np.testing.assert_array_equal(info["tip_position"], other["tip_position"])
        error = np.hypot(*(other["tip_position"] - other["reference"]))
        assert info["error"] == pytest.approx(error, rel=1e-12)
        truth.append(info["tip_position"])
        seen.append(observation["tip_position"])
        speed.append(observation["tip_velocity"])
    np.testing.assert_allclose(speed, np.diff(seen, axis=0) / 0.02, atol=1e-12)
    error = np.array(seen[delay:]) - truth[: len(truth) - delay]
    assert np.std(error) == pytest.approx(noise, rel=0.1)
    assert abs(np.mean(error)) < 4 * noise / np.sqrt(error.size)


def test_a_frame_is_one_control_period_late(rig):
    twin = replace(rig3d_twin(0), camera_noise=0.0)
    env = rig(twin=twin)
    _, info = env.reset()
    for observation, *_, after in steps(env, 20):
        np.testing.assert_array_equal(observation["tip_position"], info["tip_position"])
        info = after


def test_an_exact_twin_needs_no_camera(rig):
    _, info = rig().reset()
    assert "tip_position" not in info


# ---------------------------------------------------------------- options, starts, failures


@TWINS
def test_starts_are_equilibria(twin, rig):
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


def test_options_hold_for_one_episode(rig):
    env = rig("reach", seed=3)
    first = env.reset()[0]["reference"]
    np.testing.assert_array_equal(first, make_rig_task("reach", seed=3).trajectory.points[0][:2])
    other = env.reset(options={"task": {"seed": 4}})[0]["reference"]
    np.testing.assert_array_equal(other, make_rig_task("reach", seed=4).trajectory.points[0][:2])
    np.testing.assert_array_equal(env.reset()[0]["reference"], first)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vary": {}}, "unknown reset option 'vary'; allowed are duration"),
        ({"duration": 0}, "'duration' must be a positive number"),
        ({"duration": 1e6}, "at most 3600 s"),
        ({"start_length": [0.0, 0.0]}, "3 finite numbers"),
        ({"start_length": [0.0, 0.0, 0.04]}, r"within \+-0.03 m"),
        ({"task": 3}, "'task' must be a dict"),
        ({"task": {"radius": 0.1}}, "it has period"),
        ("fast", "must be a dict"),
    ],
    ids=str,
)
def test_bad_options_are_named_and_change_nothing(options, message, rig):
    env, untouched = rig(), rig()
    env.reset(), untouched.reset()
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    assert flatten(tuple(steps(env, 3))) == flatten(tuple(steps(untouched, 3)))
    assert set(OPTIONS) == {"duration", "start_length", "task"}


def test_a_sharp_bend_ends_the_episode(rig):
    """A rig of a hundredth of the stiffness is folded by its tendon."""
    soft = replace(RIG, youngs_modulus=RIG.youngs_modulus / 100, gravity=(0.0, 0.0, 0.0))
    near = tuple(replace(t, offset=tuple(0.3 * x for x in t.offset)) for t in RIG.tendons)
    env = rig(replace(make_rig_task("triangle"), robot=replace(soft, tendons=near)))
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "swing"}, "triangle, rig_circle, reach"),
        ({"period": 0.0}, "period must be finite and positive"),
        ({"radius": 0.1}, "no option 'radius'; it has period"),
        ({"obsrve": "all"}, "no option 'obsrve'"),
        ({"task": make_rig_task("reach"), "seed": 2}, "needs? its name"),
        ({"period": 0.02}, "must accelerate by less|below"),
        ({"twin": -1}, "seed of a twin"),
        ({"control_period": 0.5}, "control_period"),
        ({"observe": ("tip",)}, "curvature_rate"),
        ({"preview": ()}, "preview"),
        ({"render_mode": "ansi"}, "rgb_array"),
        ({"width": 0}, "width and height"),
        ({"twin": Twin(replace(RIG, tendons=()), 1.0, (), ())}, "0 tendons"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        RigEnv(**arguments)


# ---------------------------------------------------------------- tasks


def test_tasks_are_those_of_the_audit():
    triangle = make_rig_task("triangle", period=1.0)
    assert triangle.trajectory == RoundedTriangle(period=1.0)
    assert triangle.duration == pytest.approx(17.0)
    assert make_rig_task("triangle").duration == pytest.approx(45.0)
    assert triangle.label == "triangle period 1"
    circle = make_rig_task("rig_circle")
    assert circle.trajectory == LapCircle(radius=0.12, speed=0.05)
    assert circle.duration == pytest.approx(35.08, abs=0.01)
    for name, make in RIG_TASKS.items():
        assert make_rig_task(name) == make()
        assert make_rig_task(name).robot is RIG


def test_set_points_fill_the_workspace():
    points = np.concatenate([make_rig_task("reach", seed=s).trajectory.points for s in range(100)])
    square = np.sum(points**2, axis=1) / WORKSPACE**2
    assert square.max() < 1
    # Uniform in the disc: the squared distance is uniform in [0, 1].
    assert square.mean() == pytest.approx(0.5, abs=0.03)
    assert np.abs(points.mean(axis=0)).max() < 0.1 * WORKSPACE
    assert make_rig_task("reach", seed=1) == make_rig_task("reach", seed=1)


def test_set_points_are_held():
    points = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0))
    run = SetPoints(points, 3.0)
    times = np.array([-1.0, 0.0, 2.999, 3.0, 100.0])
    np.testing.assert_array_equal(run.position(times), np.array(points)[[0, 0, 0, 1, 1]])
    assert not run.velocity(times).any()
    assert run.acceleration(times).shape == (5, 3)
    np.testing.assert_array_equal(run.path(), points)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("wave", {}, "triangle, rig_circle, reach"),
        ("triangle", {"speed": 1.0}, "it has period"),
        ("triangle", {"period": "fast"}, "must be a number"),
        ("rig_circle", {"radius": -0.1}, "radius must be finite and positive"),
        ("reach", {"seed": 0.5}, "whole number"),
        ("reach", {"radius": 0.2}, "0.121"),
        ("reach", {"hold": 0.0}, "positive hold"),
    ],
)
def test_bad_tasks_are_named(name, options, message):
    with pytest.raises(ValueError, match=message):
        make_rig_task(name, **options)
    assert set(RIG_OPTIONS) == set(RIG_TASKS)


def test_a_task_needs_its_robots_tendons():
    with pytest.raises(ValueError, match="3 tendons, start_length 2"):
        RigTask("short", RIG, RoundedTriangle(), 1.0, (0.0, 0.0))
    with pytest.raises(ValueError, match="duration"):
        RigTask("short", RIG, RoundedTriangle(), 0.0)


# ---------------------------------------------------------------- use


class Constant:
    """Policy that pulls at one tendon."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.array([0.3, 0.0, 0.0], np.float32), state


@TWINS
def test_run_episode_records_x_and_y(twin, rig):
    env = rig(twin=twin)
    record = run_episode(env, Constant(), seed=0, options={"duration": 1.0})
    assert record.tip.shape == record.reference.shape == (51, 3)
    assert record.curvature.shape == (51, 2)
    np.testing.assert_array_equal(record.tip[:, 2], 0)
    assert record.tip[-1, 0] > 0.03
    np.testing.assert_allclose(record.tip[-1, :2], env.data.site("tip").xpos[:2], atol=1e-12)
    np.testing.assert_allclose(record.error[-1], env._error, rtol=1e-12)


def test_flattened(rig):
    env = FlattenObservation(gymnasium.make(REACH))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


def test_references_are_drawn_on_the_dome():
    """The height of an arc of the angle that puts the head's output there."""
    angle = np.array([1e-6, 0.3, 1.2])
    distance = 0.18 * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle)
    height = 0.18 * np.sin(angle) / angle + 0.022 * np.cos(angle)
    points = np.stack([distance * np.cos(2.0), distance * np.sin(2.0)], axis=1)
    placed = lifted(RIG, points)
    np.testing.assert_array_equal(placed[:, :2], points)
    np.testing.assert_allclose(placed[:, 2], height, atol=2e-5)


def test_frames_show_the_rig(rig):
    from softrobot_env.envs.opengl import RenderError

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


def test_pairs_of_instants_are_a_period_apart(rig):
    env = rig(control_period=0.05)
    times = [env.reset()[1]["time"]] + [info["time"] for *_, info in steps(env, 20)]
    assert all(b - a == pytest.approx(0.05) for a, b in pairwise(times))


def test_environments_simulate_the_registered_scene(rig):
    assert rig().scene.config == SCENES["rig"]
