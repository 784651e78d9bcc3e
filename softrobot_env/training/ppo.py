"""Proximal policy optimisation of a network on all tasks at once (stable-baselines3)."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import set_random_seed

from softrobot_env.control import neural
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.learned.network import Network
from softrobot_env.robots import ARM
from softrobot_env.tasks import Task, make_task
from softrobot_env.training.networks import as_network, put_network
from softrobot_env.training.progress import Show
from softrobot_env.training.references import draw_task
from softrobot_env.training.trial import trial
from softrobot_env.training.vec_env import TrackingVecEnv


@dataclass(frozen=True)
class PPOConfig:
    """Size and settings of a training.

    Attributes:
        hidden: Neurons of the hidden layers of actor and critic.
        steps: Environment steps in all.
        critic_steps: Before them, with a network to start from: it acts and its critic learns.
        random_tasks: Number of tasks on random references besides the known ones.
        envs_per_task: Environments of each task.
        modulus: Factors on Young's modulus, drawn for each task evenly in its logarithm.
        rollout: Steps per environment between updates.
        batch, epochs: Samples per gradient step, and passes over a rollout.
        rate: Learning rate at the start; falls linearly to zero.
        discount: Per step.
        deviation: Standard deviation [1] of the outputs at the start.
        target_kl: Divergence at which an update is ended early.
        trial_every: Updates between trials of the mean action; the best network is kept.
        trial_moduli: Factors on Young's modulus of the trials.
        trial_duration: [s] of the trials' episodes, the tasks' own for None.
        threads: Of torch and the simulation.
    """

    hidden: tuple[int, ...] = (128, 128)
    steps: int = 2_000_000
    critic_steps: int = 0
    random_tasks: int = 6
    envs_per_task: int = 16
    modulus: tuple[float, float] = (0.5, 1.5)
    rollout: int = 128
    batch: int = 2048
    epochs: int = 5
    rate: float = 5e-4
    discount: float = 0.98
    deviation: float = 0.3
    target_kl: float = 0.03
    trial_every: int = 10
    trial_moduli: tuple[float, ...] = (0.5, 1.0, 1.5)
    trial_duration: float | None = None
    threads: int = 1


#: From scratch.
SCRATCH = PPOConfig()

#: From a network that is good already: closer about its actions, and slower.
TUNING = replace(SCRATCH, steps=1_000_000, critic_steps=200_000, rate=5e-5, deviation=0.02)


#: Files of a checkpoint.
_MODEL, _BEST, _CURVE = "model.zip", "best.npz", "curve.json"

#: A point of a learning curve: environment steps, mean reward of the trials, their largest error
#: [mm] on swing and L-shape.
Point = dict[str, float]


def train(
    config: PPOConfig,
    seed: int,
    show: Show,
    start: Network | None = None,
    checkpoint: Path | None = None,
) -> tuple[Network, list[Point]]:
    """Train from a network, or from scratch.

    Args:
        config: Size and settings.
        seed: Of everything random.
        show: Told the progress.
        start: Network to start from.
        checkpoint: Folder that is written to at every trial. If it holds an earlier training,
            that one is gone on with; not as if it had never stopped, as the episodes begin anew.

    Returns:
        The network that did best in the trials, the one to start from among them, and the
        learning curve.
    """
    torch.set_num_threads(config.threads)
    set_random_seed(seed)
    env = make_training_env(config, seed)
    watch = _Watch(config, show, checkpoint)
    resumed = watch.resume()
    if resumed:
        model = PPO.load(checkpoint / _MODEL, env=env, device="cpu")
    else:
        model = make_model(config, env, seed)
        _begin(model, config, start)
    left = config.steps - (model.num_timesteps if resumed else 0)
    if left > 0:
        model.learn(left, callback=watch, reset_num_timesteps=not resumed)
        watch.judge()
    env.close()
    return watch.best, watch.curve


def _begin(model: PPO, config: PPOConfig, start: Network | None) -> None:
    """Put the network to start from, and let the critic learn from what it does."""
    if start is None:
        return
    put_network(start, model.policy.mlp_extractor.policy_net, model.policy.action_net)
    if config.critic_steps:
        _freeze_actor(model, True)
        model.learn(config.critic_steps)
        _freeze_actor(model, False)


def make_model(config: PPOConfig, env: TrackingVecEnv, seed: int) -> PPO:
    """The learner; separate networks for actor and critic."""
    hidden = list(config.hidden)
    return PPO(
        "MlpPolicy",
        env,
        learning_rate=lambda left: config.rate * left,
        n_steps=config.rollout,
        batch_size=config.batch,
        n_epochs=config.epochs,
        gamma=config.discount,
        target_kl=config.target_kl,
        policy_kwargs={
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": torch.nn.Tanh,
            "log_std_init": float(np.log(config.deviation)),
        },
        seed=seed,
        device="cpu",
    )


def make_training_env(config: PPOConfig, seed: int) -> TrackingVecEnv:
    """The known tasks and random ones, each with an arm of another modulus."""
    rng = np.random.default_rng(seed)
    tasks = [make_task("swing"), make_task("swing"), make_task("lshape"), make_task("lshape")]
    tasks += [replace(make_task("step", w), duration=1.5) for w in (0.03, 0.05, 0.1, 0.2)]
    tasks += [draw_task(rng, 6.0) for _ in range(config.random_tasks)]
    parts = []
    for task in tasks:
        factor = float(np.exp(rng.uniform(*np.log(config.modulus))))
        parts.append(_part(config, replace(task, robot=ARM.vary(youngs_modulus=factor))))
    return TrackingVecEnv(parts, stagger=True, reward_scale=1 - config.discount)


def _part(config: PPOConfig, task: Task) -> VectorTrackingEnv:
    return VectorTrackingEnv(
        config.envs_per_task,
        task,
        control_period=neural.PERIOD,
        preview=neural.PREVIEW,
        reward=TrackingReward(),
        threads=config.threads,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )


def actor_of(model: PPO) -> Network:
    """The network of the mean action."""
    return as_network(model.policy.mlp_extractor.policy_net, model.policy.action_net)


def _freeze_actor(model: PPO, frozen: bool) -> None:
    policy = model.policy
    for module in (policy.mlp_extractor.policy_net, policy.action_net):
        module.requires_grad_(not frozen)
    policy.log_std.requires_grad_(not frozen)


class _Watch(BaseCallback):
    """Tries the mean action now and then, keeps the best network and the learning curve."""

    def __init__(self, config: PPOConfig, show: Show, folder: Path | None) -> None:
        super().__init__()
        self._config, self._show, self._updates, self._folder = config, show, 0, folder
        self.best: Network | None = None
        self.curve: list[Point] = []
        self._reward = -np.inf

    def resume(self) -> bool:
        """Take up what the folder holds; whether it holds a training."""
        if self._folder is None or not (self._folder / _MODEL).is_file():
            return False
        self.best, _ = Network.load(self._folder / _BEST)
        self.curve = json.loads((self._folder / _CURVE).read_text(encoding="utf-8"))
        self._reward = max(point["reward"] for point in self.curve)
        return True

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self._updates % self._config.trial_every == 0:
            self.judge()
        self._updates += 1
        text = f"mean reward {self._reward:.4f}"
        self._show(text, self.num_timesteps, self._config.steps)

    def judge(self) -> None:
        """Try the present network."""
        network = actor_of(self.model)
        rows = trial(network, self._config.trial_moduli, self._config.trial_duration)
        failed = any(row["failure"] for row in rows.values())
        reward = float(np.mean([row["reward"] for row in rows.values()])) - 10 * failed
        largest = max(row["max_mm"] for name, row in rows.items() if not name.startswith("step"))
        self.curve.append({"steps": self.num_timesteps, "reward": reward, "max_mm": largest})
        if reward > self._reward:
            self.best, self._reward = network, reward
        if self._folder is not None:
            self._save(self._folder)

    def _save(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.best.save(folder / _BEST, {})
        (folder / _CURVE).write_text(json.dumps(self.curve), encoding="utf-8")
        self.model.save(folder / _MODEL)
