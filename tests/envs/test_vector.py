"""Many robots at once are the single robot, step for step."""

from dataclasses import replace
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from support.example_robots import EVERY_ROBOT
from support.many import alike, same
from support.rig_episodes import flatten

from softrobot_env.envs.gripper import VectorGripperEnv
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.simulation import warp_limits
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots.variations import neutral
from softrobot_env.tasks import make_task
from softrobot_env.tasks.gripper import GRIP_TASKS

COUNT = 4
SHORT = replace(make_task("lshape"), duration=0.3)  # 30 steps
RANGES = Randomization(
    youngs_modulus=(0.5, 1.5),
    density=(0.8, 1.25),
    damping_time=(0.5, 2.0),
    tendon_radius=(0.9, 1.1),
    tension_gain=(0.8, 1.25),
    tendon_friction=(0.0, 1.0),
    delay=(0.0, 0.05),
    sensor_noise=(0.5, 2.0),
)

#: What any robot may vary in.
ANY_RANGES = replace(RANGES, tension_gain=(1.0, 1.0), tendon_friction=(0.0, 0.02))


def actions(steps, seed=0):
    """Actions (steps, COUNT, 3) that move the arms in different ways."""
    return np.random.default_rng(seed).uniform(-0.3, 0.3, (steps, COUNT, 3)).astype(np.float32)


# Sums of two hinge angles are rounded differently in one place; the physics is equal bit by bit.
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}


def assert_alike(env_id, options, steps, size, **close):
    """Robots are single ones with consecutive seeds, under random actions of some size."""
    many = gymnasium.make_vec(env_id, num_envs=3, **options).unwrapped
    singles = {i: gymnasium.make(env_id, **options).unwrapped for i in range(3)}
    assert many.single_observation_space == singles[0].observation_space
    resets = many.reset(seed=5), {i: env.reset(seed=5 + i) for i, env in singles.items()}
    rng, shape = np.random.default_rng(0), (steps, *many.action_space.shape)
    list(alike(many, singles, resets, size * rng.uniform(-1, 1, shape), **close))
    return many, singles


LSHAPE, REACH = "SoftRobot/ArmLShape-v0", "SoftRobot/RigReach-v0"
OWN = {"task": SHORT, "observe": "all"}
SENSED = {
    "observe": ("tip_position", "reference", "sensors"),
    "control_period": 0.02,
    "randomization": Randomization(sensor_errors=(0.5, 1.5), youngs_modulus=(0.8, 1.2)),
}
DRAWN = {"preview": (0.05, 0.3), "control_period": 0.1}
GRIP = replace(GRIP_TASKS["enclose"], duration=0.06, closing=0.02)  # 3 steps

#: Id, options, number of steps, mostly more than an episode has, and size of actions.
ALIKE = {
    "arm": (LSHAPE, OWN, 70, 0.3),
    "varied arm": (LSHAPE, OWN | {"randomization": RANGES}, 70, 0.3),
    **{f"twin {n}": (REACH, {"twin": n, "observe": "all", "seed": 0}, 60, 0.5) for n in (3, 8)},
    "sensors": ("SoftRobot/RigCircle-v0", SENSED, 8, 0.5),
    "bar": ("SoftRobot/GripperHold-v0", {}, 6, 1.0),
    "short grip": ("SoftRobot/GripperEnclose-v0", {"task": GRIP}, 8, 1.0),
    "drawn path": ("SoftRobot/ArmRandom-v0", DRAWN | {"speed": 0.8}, 50, 0.1),
    "drawn points": (REACH, DRAWN | {"hold": 0.3}, 40, 0.1),
}


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize("name", ALIKE)
def test_episodes_are_those_of_single_environments(name):
    """Observations, rewards, ends and info, also of the episodes that follow."""
    assert_alike(*ALIKE[name], **ROUNDING)


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("observe_as", "size", "close"),
    [("dict", 0.2, {"rtol": 1e-9, "atol": 1e-10}), ("vector", 1.0, ROUNDING)],
    ids=["dict", "vector"],
)
@EVERY_ROBOT
def test_every_robot_is_that_of_a_single_environment(env_id, options, observe_as, size, close):
    options = options | {"observe_as": observe_as, "observe": "all", "randomization": ANY_RANGES}
    many, singles = assert_alike(env_id, options, 8, size, **close)
    if observe_as == "vector":
        assert many.vector_layout == singles[0].vector_layout


