"""The learners of stable-baselines3, and the network within each that acts."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from torch import nn

from softrobot_env.learned.network import Network

from .artifacts import as_network, put_network
from .rl_config import RLConfig
from .vec_env import TrackingVecEnv


@dataclass(frozen=True)
class Learner:
    """What differs between the algorithms.

    Attributes:
        model: Class of stable-baselines3.
        settings: Keyword arguments of the class, by the training's settings, the number of
            outputs and that of environments.
        acting: Modules of the mean action, one by one.
        exploring: Parameters that shape the exploration.
        squashed: Whether tanh bounds the mean action.
    """

    model: type[BaseAlgorithm]
    settings: Callable[[RLConfig, int, int], dict[str, Any]]
    acting: Callable[[Any], tuple[nn.Module, ...]]
    exploring: Callable[[Any], list[nn.Parameter]]
    squashed: bool


def _ppo(config: RLConfig, outputs: int, environments: int) -> dict[str, Any]:
    hidden, collected = list(config.hidden), config.rollout * environments
    return {
        "batch_size": max(n for n in range(1, config.batch + 1) if collected % n == 0),
        "n_steps": config.rollout,
        "n_epochs": config.epochs,
        "target_kl": config.target_kl,
        "policy_kwargs": {
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": nn.Tanh,
            "log_std_init": float(np.log(config.deviation)),
        },
    }


def _off_policy(config: RLConfig) -> dict[str, Any]:
    hidden = list(config.hidden)
    return {
        "batch_size": config.batch,
        "buffer_size": config.buffer,
        "learning_starts": config.warm_up,
        "gradient_steps": config.updates,
        "policy_kwargs": {"net_arch": {"pi": hidden, "qf": hidden}, "activation_fn": nn.Tanh},
    }


def _sac(config: RLConfig, outputs: int, environments: int) -> dict[str, Any]:
    # Entropy of a normal distribution with the deviation aimed at.
    entropy = outputs * (np.log(config.deviation) + 0.5 * np.log(2 * np.pi * np.e))
    return _off_policy(config) | {"ent_coef": "auto_0.001", "target_entropy": float(entropy)}


def _td3(config: RLConfig, outputs: int, environments: int) -> dict[str, Any]:
    spread = config.deviation
    return _off_policy(config) | {
        "action_noise": NormalActionNoise(np.zeros(outputs), np.full(outputs, spread)),
        "target_policy_noise": spread,
        "target_noise_clip": 2.5 * spread,
    }


LEARNERS: dict[str, Learner] = {
    "ppo": Learner(
        PPO,
        _ppo,
        lambda m: (m.policy.mlp_extractor.policy_net, m.policy.action_net),
        lambda m: [m.policy.log_std],
        squashed=False,
    ),
    "sac": Learner(
        SAC,
        _sac,
        lambda m: (m.actor.latent_pi, m.actor.mu),
        lambda m: [m.actor.log_std.weight, m.actor.log_std.bias],
        squashed=True,
    ),
    "td3": Learner(TD3, _td3, lambda m: (m.actor.mu,), lambda m: [], squashed=True),
}


def make_model(
    config: RLConfig, env: TrackingVecEnv, seed: int, log: str | None = None
) -> BaseAlgorithm:
    """The learner; separate networks for actor and critic.

    Args:
        config: Size and settings.
        env: To learn in.
        seed: Of everything random.
        log: Folder of TensorBoard's logs, none unless given.
    """
    learner = LEARNERS[config.algorithm]
    model = learner.model(
        "MlpPolicy",
        env,
        learning_rate=lambda left: config.rate * left,
        gamma=config.discount,
        tensorboard_log=log,
        seed=seed,
        device="cpu",
        **learner.settings(config, env.action_space.shape[0], env.num_envs),
    )
    if config.algorithm == "sac":
        explore = model.actor.log_std  # at first with one deviation in every state
        nn.init.zeros_(explore.weight)
        nn.init.constant_(explore.bias, float(np.log(config.deviation)))
    return model


def actor_of(model: BaseAlgorithm, config: RLConfig) -> Network:
    """The network of the mean action; a bounded one ends with tanh and an identity layer."""
    learner = LEARNERS[config.algorithm]
    network = as_network(*learner.acting(model))
    if not learner.squashed:
        return network
    identity, nothing = np.eye(network.sizes[-1]), np.zeros(network.sizes[-1])
    layers = (*network.weights, identity), (*network.biases, nothing)
    return Network.unscaled(*layers)


def put_actor(model: BaseAlgorithm, config: RLConfig, network: Network) -> None:
    """Let the learner act as a network does, bounded by tanh if the algorithm bounds actions.

    Raises:
        ValueError: Other layers than the learner's, or a bounded network for one that is not.
    """
    learner = LEARNERS[config.algorithm]
    if learner.squashed:
        network = _without_identity(network)
    wanted = as_network(*learner.acting(model)).sizes
    if network.sizes != wanted:
        raise ValueError(
            f"the network to start from has layers of {_listed(network.sizes)}, {config.algorithm} "
            f"needs {_listed(wanted)}; one that SAC or TD3 made ends with a further layer, and "
            "only they can start from it"
        )
    put_network(network, *learner.acting(model))
    if hasattr(model, "actor_target"):
        model.actor_target.load_state_dict(model.actor.state_dict())


def _listed(sizes: tuple[int, ...]) -> str:
    return "-".join(str(size) for size in sizes)


def _without_identity(network: Network) -> Network:
    """The network less a last layer that does nothing."""
    last = network.weights[-1]
    if last.shape[0] != last.shape[1] or not np.array_equal(last, np.eye(len(last))):
        return network
    return replace(network, weights=network.weights[:-1], biases=network.biases[:-1])


def freeze_actor(model: BaseAlgorithm, config: RLConfig, frozen: bool) -> None:
    """Let the actor, and how it explores, stay as they are, or learn again."""
    learner = LEARNERS[config.algorithm]
    parameters = [p for module in learner.acting(model) for p in module.parameters()]
    for parameter in parameters + learner.exploring(model):
        parameter.requires_grad_(not frozen)
