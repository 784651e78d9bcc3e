"""The contract of the test rig's environments: that of `TrackingEnv`, servos, twins and camera."""

from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation
from support.rig_episodes import TWINS, act, flatten, rig, steps

from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.evaluation.run import run_episode
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import RIG_TASKS
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


def test_flattened():
    env = FlattenObservation(gymnasium.make("SoftRobot/RigReach-v0"))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


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
