"""Tasks that are drawn from a seed: anew for every episode, or kept."""

import gymnasium
import numpy as np
import pytest

import softrobot_env  # noqa: F401
from softrobot_env.tasks import make_task

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