# ---------------------------------------------------------------- autoreset


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("make", "drawn"),
    [
        (
            partial(VectorTrackingEnv, COUNT, SHORT, randomization=RANGES, observe="all"),
            "variation_youngs_modulus",
        ),
        (partial(VectorGripperEnv, COUNT, GRIP), "diameter"),
    ],
    ids=["arm", "gripper"],
)
def test_same_step_autoreset_tells_the_last_observation_and_the_new_episode(make, drawn):
    same_step, next_step = make(autoreset_mode="SameStep"), make()
    same_step.reset(seed=0), next_step.reset(seed=0)
    truncated = np.zeros(COUNT, bool)
    rng = np.random.default_rng(0)
    while not truncated.any():
        action = rng.uniform(-0.3, 0.3, same_step.action_space.shape).astype(np.float32)
        observation, _, _, truncated, info = same_step.step(action)
        last, *_, reported = next_step.step(action)
        assert ("final_obs" in info) == truncated.any()
    assert truncated.all() and info["_final_obs"].all() and info["_final_info"].all()
    new, *_, begun = next_step.step(action)
    for ours, theirs in (
        (info["final_obs"], last),
        (info["final_info"], reported),
        (observation, new),
        (info, info | begun),
    ):
        assert flatten(ours) == flatten(theirs)
    assert not np.any(begun[drawn] == reported[drawn])


def test_without_autoreset_ended_episodes_are_reset_by_mask():
    env = VectorTrackingEnv(COUNT, SHORT, autoreset_mode=AutoresetMode.DISABLED)
    env.reset()
    for action in actions(30):
        _, _, _, truncated, _ = env.step(action)
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(action)
    first = np.array([True, False, True, False])
    moved = env.simulation.qpos.copy()
    env.reset(options={"reset_mask": first})
    np.testing.assert_array_equal(env.simulation.qpos[~first], moved[~first])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(action)
    env.reset(options={"reset_mask": ~first})
    env.step(action)


@pytest.mark.parametrize("task", ["lshape", "random"])
def test_options_of_a_reset_hold_for_its_episode_alone(task):
    """Of many robots as of one, also where every episode samples its own path."""
    many, single = VectorTrackingEnv(2, task), TrackingEnv(task)
    for options in ({}, {"duration": 0.05, "start_input": [3.0, 1.0, 0.0]}, {}):
        given = {"seed": 3, "options": options}
        resets = many.reset(**given), {0: single.reset(**given)}
        same(TrackingEnv(task).reset(**given), resets[0], 0, **ROUNDING)
        *_, last = alike(many, {0: single}, resets, np.zeros((5, 2, 3)), **ROUNDING)
        assert np.all(last[3] == bool(options))  # 5 steps are the whole of a shortened episode


# ---------------------------------------------------------------- variation


