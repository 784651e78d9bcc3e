"""Vectors and dicts of any robot for learners: one environment of stable-baselines3, and policies.

What learned on vectors decides by name and by file as it did where it learned.
"""

import warnings

import gymnasium
import numpy as np
import pytest
from support.commands import evaluated
from support.example_robots import EVERY_ROBOT

from softrobot_env.control.registry import (
    as_policy,
    make_policy,
    policy_environment,
    policy_name,
)
from softrobot_env.robots import ARM, find_robot, read_robot, write_robot
from softrobot_env.training.request import file_of

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402

from softrobot_env.training.artifacts import save_vector_policy  # noqa: E402
from softrobot_env.training.vec_env import make_vec_env  # noqa: E402

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


def test_gymnasiums_wrappers_see_the_same_of_batched_and_of_single_environments():
    wrappers, seen = gymnasium.wrappers.vector, []
    for mode in ("vector_entry_point", "sync"):
        made = gymnasium.make_vec("SoftRobot/ArmStep-v0", num_envs=2, vectorization_mode=mode)
        env = wrappers.ClipAction(wrappers.RecordEpisodeStatistics(made))
        env = wrappers.NormalizeObservation(wrappers.FlattenObservation(env))
        env = wrappers.NormalizeReward(env, gamma=0.99)
        env.reset(seed=0)
        rng = np.random.default_rng(0)
        steps = [env.step(rng.normal(0, 0.3, env.action_space.shape)) for _ in range(32)]
        seen.append([np.concatenate([step[k].ravel() for step in steps]) for k in (0, 1)])
        env.close()
    np.testing.assert_allclose(np.concatenate(seen[0]), np.concatenate(seen[1]), rtol=1e-4)


# ---------------------------------------------------------------- policies of files

FINGER = {"robot": "planar_finger", "task": "circle"}


def layers(env, hidden=torch.nn.Tanh):
    """An untrained actor of an environment."""
    torch.manual_seed(0)
    seen, given = env.observation_space.shape[0], env.action_space.shape[0]
    return torch.nn.Sequential(torch.nn.Linear(seen, 8), hidden(), torch.nn.Linear(8, given))


def decided(actor, seen):
    with torch.no_grad():
        return actor(torch.as_tensor(seen)).clamp(-1, 1).numpy()


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        ("SoftRobot/ArmSwing-v0", {}),
        ("SoftRobot/ArmSwing-v0", {"act_as": "input"}),
        ("SoftRobot/Track-v0", FINGER | {"preview": (0.01, 0.05), "control_period": 0.002}),
        ("SoftRobot/RigReach-v0", {}),
    ],
    ids=["arm", "arm, inputs", "finger", "rig"],
)
def test_a_policy_of_a_file_moves_as_the_network_did_where_it_learned(env_id, options, tmp_path):
    vectors = gymnasium.make(env_id, observe_as="vector", **options)
    actor, file = layers(vectors), tmp_path / "mine.npz"
    save_vector_policy(file, actor, vectors)
    own = {k: v for k, v in options.items() if k != "act_as"}
    dicts = gymnasium.make(env_id, observe="all", **own)
    policy = make_policy(str(file), dicts)
    (seen, _), (shown, _) = vectors.reset(seed=3), dicts.reset(seed=3)
    state = None
    for _ in range(20):
        seen, *_ = vectors.step(decided(actor, seen))
        action, state = policy.predict({n: shown[n] for n in policy.requires}, state)
        shown, *_ = dicts.step(action)
    np.testing.assert_allclose(
        shown["previous_action"], dicts.unwrapped._action_array, rtol=1e-6, atol=1e-6
    )
    both = vectors.unwrapped._action_array, dicts.unwrapped._action_array
    np.testing.assert_allclose(*both, rtol=1e-4, atol=1e-5)


