"""One environment of stable-baselines3 for every robot: dicts and vectors, batch and single."""

import warnings

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from support.example_robots import EVERY_ROBOT

from softrobot_env.training.vec_env import make_vec_env

both_ways = pytest.mark.parametrize("observe_as", ["dict", "vector"])


def each(seen):
    """The arrays of an observation."""
    return list(seen.values()) if isinstance(seen, dict) else [seen]


@both_ways
@EVERY_ROBOT
def test_it_steps_as_the_single_environment(env_id, options, observe_as):
    env = make_vec_env(env_id, 2, seed=5, observe_as=observe_as, **options)
    single = gymnasium.make(env_id, observe_as=observe_as, **options)
    assert env.observation_space == single.observation_space
    assert env.action_space == single.action_space
    seed = env.seed(5)[1]
    all_seen, (seen, _) = env.reset(), single.reset(seed=seed)
    action = np.full((2, *env.action_space.shape), 0.1, np.float32)
    for _ in range(3):
        for many, one in zip(each(all_seen), each(seen), strict=True):
            np.testing.assert_allclose(many[1], one, atol=2e-6, rtol=1e-9)
            assert many.dtype == one.dtype
        all_seen, rewards, dones, infos = env.step(action)
        seen, reward, *_ = single.step(action[1])
        assert rewards[1] == pytest.approx(reward, abs=1e-9)
    assert not dones.any() and infos == [{}, {}]
    env.close()


@both_ways
def test_ends_carry_the_last_observation_and_the_episode(observe_as):
    env = make_vec_env("SoftRobot/RigReach-v0", 2, observe_as=observe_as, max_episode_steps=3)
    env.reset()
    action = np.zeros((2, 3), np.float32)
    for _ in range(3):
        seen, _, dones, infos = env.step(action)
    assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert env.observation_space.contains(infos[1]["terminal_observation"])
    for last, first in zip(each(infos[1]["terminal_observation"]), each(seen), strict=True):
        assert last.shape == first[1].shape
    assert infos[0]["episode"]["l"] == 3


@pytest.mark.parametrize(
    ("policy", "observe_as"), [("MlpPolicy", "vector"), ("MultiInputPolicy", "dict")]
)
def test_it_trains_evaluates_and_saves_without_warnings(policy, observe_as, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = make_vec_env("SoftRobot/RigReach-v0", 2, observe_as=observe_as, max_episode_steps=20)
        model = PPO(policy, env, n_steps=16, batch_size=16, n_epochs=1, device="cpu")
        model.learn(32)
        model.save(tmp_path / "model.zip")
        loaded = PPO.load(tmp_path / "model.zip", env=env, device="cpu")
        returns, lengths = evaluate_policy(loaded, env, 4, return_episode_rewards=True)
    assert lengths == [20] * 4 and np.isfinite(returns).all()


def test_the_real_rig_is_one():
    with pytest.raises(ValueError, match="one robot behind SoftRobot/RealRig-v0"):
        make_vec_env("SoftRobot/RealRig-v0", 2)