@pytest.mark.parametrize(
    "vary",
    [
        {"youngs_modulus": 1.2, "density": 0.7, "tendon_radius": 0.8},
        {"youngs_modulus": 0.5, "tendon_friction": 0.5},
        {"youngs_modulus": 0.9, "tension_gain": 1.2, "delay": 0.05, "tendon_friction": 0.2},
        # Far from the nominal one.
        {"damping_time": 0.02},
        {"damping_time": 0.0},
        {"youngs_modulus": 100.0, "damping_time": 0.01},
        {"youngs_modulus": 0.5, "damping_time": 0.1, "density": 2.0},
    ],
)
@pytest.mark.filterwarnings("ignore:robot 'arm'")
def test_variations_are_those_of_the_single_environment(vary):
    """Each robot takes the steps that it needs, alone or among others.

    Products of several factors are rounded differently, which lively motions amplify.
    """
    task = replace(SHORT, duration=0.61)
    many, single = VectorTrackingEnv(COUNT, task, observe="all"), TrackingEnv(task, observe="all")
    others = {name: (0.07, 0.0, 0.01) if name == "delay" else (1.0, 0.9, 1.1) for name in vary}
    values = {name: np.insert(others[name], 2, value) for name, value in vary.items()}
    resets = many.reset(options={"vary": values}), {2: single.reset(options={"vary": vary})}
    for *_, terminated, _, _ in alike(many, {2: single}, resets, actions(60), rtol=0, atol=1e-7):
        assert not terminated.any()
    np.testing.assert_allclose(many.simulation.qpos[2], single.data.qpos, rtol=0, atol=1e-9)
    estimate = many.simulation.integration_error[2]
    assert estimate == pytest.approx(single.simulation.integration_error, rel=1e-6)
    many.step(actions(1)[0])
    # And the next episode is nominal again.
    observations, *_ = many.step(actions(1)[0])
    same(single.reset()[0], observations, 2, **ROUNDING)


def test_noise_is_that_of_the_single_environment_with_the_same_seed():
    """Over blocks of draws and several episodes, with silent sensors beside noisy ones."""
    long = replace(make_task("lshape"), duration=1.0)
    many = VectorTrackingEnv(COUNT, long, observe="all")
    scale = np.array([0.0, 1.0, 2.0, 0.0])
    singles = {i: TrackingEnv(long, observe="all") for i in range(3)}
    for seed in (5, None):
        alone = {}
        for i, env in singles.items():
            options = {"vary": {"sensor_noise": scale[i]}}
            alone[i] = env.reset(seed=seed and seed + i, options=options)
        resets = many.reset(seed=seed, options={"vary": {"sensor_noise": scale}}), alone
        for observations, *_, infos in alike(many, singles, resets, actions(99), **ROUNDING):
            assert many.observation_space.contains(observations)
            for name in ("tip_position", "curvature"):
                np.testing.assert_array_equal(infos[name][0], observations[name][0])
                assert np.all(infos[name][1] != observations[name][1])
    assert "tip_position" not in many.reset()[1]


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
def test_noise_and_delay_of_one_do_not_depend_on_resets_of_others(mode):
    """Robot 1 starts later than the rest, so that their resets fall into its episode."""
    vary = {"sensor_noise": 1.0, "delay": 0.04}
    randomization = Randomization(**{name: (value, value) for name, value in vary.items()})
    env = VectorTrackingEnv(COUNT, SHORT, randomization=randomization, autoreset_mode=mode)
    single = TrackingEnv(SHORT)
    env.reset(seed=0)
    for action in actions(7):
        env.step(action)
    late = np.array([False, True, False, False])
    seeds = [None, 9, None, None]
    observations, _ = env.reset(seed=seeds, options={"reset_mask": late, "vary": vary})
    observation, _ = single.reset(seed=9, options={"vary": vary})
    same(observation, observations, 1, **ROUNDING)
    for k, action in enumerate(actions(29)):
        observations, _, terminated, truncated, _ = env.step(action)
        same(single.step(action[1])[0], observations, 1, **ROUNDING)
        over = terminated | truncated
        assert over.tolist() == [k == 22, False, k == 22, k == 22]
        if mode == "Disabled" and over.any():
            observations, _ = env.reset(options={"reset_mask": over})
    assert env.observation_space.contains(observations)


