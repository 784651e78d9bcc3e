"""The contract of the test rig's environments: that of `TrackingEnv`, servos, twins and camera."""

import copy
import pickle
import warnings
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation
from support.rig_episodes import TWINS, act, flatten, rig, steps

from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.evaluation.run import run_episode
from softrobot_env.registration import RIG_ENVIRONMENTS
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import RIG_TASKS
from softrobot_env.thesis.envs import RigEnv


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


@TWINS
def test_observations_stay_inside_the_space(twin):
    env = rig("reach", twin=twin)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for observation, reward, terminated, truncated, info in steps(env, 300):
        assert env.observation_space.contains(observation)
        assert isinstance(reward, float)
        assert type(terminated) is type(truncated) is bool
        assert np.all(info["tendon_tension"] >= 0)
    assert not terminated


def test_flattened():
    env = FlattenObservation(gymnasium.make("SoftRobot/RigReach-v0"))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


def test_environments_simulate_the_registered_scene():
    assert rig().scene.config == SCENES["rig"]


# ---------------------------------------------------------------- determinism, copies, memory


@TWINS
def test_episodes_repeat_bitwise(twin):
    env, other = rig(twin=twin), rig(twin=twin)
    runs = []
    for each in (env, other, env):
        start = each.reset(seed=7)
        runs.append(flatten((*start, *steps(each, 60))))
    assert runs[0] == runs[1] == runs[2]


def test_only_the_camera_depends_on_the_seed():
    env = rig()
    assert flatten(env.reset(seed=1)) == flatten(env.reset(seed=2))
    env = rig(twin=0)
    one, two = env.reset(seed=1)[0], env.reset(seed=2)[0]
    different = {name for name in one if np.any(one[name] != two[name])}
    assert different == {"tip_position", "tip_velocity"}


@pytest.mark.parametrize("way", [lambda e: pickle.loads(pickle.dumps(e)), copy.deepcopy])
@TWINS
def test_copies_continue_bitwise(way, twin):
    env = rig(twin=twin)
    env.reset(seed=0)
    list(steps(env, 20))
    other = way(env)
    assert flatten(tuple(steps(other, 40, 1))) == flatten(tuple(steps(env, 40, 1)))
    assert flatten(other.reset()) == flatten(env.reset())


@pytest.mark.parametrize("way", [lambda e: pickle.loads(pickle.dumps(e)), copy.deepcopy])
@TWINS
def test_copies_are_independent(way, twin):
    env, untouched = rig(twin=twin), rig(twin=twin)
    env.reset(seed=0), untouched.reset(seed=0)
    list(steps(way(env), 20, 1))
    assert flatten(tuple(steps(env, 5))) == flatten(tuple(steps(untouched, 5)))


@pytest.mark.parametrize("period", [0.004, 0.02])  # a picture of several instants, and of one
@TWINS
def test_results_share_no_memory(twin, period):
    env = rig(twin=twin, control_period=period)
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
def test_episode_lasts_as_long_as_the_task(period):
    env = rig(control_period=period)
    env.reset(options={"duration": 0.6})
    results = list(steps(env, 1000))
    assert len(results) == round(0.6 / period)
    assert [truncated for *_, truncated, _ in results] == [False] * (len(results) - 1) + [True]
    assert results[-1][-1]["time"] == pytest.approx(0.6)
    assert env.data.time == pytest.approx(0.6)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(act(env))


def test_pairs_of_instants_are_a_period_apart():
    env = rig(control_period=0.05)
    times = [env.reset()[1]["time"]] + [info["time"] for *_, info in steps(env, 20)]
    assert all(b - a == pytest.approx(0.05) for a, b in pairwise(times))


def test_no_step_before_the_first_reset():
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        rig().step(np.zeros(3, np.float32))


@pytest.mark.parametrize("bad", [np.full(3, np.nan), np.full(3, 1.1), np.zeros(2), [0, 0], None])
def test_bad_actions_are_named_and_change_nothing(bad):
    env, untouched = rig(), rig()
    env.reset(), untouched.reset()
    with pytest.raises(ValueError, match=r"3 numbers in \[-1, 1\]"):
        env.step(bad)
    assert flatten(tuple(steps(env, 3))) == flatten(tuple(steps(untouched, 3)))


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
