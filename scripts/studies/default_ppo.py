"""PPO as stable-baselines3 comes, with checks of what it has learned."""

from collections.abc import Callable
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

#: Rollouts between two checks.
_BETWEEN = 3


def train(
    env: VecEnv, seed: int, steps: int, check: Callable[[PPO], float] | None = None, **settings: Any
) -> tuple[PPO, list[tuple[int, float]]]:
    """Train a policy with default settings, on one core.

    Args:
        env: With observations that are vectors.
        seed: Of everything random.
        steps: Of all environments together; the last rollout is finished.
        check: A figure of what was learned.
        **settings: Of PPO, others than its default.

    Returns:
        The policy; steps and figure before the training, after every few rollouts, and after it.
    """
    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env, seed=seed, device="cpu", **settings)
    checks = None if check is None else _Checks(check)
    model.learn(steps, callback=checks)
    if checks is None:
        return model, []
    checks.look()
    return model, checks.curve


class _Checks(BaseCallback):
    """Keeps what a check said after so many steps."""

    def __init__(self, check: Callable[[PPO], float]) -> None:
        super().__init__()
        self._check, self.curve = check, []

    def _on_rollout_start(self) -> None:
        if self.num_timesteps % (_BETWEEN * self.model.n_steps * self.model.n_envs) == 0:
            self.look()

    def look(self) -> None:
        self.curve.append((self.num_timesteps, self._check(self.model)))

    def _on_step(self) -> bool:
        return True
