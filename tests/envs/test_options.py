"""Options of `reset`, what they change and for how long; tasks that are drawn for an episode."""

from dataclasses import replace
from math import ceil

import gymnasium
import numpy as np
import pytest
from support.episodes import steps
from support.rig_episodes import flatten

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.robots import ARM, centerline
from softrobot_env.robots.variations import neutral
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks import make_task

STEP = "SoftRobot/ArmStep-v0"
SWING = "SoftRobot/ArmSwing-v0"

#: [m], by how much six pieces of two hinges each may miss the exact shape. A piece bent by an
#: angle t comes out short by (1/3 - 0.3) / 4 t^2 of its length (`scene.quadrature`): with 20 N in
#: every pair t is at most 0.6, 0.4 and 0.2 on the thirds, 0.8 mm in all.
CHAIN_ERROR = 1e-3


def hold_episode(env, action):
    """Observations of an episode under a constant action."""
    results = list(steps(env, lambda *_: np.asarray(action, np.float32)))
    assert not results[-1][2]
    return [observation for observation, *_ in results]


#: What a variation changes in a compiled model.
VARIED = "jnt_stiffness", "dof_damping", "body_mass", "body_inertia", "wrap_prm"
VARIED += ("tendon_frictionloss",)


def assert_models_alike(one, other):
    for field in VARIED:
        found, wanted = getattr(one, field), getattr(other, field)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, err_msg=field)


# ---------------------------------------------------------------- the start


@pytest.mark.parametrize(
    ("force", "tip"),
    [
        ((0, 0, 20), (0.2636, 0.3905)),
        ((0, 20, 0), (0.2438, 0.4167)),
        ((20, 0, 0), (0.1611, 0.4699)),
        ((5, 5, 5), (0.1750, 0.4603)),
        ((20, 20, 20), (0.3863, 0.0338)),
        ((-20, 0, 0), (-0.1611, 0.4699)),
    ],
)
def test_start_input_gives_the_equilibria_of_the_audit(force, tip, make_env):
    env = make_env(SWING, observe="all")
    observation, info = env.reset(options={"start_input": force})
    assert np.hypot(*(observation["tip_position"] - tip)) < CHAIN_ERROR
    # beta_12 = (F1 + F2 + F3) r / EI, beta_34 = (F2 + F3) r / EI, beta_56 = F3 r / EI
    bend = np.cumsum(np.array(force, float)[::-1])[::-1] * 0.025 / ARM.bending_stiffness
    np.testing.assert_allclose(observation["curvature"], np.repeat(bend, 2), atol=1e-9)
    np.testing.assert_array_equal(observation["tip_velocity"], 0)
    np.testing.assert_allclose(observation["previous_action"] * 80, force, atol=1e-12)
    np.testing.assert_allclose(
        info["tendon_tension"].reshape(3, 2) @ [1, -1], force, rtol=1e-12, atol=1e-12
    )
    drift = hold_episode(env, np.array(force) / 80)[-1]["tip_position"]
    assert np.hypot(*(drift - observation["tip_position"])) < 1e-6


@pytest.mark.parametrize(
    ("curvature", "plant"),
    [
        *((x, None) for x in ([0.0] * 6, [7.0] * 6, [40.0] * 6, [-40.0] * 6)),
        *(([3, -3, 1, 0, 0, -5.5], x) for x in (None, BeamPlant("pcc"))),
    ],
)
def test_start_curvature(curvature, plant, make_env):
    env = make_env(SWING, observe="all", plant=plant)
    observation, info = env.reset(options={"start_curvature": curvature})
    assert env.observation_space.contains(observation)
    np.testing.assert_allclose(observation["curvature"], curvature, atol=1e-6 if plant else 1e-12)
    np.testing.assert_array_equal(observation["curvature_rate"], 0)
    if np.max(np.abs(curvature)) < 10:  # at the limit a hinge turns by 1.7 rad: no arc any more
        tip = centerline(ARM, np.array(curvature, float))[-1, [0, 2]]
        assert np.hypot(*(observation["tip_position"] - tip)) < 2 * CHAIN_ERROR
    # The tendons keep the task's start input.
    start = np.array(env.task.start_input)
    np.testing.assert_allclose(info["tendon_tension"].reshape(3, 2) @ [1, -1], start, rtol=1e-12)


# ---------------------------------------------------------------- step width and duration


def test_duration(make_env, hold_action):
    env = make_env("SoftRobot/ArmLShape-v0")
    for duration in (1e-12, 0.001, 0.01, 0.013, 2.0, env.task.duration + 1.0):
        env.reset(options={"duration": duration})
        seen = hold_episode(env, hold_action(env))
        assert len(seen) == max(1, ceil(duration / 0.01 - 1e-9))
        end = env.task.trajectory.position(np.array([len(seen) * 0.01]))[0, [0, 2]]
        np.testing.assert_allclose(seen[-1]["reference"], end, atol=1e-9)
    env.reset()
    assert len(hold_episode(env, hold_action(env))) == ceil(env.task.duration / 0.01 - 1e-9)


# ---------------------------------------------------------------- variation


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((n, x) for n in neutral(robots_only=True) if n != "servo_force" for x in (0.5, 1.5)),
        ("damping_time", 0.0),
    ],
)
def test_a_varied_model_is_that_of_the_varied_robot(name, value, make_env):
    """Sec. 6.6.3: the start's posture and tensions are the nominal ones."""
    env, nominal = make_env(STEP), make_env(STEP)
    start, info = nominal.reset()
    seen, varied_info = env.reset(options={"vary": {name: value}})
    robot = ARM.vary(**{name: value})
    assert_models_alike(env.model, build_scene(replace(env.scene.config, robot=robot)).model)
    assert_models_alike(nominal.model, build_scene(nominal.scene.config).model)
    # Tendons at another radius have other lengths in the same posture.
    same = start.keys() - ({"tendon_length"} if name == "tendon_radius" else set())
    assert flatten({k: seen[k] for k in same}) == flatten({k: start[k] for k in same})
    np.testing.assert_array_equal(varied_info["tendon_tension"], info["tendon_tension"])


