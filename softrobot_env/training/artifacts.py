"""Trained networks: torch's layers, files, and their figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch

from softrobot_env.control.learned import neural
from softrobot_env.control.learned.neural import View, view_in
from softrobot_env.core.vector_reading import Reading, reading_in
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation import metrics
from softrobot_env.evaluation.runner import Case, Outcome, run
from softrobot_env.learned.network import Network, check_ends, load_for
from softrobot_env.robots import RobotParams, default_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import artifact_name, find_artifact, fingerprint

from .references import seen_in, training_of
from .request import Metrics, Quantity


@dataclass(frozen=True)
class CheckRow(metrics.TrackingMetrics):
    """An episode of a check, with errors up to a failure.

    Attributes:
        reward: Mean over the steps.
        failure: What went wrong, or None.
        step: Of a step, None for other tasks.
    """

    reward: float
    failure: str | None
    step: metrics.StepMetrics | None


#: By the label of the episode, for instance "step 50 mm, youngs_modulus 0.5".
Rows = dict[str, CheckRow]


def check(
    network: Network,
    variations: Sequence[dict[str, float]] = ({},),
    duration: float | None = None,
    reward: TrackingReward | None = None,
    robot: RobotParams | None = None,
    view: View | Reading | None = None,
) -> Rows:
    """Figures of a network, one episode for each task and variation.

    Args:
        network: To run.
        variations: Robots and disturbances, as in the option `vary` of `reset`.
        duration: [s] of the episodes, the tasks' own unless given.
        reward: Whose mean is reported; the environments' default unless given.
        robot: The robot; the default one unless given.
        view: Of the network; the robot's unless given.
    """
    (robot, view), rows = seen_in(robot, view), {}
    policy = neural.NeuralPolicy(robot, float(view.period), network, view=view)
    for task in training_of(robot).check_tasks():
        env = TrackingEnv(task, observe=policy.requires, reward=reward, **view.environment)
        for vary in variations:
            case = Case(task, "network", variation=vary, duration=duration)
            label = ", ".join([task.label, *(f"{n} {value:g}" for n, value in vary.items())])
            rows[label] = _row(run(case, env, policy))
    return rows


def _row(outcome: Outcome) -> CheckRow:
    rollout, step = outcome.rollout, None
    if outcome.case.task.step_width is not None:
        step = metrics.step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    errors, reward = metrics.tracking_metrics(rollout), float(np.mean(rollout.reward[1:]))
    return CheckRow(**vars(errors), reward=reward, failure=rollout.failure, step=step)


_START = "imitation"


def new_layers(inputs: int, hidden: tuple[int, ...], outputs: int) -> torch.nn.Sequential:
    """Linear layers with tanh between them."""
    sizes = (inputs, *hidden, outputs)
    layers: list[torch.nn.Module] = []
    for below, here in pairwise(sizes):
        layers += [torch.nn.Linear(below, here), torch.nn.Tanh()]
    return torch.nn.Sequential(*layers[:-1])


def _linear_layers(modules: Sequence[torch.nn.Module]) -> list[torch.nn.Linear]:
    """Linear layers within modules, one by one."""
    parts = [part for module in modules for part in module.modules()]
    return [part for part in parts if isinstance(part, torch.nn.Linear)]


def as_network(*modules: torch.nn.Module) -> Network:
    """The network that modules with linear layers and tanh between them make, one by one."""
    layers = _linear_layers(modules)
    weights = tuple(layer.weight.detach().numpy().astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network.unscaled(weights, biases)


def put_network(network: Network, *modules: torch.nn.Module) -> None:
    """Set the layers that `as_network` reads."""
    with torch.no_grad():
        layers = _linear_layers(modules)
        for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.copy_(torch.from_numpy(bias))


def save(
    network: Network,
    path: Path | str,
    seed: int,
    robot: RobotParams | None = None,
    view: View | Reading | None = None,
) -> None:
    """Write a network in single precision, with its robot, what it sees and the seed."""
    robot, view = seen_in(robot, view)
    single = network.with_parameters(network.parameters.astype(np.float32))
    single.save(path, {**fingerprint(robot), **view.about(), "seed": seed})


def save_vector_policy(path: Path | str, model: Any, env: Any, seed: int = 0) -> None:
    """Write what learned on vectors as a policy that `make_policy` and `softrobot evaluate` run.

    Args:
        path: File to write, `.npz`.
        model: A model of stable-baselines3, or layers of torch from vector to action.
        env: That it learned in: an environment with `observe_as="vector"`, or several of them.
        seed: Of the training.

    Raises:
        ValueError: The environment shows no vectors, or the model is no network of linear layers
            with tanh between them that sees them as they are.
    """
    owner = getattr(env, "parts", [env])[0].unwrapped
    reading = getattr(owner, "reading", None)
    if reading is None:
        raise ValueError('the environment shows no vectors: make it with observe_as="vector"')
    network, robot = as_network(*_acting(model)), owner.task.robot
    check_ends(network, (len(reading.take), robot_inputs(robot).n_inputs), "the model")
    save(network, path, seed, robot, reading)


def _acting(model: Any) -> tuple[torch.nn.Module, ...]:
    """Modules of the mean action of a model, which have tanh between linear layers and no more."""
    modules = (model,)
    if hasattr(model, "policy"):
        if model.get_vec_normalize_env() is not None:
            raise ValueError(
                "the model sees what VecNormalize scales: vectors need no such scaling"
            )
        if not hasattr(model.policy, "action_net"):
            raise ValueError(
                f"{type(model).__name__} has no action_net of linear layers, as PPO has"
            )
        modules = (model.policy.mlp_extractor.policy_net, model.policy.action_net)
    parts = [part for module in modules for part in module.modules() if not list(part.children())]
    known = [torch.nn.Linear if k % 2 == 0 else torch.nn.Tanh for k in range(len(parts))]
    if len(parts) % 2 == 0 or any(type(p) is not k for p, k in zip(parts, known, strict=True)):
        names = ", ".join(type(part).__name__ for part in parts)
        raise ValueError(f"networks here are linear layers with tanh between them, not {names}")
    return modules


def load_start(
    path: Path, robot: RobotParams | None = None, start: str = _START
) -> tuple[Network, View]:
    """The network that a training starts from, and its view.

    Args:
        path: The network; by default its folder is where the imitating one is, unless that is
            where policies look.
        robot: Of the network.
        start: "imitation" for that one, anything else for the file itself.

    Raises:
        ValueError: There is none; the message tells the command that makes it. Or it reads vectors.
    """
    found, robot = path, robot or default_robot()
    if start == _START:
        beside = path.with_name(artifact_name(robot, _START))
        found = beside if beside.is_file() else find_artifact(robot, _START)
    network, about = load_for(found, robot, _START)
    if reading_in(about) is not None:
        raise ValueError(f"{found} reads vectors: trainings start from networks like imitation's")
    return network, view_in(about, robot)


def figures(
    network: Network,
    variations: tuple[dict[str, float], ...] = ({},),
    robot: RobotParams | None = None,
    view: View | Reading | None = None,
) -> Metrics:
    """Closed-loop figures for people, with robots and disturbances as `check` takes them."""
    out: Metrics = [("parameters", str(len(network.parameters)))]
    for name, row in check(network, variations, robot=robot, view=view).items():
        if row.failure:
            out.append((name, row.failure))
        elif row.step is None:
            out.append((f"{name}: largest error", Quantity(row.e_max, ".2f", "mm")))
            out.append((f"{name}: mean error", Quantity(row.e_mean, ".2f", "mm")))
        else:
            out.append((f"{name}: overshoot", Quantity(row.step.overshoot, ".3g", "%")))
            out.append((f"{name}: settling time", Quantity(row.step.settling_time, ".3g", "s")))
    return out
