"""Reinforcement learning of a network on all tasks at once (stable-baselines3)."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed

from softrobot_env.control.learned.neural import View
from softrobot_env.core.files import write_text
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.learned.network import Network
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.tasks import Task

from .artifacts import figures, load_start, save
from .checkpoint import Checkpoint, learner_state, put_learner_state, read, write
from .learners import freeze_actor, make_model, put_actor
from .references import seen_in, training_of, view_for
from .request import LEARNERS, Metrics, TrainingRequest, curve_file
from .rl_config import (
    IMITATION,
    NO_START,
    NUMBERS,
    QUICK,
    RLConfig,
    checkpoint_of,
    preset,
    wanted_in,
)
from .vec_env import NetworkVecEnv
from .watch import REACH, Point, Watch


def train(
    config: RLConfig,
    request: TrainingRequest,
    show: ProgressCallback,
    start: Network | None = None,
    view: View | None = None,
) -> tuple[Network, list[Point]]:
    """Train from a network, or from scratch.

    Args:
        config: Size and settings; `tasks` are the robot's own.
        request: Robot, seed and who receives the learning curve after each check, when the
            checkpoint is written; and among its settings `checkpoint`, the folder that is written
            to at every closed-loop check unless it is None, see `training.checkpoint`; `resume`,
            whether to go on with the training that the folder holds; `log`, the folder of
            TensorBoard's logs (needs the package tensorboard). A training that goes on with as
            many steps ends as if it had not been stopped, since all episodes and draws begin anew
            after every check; with more, the learning rate is that of so many left of all.
        show: Shows the progress.
        start: Network to start from.
        view: Of the networks; that of the robot unless given.

    Returns:
        The network that did best in the checks, the one to start from among them, and the
        learning curve.

    Raises:
        FileNotFoundError: Nothing to go on with.
        ValueError: The training to go on with had other settings (its steps alone may differ), the
            folder holds one that is not finished, or the network to start from does not fit.
    """
    torch.set_num_threads(config.threads)
    robot, view = seen_in(request.robot, view)
    settings, seed = request.settings, request.seed
    checkpoint, resume = checkpoint_of(settings, request.path), settings.get("resume", False)
    logs = str(settings["log"]) if "log" in settings else None
    about = _about(config, seed, robot)

    def keep(model: BaseAlgorithm, best: Network, curve: list[Point]) -> None:
        if checkpoint is not None:
            write(checkpoint, Checkpoint(about, curve, best, learner_state(model)))
        if request.report is not None:
            request.report(curve)

    watch = Watch(config, show, keep, robot, view, None if checkpoint is None else seed)
    before = _to_go_on_with(checkpoint, about, show) if resume else None
    if before is None:
        _check_free(checkpoint)
        set_random_seed(seed)
    model = make_model(config, make_training_env(config, seed, robot, view), seed, logs)
    if before is None:
        begin(model, config, start)
    else:
        watch.best, watch.curve = before.best, before.curve
        put_learner_state(model, before.learner)
    left = config.steps - (model.num_timesteps if resume else 0)
    if left > 0:
        model.learn(left, callback=watch, reset_num_timesteps=not resume)
        watch.judge()
    model.get_env().close()
    return watch.best, watch.curve


def run(policy: str, request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Train one of `LEARNERS` as requested; write the network and beside it its learning curve.

    Raises:
        FileNotFoundError, ValueError: As `train`; or a setting that does not exist or is no number.
    """
    config = config_of(policy, request.settings, request.robot)
    start, view = _start(request)
    network, curve = train(config, request, show, start, view)
    save(network, request.path, request.seed, request.robot, view)
    written = curve_file(request.path)
    write_text(written, json.dumps(curve, indent=1) + "\n")
    return [*figures(network, config.trials, request.robot, view), ("learning curve", str(written))]


def config_of(policy: str, settings: Mapping[str, Any], robot: RobotParams) -> RLConfig:
    """Settings of a training of `LEARNERS`, by those that are given (`commands.train`).

    Raises:
        ValueError: A setting that does not exist or is no number, or one out of range.
    """
    algorithm, randomized = LEARNERS[policy]
    warm = settings.get("start") != NO_START
    config = preset(algorithm, warm, settings.get("randomize", randomized))
    config = training_of(robot).settings(config)
    wanted: dict[str, Any] = dict(QUICK) if "quick" in settings else {}
    wanted |= {name: settings[name] for name in ("backend", "device") if name in settings}
    wanted |= wanted_in(settings, NUMBERS, training_of(robot).tasks, robot.name)
    return replace(config, **wanted)


