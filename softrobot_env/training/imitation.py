"""Imitation of a policy by a network: cloning, then DAgger.

Of the arm the teacher is the model predictive controller with preview, of other robots any policy.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice

import numpy as np
import torch
from numpy import ndarray

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.control.learned import neural
from softrobot_env.control.scheduled.timing import timing_of
from softrobot_env.core.interfaces import Observation, Policy, ProgressCallback
from softrobot_env.core.processes import worker_processes
from softrobot_env.core.records import Count, NotNegative, Positive, Record, Share, Whole
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.robots import default_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.tasks import Task

from .artifacts import as_network, figures, new_layers, save
from .references import ImitationSetup, training_of
from .request import Metrics, TrainingRequest

#: Robots that the teacher is watched with.
ROBOTS = Randomization(youngs_modulus=(0.45, 1.7), density=(0.55, 1.6), damping_time=(0.45, 2.2))

#: And those of other robots than the arm, which may be soft for their weight.
_NEAR = Randomization(youngs_modulus=(0.7, 1.35), density=(0.8, 1.25), damping_time=(0.6, 1.6))


#: Samples of other robots than the arm in a period of the first mode.
_APART = 30


@dataclass(frozen=True)
class ImitationConfig(Record, what="imitation"):
    """Size and settings of an imitation.

    Attributes:
        hidden: Neurons of the hidden layers.
        rounds: Rounds of data; in the first one the teacher acts, in later ones the network.
        samples: Decisions per round that are learned from.
        every: One out of so many decisions is; neighbours in a fast robot's motion tell the same.
        shares: Of a round, each of whole episodes; the data do not depend on `processes`.
        duration: [s] of the longest episode on a random reference.
        randomization: Ranges of the robot's parameters.
        varied: Share of the episodes with a robot sampled from them.
        pushed: Share of the steps at which a random change of the action is added.
        push: Standard deviation of that change, over the network's own scale of changes [1].
        epochs: Passes over all data so far after each round but the last.
        last_epochs: Passes after the last round.
        batch: Samples per gradient step.
        rate: Largest learning rate.
        processes: That collect data; 0 collects in this one.
        threads: Of torch; small layers gain nothing from more than one.
        plant: That is moved, one of `beams.registry.PLANTS`.
    """

    hidden: tuple[Count, ...] = (128, 128)
    rounds: Count = 12
    samples: Count = 30_000
    every: Count = 1
    shares: Count = 16
    duration: Positive = 3.0
    randomization: Randomization = ROBOTS
    varied: Share = 0.7
    pushed: Share = 0.03
    push: NotNegative = 3.0
    epochs: Count = 6
    last_epochs: Count = 40
    batch: Count = 512
    rate: Positive = 2e-3
    processes: Whole = 2
    threads: Count = 1
    plant: str = MUJOCO


@lru_cache(maxsize=2)
def _teacher(setup: ImitationSetup) -> Policy:
    """The teacher, made once in a process."""
    return setup.make(setup)


def settings_of(setup: ImitationSetup, quick: bool = False) -> ImitationConfig:
    """Size of an imitation: that of what is shipped for the arm, else minutes; or a tiny one."""
    config = ImitationConfig()
    if not setup.is_tuned:
        first = timing_of(setup.robot).first
        config = replace(
            config,
            rounds=6,
            samples=16_000,
            every=max(1, round(first / _APART / setup.view.period)),
            shares=8,
            last_epochs=30,
            randomization=_NEAR,
        )
    if quick:
        few = {"rounds": 2, "samples": 1000, "shares": 2, "epochs": 2, "last_epochs": 4}
        config = replace(config, **few, every=1, processes=0)
    return config


def run(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Imitate as requested, and write the network."""
    training, teacher = training_of(request.robot), request.settings.get("teacher")
    setup = training.imitation(teacher, request.folder)
    config = settings_of(setup, "quick" in request.settings)
    network, view = imitate(config, request.seed, show, setup), setup.view
    save(network, request.path, request.seed, request.robot, view)
    return [("teacher", setup.teacher), *figures(network, robot=request.robot, view=view)]


def imitate(
    config: ImitationConfig, seed: int, show: ProgressCallback, setup: ImitationSetup | None = None
) -> Network:
    """Train a network to act as the teacher does, in the states it gets into itself.

    Args:
        config: Size and settings.
        seed: Of everything random.
        show: Shows the progress.
        setup: Robot and teacher.

    Raises:
        ValueError: The teacher cannot drive the robot; says which training it needs first.
    """
    setup = setup or training_of(default_robot()).imitation()
    _teacher(setup)  # before anything is done
    view = setup.view
    torch.manual_seed(seed)
    torch.set_num_threads(config.threads)
    layers = new_layers(view.count, config.hidden, view.inputs)
    parts: list[Dataset] = []
    network: Network | None = None
    with ExitStack() as stack:
        each = map
        if config.processes:
            each = stack.enter_context(worker_processes(config.processes)).map
        for k in range(config.rounds):
            seeds = np.random.SeedSequence([seed, k]).spawn(config.shares)
            jobs = [(config, setup, network, one) for one in seeds]
            for i, part in enumerate(each(_collect, jobs)):
                parts.append(part)
                show(f"round {k + 1} of {config.rounds}: data", i + 1, config.shares)
            epochs = config.last_epochs if k == config.rounds - 1 else config.epochs
            for epoch, loss in fit(layers, Dataset.join(parts), epochs, config):
                show(f"round {k + 1} of {config.rounds}: loss {loss:.2e}", epoch, epochs)
            network = as_network(layers)
    return network


