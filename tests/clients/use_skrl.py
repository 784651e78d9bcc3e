"""skrl: `wrap_env`, which tells environments by their direct bases."""

import gymnasium
import torch
from skrl.envs.wrappers.torch import wrap_env
from uses import SIMULATED, tried

STEPS = 12


def play(env) -> None:
    assert type(env).__name__ == "GymnasiumWrapper"
    env.reset()
    for _ in range(STEPS):
        observation, reward, *_ = env.step(torch.zeros(env.num_envs, *env.action_space.shape))
        assert observation.shape[0] == reward.shape[0] == env.num_envs
        assert torch.isfinite(observation).all() and torch.isfinite(reward).all()
    env.close()


tried("wrap_env, one", SIMULATED, lambda env_id: play(wrap_env(gymnasium.make(env_id))))
tried(
    "wrap_env, batch",
    SIMULATED,
    lambda env_id: play(wrap_env(gymnasium.make_vec(env_id, num_envs=3))),
)
