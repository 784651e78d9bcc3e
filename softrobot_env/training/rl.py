"""Reinforcement learning of a network on all tasks at once (stable-baselines3)."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed

from softrobot_env.artifacts import read_facts
from softrobot_env.control.arm import neural
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.interfaces import Show
from softrobot_env.learned.network import Network
from softrobot_env.tasks import Task, make_task
from softrobot_env.training.learners import LEARNERS, freeze_actor, make_model, put_actor
from softrobot_env.training.references import draw_reference
from softrobot_env.training.rl_config import RLConfig
from softrobot_env.training.vec_env import NetworkVecEnv
from softrobot_env.training.watch import Point, Watch, curve_of

#: Files of a checkpoint, besides those of `watch`.
_MODEL, _BUFFER, _CONFIG = "model.zip", "buffer.pkl", "config.json"


#: Widths [m] and duration [s] of the steps.
_STEP_WIDTHS = (0.03, 0.05, 0.1, 0.2)
_STEP_DURATION = 1.5

#: Duration [s] of drawn references.
_DRAWN_DURATION = 6.0


def train(
    config: RLConfig,
    seed: int,
    show: Show,
    start: Network | None = None,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    log: Path | None = None,
) -> tuple[Network, list[Point]]:
    """Train from a network, or from scratch.

    Args:
        config: Size and settings.
        seed: Of everything random.
        show: Told the progress.
        start: Network to start from.
        checkpoint: Folder that is written to at every closed-loop check, if given.
        resume: Whether to go on with the training that the folder holds: with other draws, new
            episodes, and the learning rate that so many of all steps are left for.
        log: Folder of TensorBoard's logs (needs the package tensorboard), none unless given.

    Returns:
        The network that did best in the checks, the one to start from among them, and the
        learning curve.

    Raises:
        FileNotFoundError: Nothing to go on with.
        ValueError: The training to go on with had other settings (its steps alone may differ), the
            folder holds one that is not finished, or the network to start from does not fit.
    """
    torch.set_num_threads(config.threads)
    logs = None if log is None else str(log)
    watch = Watch(config, show, lambda model: _save(model, config, seed, checkpoint))
    if resume:
        _check_same(config, seed, checkpoint)
        watch.load(checkpoint)
        model = _load(config, seed, checkpoint, watch.steps)
        model.tensorboard_log = logs
    else:
        _check_free(checkpoint)
        set_random_seed(seed)
        model = make_model(config, make_training_env(config, seed), seed, logs)
        begin(model, config, start)
    watch.folder = checkpoint
    left = config.steps - (model.num_timesteps if resume else 0)
    if left > 0:
        model.learn(left, callback=watch, reset_num_timesteps=not resume)
        watch.judge()
    model.get_env().close()
    return watch.best, watch.curve


def make_training_env(config: RLConfig, seed: int) -> NetworkVecEnv:
    """All tasks of a training at once, robots drawn anew for every episode."""
    rng = np.random.default_rng([seed, 1])  # the environments have streams of `seed` itself
    parts = [_part(config, task) for name in config.tasks for task in _tasks(config, name, rng)]
    env = NetworkVecEnv(parts, stagger=True, reward_scale=1 - config.discount)
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


def begin(model: BaseAlgorithm, config: RLConfig, start: Network | None) -> None:
    """Put the network to start from, and let the critic learn from what it does."""
    if start is None:
        return
    put_actor(model, config, start)
    if hasattr(model, "learning_starts"):
        model.learning_starts = 0  # until then actions would be random
    if config.critic_steps:
        freeze_actor(model, config, True)
        model.learn(config.critic_steps, tb_log_name="critic")
        freeze_actor(model, config, False)


def _save(model: BaseAlgorithm, config: RLConfig, seed: int, folder: Path | None) -> None:
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    (folder / _CONFIG).write_text(_told(config, seed), encoding="utf-8")
    model.save(folder / _MODEL)
    if hasattr(model, "save_replay_buffer"):
        model.save_replay_buffer(folder / _BUFFER)


def _load(config: RLConfig, seed: int, folder: Path, steps: int) -> BaseAlgorithm:
    """The learner of a checkpoint, with draws that depend on the steps done."""
    env = make_training_env(config, seed)
    model = LEARNERS[config.algorithm].model.load(folder / _MODEL, env=env, device="cpu")
    model.set_random_seed(int(np.random.SeedSequence([seed, steps]).generate_state(1)[0] >> 1))
    if hasattr(model, "load_replay_buffer"):
        model.load_replay_buffer(folder / _BUFFER)
    return model


def _told(config: RLConfig, seed: int) -> str:
    """Settings and seed as text."""
    return json.dumps({**asdict(config), "seed": seed}, indent=1, sort_keys=True) + "\n"


def _check_free(folder: Path | None) -> None:
    """Refuse to overwrite a training that somebody may want to go on with."""
    path = None if folder is None else folder / _CONFIG
    if path is None or not path.is_file():
        return
    planned = read_facts(path)["steps"]
    if curve_of(folder)[-1]["steps"] < planned:
        raise ValueError(
            f"{folder} holds a training that is not finished: resume it, delete it or choose "
            "another folder"
        )


def _check_same(config: RLConfig, seed: int, folder: Path | None) -> None:
    """Refuse to go on with another training."""
    path = None if folder is None else folder / _CONFIG
    if path is None or not path.is_file():
        raise FileNotFoundError(f"no training to go on with in {folder}")
    wanted, found = json.loads(_told(config, seed)), read_facts(path)
    differ = [k for k in wanted if k != "steps" and wanted[k] != found.get(k)]
    if differ:
        raise ValueError(
            f"the training in {folder} had other settings: "
            + ", ".join(f"{k} {found.get(k)!r}" for k in differ)
        )