def fit(
    layers: torch.nn.Sequential, data: Dataset, epochs: int, config: ImitationConfig
) -> Iterator[tuple[int, float]]:
    """Least squares by Adam under a falling rate; yields epoch and mean squared error."""
    seen, wanted = torch.from_numpy(data.inputs), torch.from_numpy(data.outputs)
    optimiser = torch.optim.Adam(layers.parameters(), config.rate)
    steps = epochs * -(-len(seen) // config.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, config.rate, total_steps=steps, pct_start=min(max(0.1, 2 / steps), 0.75)
    )
    for epoch in range(epochs):
        total = 0.0
        for chosen in torch.randperm(len(seen)).split(config.batch):
            loss = torch.nn.functional.mse_loss(layers(seen[chosen]), wanted[chosen])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item() * len(chosen)
        yield epoch + 1, total / len(seen)


def _collect(
    job: tuple[ImitationConfig, ImitationSetup, Network | None, np.random.SeedSequence],
) -> Dataset:
    """A share of a round: the teacher's decisions where it or the network acts.

    Inputs are features (k, n_features), outputs those of a network that give the teacher's action
    (k, n_inputs), both float32.
    """
    config, setup, network, seed = job
    rng, view = np.random.default_rng(seed), setup.view
    seen: list[ndarray] = []
    wanted: list[ndarray] = []
    while len(seen) < config.samples / config.shares:
        decisions = _episode(config, setup, network, rng)
        first = int(rng.integers(config.every)) if config.every > 1 else 0
        for one, action in islice(decisions, first, None, config.every):
            seen.append(neural.features(one, view))
            wanted.append(view.output_of(action - one["previous_action"]))
    return Dataset(np.array(seen, np.float32), np.array(wanted, np.float32))


def _episode(
    config: ImitationConfig,
    setup: ImitationSetup,
    network: Network | None,
    rng: np.random.Generator,
) -> Iterator[tuple[Observation, ndarray]]:
    """Observations of the network where it decides, and the teacher's actions."""
    robot, view, teacher = setup.robot, setup.view, _teacher(setup)
    task = training_of(robot).sampled_task(rng, config.duration * rng.uniform(0.3, 1.0))
    env = _environment(config, setup, task)
    hold = round(view.period / env.control_period)
    actor = None if network is None else neural.NeuralPolicy(robot, view.period, network, view=view)
    observation, _ = env.reset(options=_start(config, task, rng))
    count, state, over, step = len(view.preview) * view.dimensions, None, False, 0
    while not over:
        # The preview of the network stands before that of the teacher.
        mine, its = (
            {**observation, "reference_preview": preview}
            for preview in np.split(observation["reference_preview"], [count])
        )
        chosen, state = teacher.predict(its, state)
        if step % hold == 0:
            yield mine, chosen
            action = chosen if actor is None else actor.predict(mine)[0]
            if rng.uniform() < config.pushed:
                action = action + rng.normal(0, config.push * view.change, action.shape)
            action = np.clip(action, -1, 1).astype(np.float32)
        observation, _, terminated, truncated, _ = env.step(action)
        over, step = terminated or truncated, step + 1


def _environment(config: ImitationConfig, setup: ImitationSetup, task: Task) -> TrackingEnv:
    """With all that network and teacher see, the network's preview first."""
    plant = None if config.plant == MUJOCO else BeamPlant(config.plant)
    return TrackingEnv(
        task,
        control_period=setup.period,
        preview=(*setup.view.preview, *setup.preview),
        observe=None if setup.is_tuned else "all",
        plant=plant,
    )


def _start(config: ImitationConfig, task: Task, rng: np.random.Generator) -> dict[str, object]:
    """Options of `reset`: often another robot, sometimes another start."""
    options: dict[str, object] = {}
    if rng.uniform() < config.varied:
        options["vary"] = config.randomization.draw(rng)
    if rng.uniform() < 0.3:
        inputs = robot_inputs(task.robot)
        action = inputs.to_actions(np.array(task.start_input))
        action = np.clip(action + rng.normal(0, 0.1, len(action)), -1, 1)
        options["start_input"] = inputs.from_actions(action)
    return options
