"""Many robots at once are the single robot, step for step."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.simulation import warp_limits
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots.variations import neutral
from softrobot_env.tasks import make_task

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


def actions(steps, seed=0):
    """Actions (steps, COUNT, 3) that move the arms in different ways."""
    return np.random.default_rng(seed).uniform(-0.3, 0.3, (steps, COUNT, 3)).astype(np.float32)


def same(one, other, i, tolerance=0.0):
    """Whether a single observation is the i-th of several."""
    assert list(one) == list(other)
    for name, value in one.items():
        np.testing.assert_allclose(other[name][i], value, rtol=0, atol=tolerance, err_msg=name)


# Sums of two hinge angles are rounded differently in one place; the physics is equal bit by bit.
ROUNDING = 1e-11


def test_episodes_are_those_of_the_single_environment():
    """Observations, rewards, ends and info over several episodes, resets included."""
    many = VectorTrackingEnv(COUNT, SHORT, observe="all", autoreset_mode="NextStep")
    single = TrackingEnv(SHORT, observe="all")
    observations, infos = many.reset(seed=3)
    observation, info = single.reset(seed=3)
    same(observation, observations, 2, ROUNDING)
    over = False
    for action in actions(70):
        observations, rewards, terminated, truncated, infos = many.step(action)
        if over:
            observation, info = single.reset()
            reward, ended, cut = 0.0, False, False
        else:
            observation, reward, ended, cut, info = single.step(action[2])
        over = ended or cut
        same(observation, observations, 2, ROUNDING)
        assert rewards[2] == pytest.approx(reward, abs=1e-12)
        assert (terminated[2], truncated[2]) == (ended, cut)
        assert list(info) == [name for name in infos if name[0] != "_"]
        for name, value in info.items():
            assert infos[f"_{name}"].all()
            np.testing.assert_allclose(infos[name][2], value, atol=ROUNDING, err_msg=name)


def test_physics_with_friction_is_equal_bit_by_bit():
    """One arm of four rubs; the others stay what they are without constraints."""
    many, single = VectorTrackingEnv(COUNT, "swing"), TrackingEnv("swing")
    friction = np.array([0.0, 1.5, 0.0, 0.3])
    many.reset(options={"vary": {"tendon_friction": friction}})
    for i in range(COUNT):
        many.reset(options={"vary": {"tendon_friction": friction}})
        single.reset(options={"vary": {"tendon_friction": friction[i]}})
        for action in actions(100):
            many.step(action)
            single.step(action[i])
        np.testing.assert_array_equal(many.simulation.qpos[i], single.data.qpos)
        np.testing.assert_array_equal(many.simulation.qvel[i], single.data.qvel)
    # Without friction again.
    many.reset()
    single.reset()
    for action in actions(50):
        many.step(action)
        single.step(action[1])
    np.testing.assert_array_equal(many.simulation.qpos[1], single.data.qpos)


def test_the_number_of_threads_does_not_matter():
    ends = []
    for threads in (1, 2):
        env = VectorTrackingEnv(COUNT, "swing", threads=threads)
        env.reset()
        for action in actions(30):
            observation, *_ = env.step(action)
        ends.append(observation["tip_position"])
    np.testing.assert_array_equal(*ends)


# ---------------------------------------------------------------- autoreset


def test_same_step_autoreset_tells_the_last_observation_and_the_new_episode():
    how = {"randomization": RANGES, "observe": "all"}
    same_step = VectorTrackingEnv(COUNT, SHORT, autoreset_mode=AutoresetMode.SAME_STEP, **how)
    next_step = VectorTrackingEnv(COUNT, SHORT, **how)
    (_, start), _ = same_step.reset(seed=0), next_step.reset(seed=0)
    for k, action in enumerate(actions(30)):
        observation, _, _, truncated, info = same_step.step(action)
        last, *_ = next_step.step(action)
        assert ("final_obs" in info) == (k == 29)
    assert truncated.all() and info["_final_obs"].all() and info["_final_info"].all()
    for name, value in last.items():
        np.testing.assert_array_equal(info["final_obs"][name], value)
    new, *_ = next_step.step(action)
    for name, value in new.items():
        np.testing.assert_array_equal(observation[name], value)
    final = info["final_info"]
    np.testing.assert_array_equal(final["time"], np.full(COUNT, 0.3))
    np.testing.assert_array_equal(info["time"], 0.0)
    assert not info["reward_tracking"].any() and np.all(final["reward_tracking"] > 0)
    modulus = "variation_youngs_modulus"
    np.testing.assert_array_equal(final[modulus], start[modulus])
    assert not np.any(info[modulus] == start[modulus])


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


# ---------------------------------------------------------------- variation


@pytest.mark.parametrize(
    "vary",
    [
        {"youngs_modulus": 0.6},
        {"density": 1.3},
        {"damping_time": 0.4},
        {"tendon_radius": 0.8},
        {"youngs_modulus": 1.2, "density": 0.7},
        {"tendon_friction": 0.7},
        {"tension_gain": 0.9},
        {"delay": 0.03},
        {"youngs_modulus": 0.5, "tendon_friction": 0.5},
        {"youngs_modulus": 0.9, "tension_gain": 1.2, "delay": 0.05, "tendon_friction": 0.2},
    ],
)
def test_variations_are_those_of_the_single_environment(vary):
    many = VectorTrackingEnv(COUNT, SHORT, observe="all")
    single = TrackingEnv(SHORT, observe="all")
    others = {name: (0.07, 0.0, 0.01) if name == "delay" else (1.0, 0.9, 1.1) for name in vary}
    values = {name: np.insert(others[name], 2, value) for name, value in vary.items()}
    observations, _ = many.reset(options={"vary": values})
    observation, _ = single.reset(options={"vary": vary})
    for action in actions(29):
        same(observation, observations, 2, 1e-7)
        observations, *_ = many.step(action)
        observation, *_ = single.step(action[2])
    # And the next episode is nominal again.
    many.step(action)
    observations, *_ = many.step(action)
    same(single.reset()[0], observations, 2, ROUNDING)


def reported(info):
    """What `info` tells of the variation."""
    return {name: value for name, value in info.items() if name.startswith("variation_")}


def test_draws_are_those_of_the_single_environment_with_the_same_seed():
    many = VectorTrackingEnv(COUNT, SHORT, randomization=RANGES)
    drawn = [reported(many.reset(seed=7)[1])]
    for _ in range(31):  # into the second episode
        _, _, _, _, info = many.step(np.zeros((COUNT, 3)))
    drawn.append(reported(info))
    single = TrackingEnv(SHORT, randomization=RANGES)
    for i in range(COUNT):
        for k, options in enumerate(({"seed": 7 + i}, {})):
            variation = reported(single.reset(**options)[1])
            assert variation == {name: values[i] for name, values in drawn[k].items()}
    assert len(set(drawn[0]["variation_youngs_modulus"])) == COUNT
    assert len(set(drawn[0]["variation_sensor_noise"])) == COUNT


def test_noise_is_that_of_the_single_environment_with_the_same_seed():
    """Over blocks of draws and several episodes, with silent sensors beside noisy ones."""
    long = replace(make_task("lshape"), duration=1.0)
    many = VectorTrackingEnv(COUNT, long, observe="all")
    single = TrackingEnv(long, observe="all")
    scale = np.array([0.0, 1.0, 2.0, 0.0])
    for seed in (5, None):
        observations, infos = many.reset(seed=seed, options={"vary": {"sensor_noise": scale}})
        seeds = None if seed is None else seed + 2
        observation, info = single.reset(seed=seeds, options={"vary": {"sensor_noise": 2.0}})
        same(observation, observations, 2, ROUNDING)
        for action in actions(99):
            observations, rewards, *_, infos = many.step(action)
            observation, reward, *_, info = single.step(action[2])
            same(observation, observations, 2, ROUNDING)
            assert rewards[2] == pytest.approx(reward, abs=1e-12)
            assert many.observation_space.contains(observations)
            for name in ("tip_position", "curvature"):
                assert infos[f"_{name}"].tolist() == [False, True, True, False]
                np.testing.assert_allclose(infos[name][2], info[name], atol=ROUNDING)
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
    same(observation, observations, 1, ROUNDING)
    for k, action in enumerate(actions(29)):
        observations, _, terminated, truncated, _ = env.step(action)
        same(single.step(action[1])[0], observations, 1, ROUNDING)
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
    expected = {f"variation_{name}": value for name, value in neutral().items()}
    assert reported(info) == expected | {"variation_density": 1.1}


def test_new_ranges_leave_the_draws_of_the_others_alone():
    fewer = replace(RANGES, tension_gain=(1.0, 1.0), tendon_friction=(0.0, 0.0))
    drawn = [r.draw(np.random.default_rng(4)) for r in (fewer, RANGES)]
    for name in ("youngs_modulus", "density", "damping_time", "tendon_radius"):
        assert drawn[0][name] == drawn[1][name]
    assert "tension_gain" not in drawn[0]
    assert "tension_gain" in drawn[1]


# ---------------------------------------------------------------- failures and bad input


def test_a_failed_episode_is_told_and_disturbs_no_other():
    """Full pull folds a soft arm; a nominal one beside it only bends."""
    many, single = VectorTrackingEnv(COUNT, "swing"), TrackingEnv("swing")
    soft = np.array([1.0, 0.2, 1.0, 1.0])
    many.reset(options={"vary": {"youngs_modulus": soft}})
    single.reset()
    gentle = np.zeros((COUNT, 3), np.float32)
    gentle[1] = 1.0
    before = None
    for _ in range(300):
        observations, rewards, terminated, _, infos = many.step(gentle)
        observation, *_ = single.step(gentle[0])
        if terminated[1]:
            break
        before = observations
    assert terminated.tolist() == [False, True, False, False]
    assert " at t = " in infos["failure"][1] and infos["failure"][0] is None
    assert rewards[1] == -10.0 and rewards[0] > -1.0
    for name, value in observations.items():
        np.testing.assert_array_equal(value[1], before[name][1])
    same(observation, observations, 0, ROUNDING)


def test_failures_are_told_as_by_the_single_environment():
    """Bent to just inside the limit, a soft arm folds in the next period."""
    options = {"start_curvature": np.full(6, 39.9), "vary": {"youngs_modulus": 0.2}}
    many, single = VectorTrackingEnv(COUNT, "swing"), TrackingEnv("swing")
    many.reset(options=options)
    single.reset(options=options)
    over = False
    while not over:
        *_, infos = many.step(np.ones((COUNT, 3)))
        _, _, over, _, info = single.step(np.ones(3))
    assert info["failure"].startswith("left the workspace: curvature")
    assert infos["failure"].tolist() == [info["failure"]] * COUNT


def test_warp_says_what_to_install(monkeypatch):
    monkeypatch.setattr(warp_limits, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"^backend 'warp' needs mujoco_warp, torch: pip install"):
        VectorTrackingEnv(2, backend="warp")


def test_observations_belong_to_the_caller():
    env = VectorTrackingEnv(COUNT, SHORT, observe="all")
    observation, _ = env.reset()
    kept = {name: value.copy() for name, value in observation.items()}
    other, *_ = env.step(np.zeros((COUNT, 3)))
    for name, value in observation.items():
        np.testing.assert_array_equal(value, kept[name])
        value += 1.0
        other[name] += 1.0
    again, *_ = env.step(np.zeros((COUNT, 3)))
    assert env.observation_space.contains(again)


@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_seeds_may_be_any_sequence(kind):
    env = VectorTrackingEnv(COUNT, SHORT, randomization=RANGES)
    found = [env.reset(seed=kind([5, 6, 7, 8]))[1]["variation_density"] for _ in range(2)]
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(found[0], env.reset(seed=5)[1]["variation_density"])
    with pytest.raises(ValueError, match="seed must be a number or 4 of them"):
        env.reset(seed=kind([1, 2]))


@pytest.mark.parametrize(
    "vary",
    [
        {"damping_time": 0.02},
        {"damping_time": 0.0},
        {"youngs_modulus": 100.0, "damping_time": 0.01},
        {"youngs_modulus": 0.5, "damping_time": 0.1, "density": 2.0},
    ],
)
@pytest.mark.filterwarnings("ignore:robot 'arm'")
def test_robots_far_from_the_nominal_one_are_equal(vary):
    """Each robot takes the steps that it needs, alone or among others.

    Products of several factors are rounded differently, which lively motions amplify.
    """
    many, single = VectorTrackingEnv(COUNT, "swing"), TrackingEnv("swing")
    arrays = {name: np.where(np.arange(COUNT) == 1, v, 1.0) for name, v in vary.items()}
    many.reset(options={"vary": arrays})
    single.reset(options={"vary": vary})
    for action in actions(60):
        *_, terminated, _, _ = many.step(action)
        single.step(action[1])
        assert not terminated.any()
    np.testing.assert_allclose(many.simulation.qpos[1], single.data.qpos, rtol=0, atol=1e-9)
    np.testing.assert_allclose(many.simulation.qvel[1], single.data.qvel, rtol=0, atol=1e-7)
    estimate = many.simulation.integration_error[1]
    assert estimate == pytest.approx(single.simulation.integration_error, rel=1e-6)


def test_a_divergence_of_one_is_called_so():
    """A state beyond MuJoCo's bound, though its curvature is beyond the workspace too."""
    many = VectorTrackingEnv(COUNT, "swing")
    many.reset()
    many.simulation.qvel[1] = 1e12
    *_, terminated, _, info = many.step(np.zeros((COUNT, 3), np.float32))
    assert terminated.tolist() == [False, True, False, False]
    assert info["failure"][1].startswith("simulation diverged")


def test_a_robot_that_needs_a_shorter_timestep_of_mujocos_is_refused():
    many = VectorTrackingEnv(COUNT, "swing", integrator="implicitfast")
    many.reset()
    stiff = {"youngs_modulus": 100.0, "damping_time": np.array([1.0, 0.01, 1.0, 1.0])}
    with pytest.raises(ValueError, match=r"robot 1 needs a timestep of .* with implicitfast"):
        many.reset(options={"vary": stiff})