def save_kept(request: TrainingRequest, folder: Path) -> None:
    """Write the best network of a checkpoint as `run` writes it, and its learning curve.

    Raises:
        FileNotFoundError, ValueError: There is none in the folder, or it is damaged.
    """
    found = read(folder)
    if found is None:
        raise FileNotFoundError(f"no checkpoint in {folder}")
    save(found.best, request.path, request.seed, request.robot, _start(request)[1])
    write_text(curve_file(request.path), json.dumps(found.curve, indent=1) + "\n")


def check_request(policy: str, request: TrainingRequest) -> None:
    """Refuse what `run` would refuse of settings and network; ValueError as there."""
    config_of(policy, request.settings, request.robot)
    _start(request)


def _start(request: TrainingRequest) -> tuple[Network | None, View]:
    """The network to start from, if any, and the view of all networks: its own, else the robot's.

    A training that goes on has its network, but still the view of the one that it started from.
    """
    settings, robot = request.settings, request.robot
    start, path = settings.get("start", IMITATION), request.folder / request.path.name
    if start == NO_START:
        return None, view_for(robot)
    network, view = load_start(path if start == IMITATION else Path(start), robot, start)
    return None if settings.get("resume") else network, view


def make_training_env(
    config: RLConfig, seed: int, robot: RobotParams | None = None, view: View | None = None
) -> NetworkVecEnv:
    """All tasks of a training at once, robots sampled anew for every episode, seen in a view."""
    robot, view = seen_in(robot, view)
    rng = np.random.default_rng([seed, 1])  # the environments have streams of `seed` itself
    learned = training_of(robot).learned_tasks
    parts = [
        _part(config, robot, view, task, **options)
        for name in config.tasks
        for task, options in learned(name, config.drawn_tasks, rng)
    ]
    env = NetworkVecEnv(parts, view, stagger=True, reward_scale=1 - config.discount)
    env.seed(seed)
    return env


def _part(
    config: RLConfig, robot: RobotParams, view: View, task: Task | str, **options: float
) -> VectorTrackingEnv:
    share = robot.reach / REACH
    named = {"robot": robot} if isinstance(task, str) else {}
    return VectorTrackingEnv(
        config.envs_per_task,
        task,
        observe=tuple(view.observed),
        reward=TrackingReward(coarse_scale=view.coarse, fine_scale=config.fine_scale * share),
        randomization=config.randomization,
        threads=config.threads if config.backend == "mujoco" else 0,
        backend=config.backend,
        device=config.device,
        autoreset_mode=AutoresetMode.SAME_STEP,
        **view.environment,
        **named,
        **options,
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


def _about(config: RLConfig, seed: int, robot: RobotParams) -> dict[str, Any]:
    """Settings, seed and robot, in what a checkpoint can hold."""
    about = {**asdict(config), "seed": seed, "robot": str(fingerprint(robot)["fingerprint"])}
    about["randomization"] = config.randomization.ranges
    if config.backend == "mujoco":  # which checkpoints do not tell
        del about["backend"], about["device"]
    return json.loads(json.dumps(about))


def _check_free(folder: Path | None) -> None:
    """Refuse to overwrite a training that somebody may want to go on with."""
    found = read(folder)
    if found is not None and found.curve[-1]["steps"] < found.settings["steps"]:
        raise ValueError(
            f"{folder} holds a training that is not finished: resume it, delete it or choose "
            "another folder"
        )


def _to_go_on_with(
    folder: Path | None, about: dict[str, Any], show: ProgressCallback
) -> Checkpoint:
    """The training in a folder, unless there is none or another one."""
    found = read(folder, show)
    if found is None:
        raise FileNotFoundError(f"no training to go on with in {folder}")
    differ = [k for k in about if k != "steps" and about[k] != found.settings.get(k)]
    if differ:
        raise ValueError(
            f"the training in {folder} had other settings: "
            + ", ".join(f"{k} {found.settings.get(k)!r}" for k in differ)
        )
    return found