@pytest.mark.parametrize(
    "options",
    [
        {"vary": {"youngs_modulus": 0.5, "density": 1.3, "damping_time": 2.0}},
        {"vary": {"tendon_friction": 1.0, "tension_gain": 1.1, "delay": 0.02, "sensor_noise": 1.0}},
        {"start_input": [1.0, 2.0, 3.0]},
        {"start_curvature": [1.0] * 6},
        {"step_width": 0.2},
        {"duration": 0.05},
        {"vary": {"density": 2}, "step_width": 0.1, "start_input": [0, 0, 0], "duration": 1.0},
    ],
    ids=lambda o: "+".join(o),
)
def test_options_hold_for_one_episode(options, make_env, hold_action):
    env, untouched = make_env(STEP), make_env(STEP)
    for following in (None, {}):
        env.reset(options=options)
        env.step(hold_action(env))
        assert flatten(env.reset(options=following)) == flatten(untouched.reset())
    assert_models_alike(env.model, untouched.model)
    action = np.full(3, 0.2, np.float32)
    for _ in range(20):
        assert flatten(env.step(action)) == flatten(untouched.step(action))


def test_the_same_variation_twice_and_another_in_the_same_dict(make_env):
    """Changing the caller's dict afterwards changes no later episode."""
    env, factors = make_env(STEP), {"youngs_modulus": 1.5}
    spring = ARM.bending_stiffness / (ARM.length / 12)
    for factor in (1.5, 1.5, 0.5):
        factors["youngs_modulus"] = factor
        env.reset(options={"vary": factors})
        env.step(np.ones(3, np.float32))
        assert env.model.jnt_stiffness[0] == pytest.approx(factor * spring)


def test_a_varied_robot_is_checked_against_the_timestep(make_env):
    """20 ms suits the damped arm (2 mu = 0.1 s), not the undamped one."""
    env = make_env(STEP, control_period=0.02, timestep=0.02, integrator="implicitfast")
    with pytest.warns(TimestepWarning, match="beyond the stability limit"):
        env.reset(options={"vary": {"damping_time": 0.0}})


# ---------------------------------------------------------------- tasks of one's own


def test_a_task_of_ones_own_keeps_its_robot_and_duration(make_env, hold_action):
    """`step_width` changes the width of the given task and nothing else."""
    task = replace(make_task("step"), duration=0.5)
    env = make_env(STEP, task=task)
    observation, _ = env.reset(options={"step_width": 0.1})
    target = make_task("step", 0.1).trajectory.position(np.zeros(1))[0, [0, 2]]
    np.testing.assert_allclose(observation["reference"], target)
    assert len(hold_episode(env, hold_action(env))) == 50


# ---------------------------------------------------------------- tasks that are drawn from a seed

SAMPLED = ("SoftRobot/ArmRandom-v0", "SoftRobot/RigReach-v0")
COUNT = 3


def path_seed(env):
    return env.unwrapped.current_task.option("seed")


@pytest.mark.parametrize("env_id", SAMPLED)
def test_every_episode_has_its_own_by_the_seed(env_id):
    """And all are equally long, start on their reference and are what `make_task` makes."""
    env, other = gymnasium.make(env_id), gymnasium.make(env_id)
    seeds = []
    for seed in (0, None, None):
        observation, info = env.reset(seed=seed)
        again, _ = other.reset(seed=seed)
        seeds.append(path_seed(env))
        for name, value in observation.items():
            np.testing.assert_array_equal(value, again[name])
        task = env.unwrapped.current_task
        assert task.duration == env.unwrapped.task.duration
        drawn = make_task(task.name, seed=path_seed(env))
        assert drawn.trajectory == task.trajectory
        if task.name == "random":
            assert info["error"] < 1e-3
    assert len(set(seeds)) == 3
    env.reset(seed=1)
    assert path_seed(env) not in seeds


@pytest.mark.parametrize("env_id", SAMPLED)
def test_one_can_be_kept(env_id):
    """By the environment's `seed`, a task of one's own, or for an episode by an option."""
    name = gymnasium.spec(env_id).kwargs["task"]
    for kept in ({"seed": 7}, {"task": make_task(name, seed=7)}):
        env = gymnasium.make(env_id, **kept)
        for seed in (0, None):
            env.reset(seed=seed)
            assert path_seed(env) == 7
    env = gymnasium.make(env_id)
    env.reset(seed=0, options={"task": {"seed": 4}})
    assert path_seed(env) == 4


def test_the_same_options_serve_many():
    """Another width and a longer duration for some of the environments."""
    many = gymnasium.make_vec("SoftRobot/ArmStep-v0", num_envs=COUNT, autoreset_mode="Disabled")
    first, _ = many.reset(seed=0)
    mask = np.array([False, True, False])
    longer = {"step_width": 0.2, "duration": 6.0}
    observation, _ = many.reset(options=longer | {"reset_mask": mask})
    wide = gymnasium.make("SoftRobot/ArmStep-v0").reset(options=longer)[0]
    np.testing.assert_array_equal(observation["reference"][1], wide["reference"])
    np.testing.assert_array_equal(observation["reference"][[0, 2]], first["reference"][[0, 2]])
    for _ in range(500):
        *_, truncated, _ = many.step(np.zeros(many.action_space.shape))
    assert truncated.tolist() == [True, False, True]