@pytest.mark.parametrize("name", ["youngs_modulus", "damping_time", "tendon_friction"])
def test_draws_fill_their_ranges(name):
    """Uniformly, of factors their logarithms: mean and variance of a uniform distribution."""
    rng, ends = np.random.default_rng(0), np.array(RANGES.ranges[name])
    values = np.array([RANGES.draw(rng)[name] for _ in range(2000)])
    if name != "tendon_friction":
        values, ends = np.log(values), np.log(ends)
    assert ends[0] <= values.min() and values.max() <= ends[1]
    assert values.mean() == pytest.approx(ends.mean(), abs=0.03)
    assert values.var() == pytest.approx(np.ptp(ends) ** 2 / 12, rel=0.1)


def test_given_variations_win_over_draws():
    single = TrackingEnv(SHORT, randomization=RANGES)
    _, info = single.reset(seed=0, options={"vary": {"density": 1.1}})
    reported = {name: value for name, value in info.items() if name.startswith("variation_")}
    expected = {f"variation_{name}": value for name, value in neutral().items()}
    assert reported == expected | {"variation_density": 1.1}


def test_new_ranges_leave_the_draws_of_the_others_alone():
    fewer = replace(RANGES, tension_gain=(1.0, 1.0), tendon_friction=(0.0, 0.0))
    drawn = [r.draw(np.random.default_rng(4)) for r in (fewer, RANGES)]
    for name in ("youngs_modulus", "density", "damping_time", "tendon_radius"):
        assert drawn[0][name] == drawn[1][name]
    assert "tension_gain" not in drawn[0]
    assert "tension_gain" in drawn[1]


# ---------------------------------------------------------------- failures and bad input


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(
    ("start", "modulus", "pull"),
    [
        ({}, [1.0, 0.2, 1.0, 1.0], [0.0, 1.0, 0.0, 0.0]),
        ({"start_curvature": np.full(6, 39.9)}, [0.2] * COUNT, [1.0] * COUNT),
    ],
    ids=["one", "all"],
)
def test_a_failed_episode_is_reported_and_disturbs_no_other(start, modulus, pull):
    """Full pull folds a soft arm, from just inside the limit at once; a nominal one only bends."""
    many, singles = VectorTrackingEnv(COUNT, "swing"), {i: TrackingEnv("swing") for i in (0, 1)}
    resets = (
        many.reset(options=start | {"vary": {"youngs_modulus": np.array(modulus)}}),
        {
            i: env.reset(options=start | {"vary": {"youngs_modulus": modulus[i]}})
            for i, env in singles.items()
        },
    )
    rows = np.tile(pull, (300, 3, 1)).swapaxes(1, 2).astype(np.float32)
    results = alike(many, singles, resets, rows, **ROUNDING)
    _, rewards, terminated, _, infos = next(result for result in results if result[2].any())
    assert terminated.tolist() == [soft < 1 for soft in modulus]
    assert infos["failure"][1].startswith("left the workspace: curvature")
    assert rewards[1] == -10.0
    assert (infos["failure"][0] is None) == (rewards[0] > -1.0) == (not terminated[0])


def test_warp_says_what_to_install(monkeypatch):
    monkeypatch.setattr(warp_limits, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"^backend 'warp' needs mujoco_warp, torch: pip install"):
        VectorTrackingEnv(2, backend="warp")


@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_seeds_may_be_any_sequence(kind):
    env = VectorTrackingEnv(COUNT, SHORT, randomization=RANGES)
    found = [env.reset(seed=kind([5, 6, 7, 8]))[1]["variation_density"] for _ in range(2)]
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(found[0], env.reset(seed=5)[1]["variation_density"])
    with pytest.raises(ValueError, match="seed must be a number or 4 of them"):
        env.reset(seed=kind([1, 2]))


def test_a_divergence_of_one_is_called_so():
    """A state beyond MuJoCo's bound, though its curvature is beyond the workspace too."""
    many = VectorTrackingEnv(COUNT, "swing")
    many.reset()
    many.simulation.qvel[1] = 1e12
    *_, terminated, _, info = many.step(np.zeros((COUNT, 3), np.float32))
    assert terminated.tolist() == [False, True, False, False]
    assert info["failure"][1].startswith("simulation diverged")