def test_numpy_and_machine_code_decide_alike(tmp_path):
    env = gymnasium.make("SoftRobot/ArmStep-v0", observe_as="vector")
    save_vector_policy(tmp_path / "mine.npz", layers(env), env)
    policy = make_policy(str(tmp_path / "mine.npz"), ARM, 0.01)
    rng = np.random.default_rng(0)
    seen = {name: rng.normal(0, 0.3, (50, policy.sizes[name])) for name in policy.requires}
    fast, _ = policy.predict(seen)
    np.testing.assert_allclose(fast, policy.plain(seen)[0], atol=1e-6)
    seen["tip_position"][7] = np.nan
    actions, states = policy.predict(seen)
    assert "not finite" in states[7].status and states[8].status is None
    np.testing.assert_allclose(actions[7], np.clip(seen["previous_action"][7], -1, 1), atol=1e-6)


def test_a_model_is_found_beside_its_robot_and_evaluated(tmp_path):
    """One of stable-baselines3, under the name that policies are looked for by."""
    write_robot(find_robot("planar_finger"), tmp_path / "mine.toml")
    robot = read_robot(tmp_path / "mine.toml")
    options = {"robot": str(robot.file), "task": "circle", "control_period": 0.002}
    env = make_vec_env("SoftRobot/Track-v0", 2, observe_as="vector", **options)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, seed=0, device="cpu")
    save_vector_policy(file_of(robot, "ppo"), model, env)
    assert policy_environment("ppo", robot)["control_period"] == 0.002
    policy, seen = make_policy("ppo", robot, 0.002), env.reset()
    assert policy.sizes["previous_action"] == 2 and seen.shape[1] == len(policy._encoding.take)
    words = "--tasks circle --policies ppo --duration 0.05 --robot"
    assert evaluated(tmp_path / "out", words, robot.file)


def test_what_cannot_be_written_says_why(tmp_path):
    file = tmp_path / "mine.npz"
    dicts, vectors = (
        gymnasium.make("SoftRobot/ArmStep-v0", observe_as=how) for how in ("dict", "vector")
    )
    with pytest.raises(ValueError, match="shows no vectors"):
        save_vector_policy(file, torch.nn.Linear(3, 3), dicts)
    with pytest.raises(ValueError, match="not Linear, ReLU, Linear"):
        save_vector_policy(file, layers(vectors, torch.nn.ReLU), vectors)
    with pytest.raises(ValueError, match=r"must have \d+ inputs and 3 outputs, it has 3 and 3"):
        save_vector_policy(file, torch.nn.Linear(3, 3), vectors)
    assert not file.exists()


def test_what_cannot_be_read_says_why(tmp_path):
    env = gymnasium.make("SoftRobot/ArmStep-v0", observe_as="vector")
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    with pytest.raises(ValueError, match=r"reads one vector of \d+ .*save_vector_policy"):
        as_policy(model, "mine")
    file = str(tmp_path / "mine.npz")
    save_vector_policy(tmp_path / "mine.npz", model, env)
    assert policy_name(file) == "mine"
    with pytest.raises(ValueError, match="mine has not been trained for robot 'planar_finger'"):
        make_policy(file, find_robot("planar_finger"), 0.01)
    with pytest.raises(ValueError, match=r"decides every 0\.01 s"):
        make_policy(file, ARM, 0.02)
    values = dict(np.load(file))
    values["about_vector_take"] += 99
    np.savez(file, **values)
    with pytest.raises(ValueError, match=r"mine\.npz tells no vector"):
        make_policy(file, ARM, 0.01)


def test_a_network_may_read_raw_sensors(tmp_path):
    raw = ("sensors", "reference", "previous_action")
    env = gymnasium.make("SoftRobot/RigReach-v0", twin=0, observe=raw, observe_as="vector")
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    model.learn(8)
    save_vector_policy(tmp_path / "felt.npz", model, env)
    words = "--tasks reach --duration 1 --no-plots --policies"
    assert evaluated(tmp_path / "out", words, tmp_path / "felt.npz")


def test_files_of_networks_that_read_features_are_policies_too(tmp_path):
    """As `softrobot train` writes them; the arm's shipped one."""
    policy = make_policy(str(file_of(ARM, "ppo")), ARM, 0.01)
    assert type(policy) is type(make_policy("ppo", ARM, 0.01))
