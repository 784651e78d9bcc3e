"""The environments that agents are trained in."""

from dataclasses import replace

import numpy as np
from gymnasium.vector import AutoresetMode

from softrobot_env.control.arm import neural
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.tasks import Task, make_task
from softrobot_env.training.references import draw_reference
from softrobot_env.training.rl_config import RLConfig
from softrobot_env.training.vec_env import TrackingVecEnv

#: Widths [m] and duration [s] of the steps.
_STEP_WIDTHS = (0.03, 0.05, 0.1, 0.2)
_STEP_DURATION = 1.5

#: Duration [s] of drawn references.
_DRAWN_DURATION = 6.0


def make_training_env(config: RLConfig, seed: int) -> TrackingVecEnv:
    """All tasks of a training at once, robots drawn anew for every episode."""
    rng = np.random.default_rng([seed, 1])  # the environments have streams of `seed` itself
    parts = [_part(config, task) for name in config.tasks for task in _tasks(config, name, rng)]
    env = TrackingVecEnv(parts, stagger=True, reward_scale=1 - config.discount)
    env.seed(seed)
    return env


def _tasks(config: RLConfig, name: str, rng: np.random.Generator) -> list[Task]:
    if name == "step":
        return [replace(make_task("step", w), duration=_STEP_DURATION) for w in _STEP_WIDTHS]
    if name == "drawn":
        return [draw_reference(rng, _DRAWN_DURATION) for _ in range(config.drawn_tasks)]
    return [make_task(name)] * 2


def _part(config: RLConfig, task: Task) -> VectorTrackingEnv:
    return VectorTrackingEnv(
        config.envs_per_task,
        task,
        control_period=neural.PERIOD,
        preview=neural.PREVIEW,
        reward=TrackingReward(fine_scale=config.fine_scale),
        randomization=config.randomization,
        threads=config.threads,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
