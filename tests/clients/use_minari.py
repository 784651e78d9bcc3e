"""Minari: episodes recorded with `info`, read again, and their environment made again."""

import os
from tempfile import TemporaryDirectory

import gymnasium
import numpy as np
from uses import SIMULATED, tried


def record(env_id: str) -> None:
    import minari

    env = minari.DataCollector(gymnasium.make(env_id, control_period=0.2), record_infos=True)
    for seed in range(2):
        env.reset(seed=seed)
        over = False
        while not over:
            *_, terminated, truncated, _ = env.step(env.action_space.sample() * np.float32(0.1))
            over = terminated or truncated
    name = f"softrobot/{env_id.split('/')[1].lower()}-v0"
    data = env.create_dataset(dataset_id=name, algorithm_name="random", author="tests")
    again = minari.load_dataset(name)
    assert again.total_episodes == 2 and again.total_steps == data.total_steps
    for episode in again.iterate_episodes():
        assert len(episode.infos["reward_tracking"]) == len(episode.rewards) + 1
        assert np.isfinite(episode.rewards).all()
    assert again.recover_environment().spec.max_episode_steps == env.spec.max_episode_steps
    env.close()


with TemporaryDirectory() as folder:
    os.environ["MINARI_DATASETS_PATH"] = folder
    tried("record with info, load, make again", SIMULATED, record)
