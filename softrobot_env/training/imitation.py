"""Imitation of the model predictive controller with preview: cloning, then DAgger."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np
import torch

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.control.arm import neural
from softrobot_env.control.mpc.controller import MPC
from softrobot_env.control.mpc.settings import PREVIEW, MPCSettings
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.fields import Count, NotNegative, Positive, Share, Whole, check_fields
from softrobot_env.interfaces import Observation, Show
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.processes import worker_processes
from softrobot_env.robots import ARM
from softrobot_env.training.artifacts import as_network, new_layers
from softrobot_env.training.references import draw_task

#: The controller to imitate: `mpc_preview`, deciding as often as the network.
TEACHER: MPCSettings = replace(
    PREVIEW,
    period=neural.PERIOD,
    steps=(0.01, 0.01, 0.02, 0.02, 0.04, 0.04, 0.08),
    moves=(1,) * 7,
)


#: Robots that the teacher is watched with.
ROBOTS = Randomization(youngs_modulus=(0.45, 1.7), density=(0.55, 1.6), damping_time=(0.45, 2.2))


@dataclass(frozen=True)
class ImitationConfig:
    """Size and settings of an imitation.

    Attributes:
        hidden: Neurons of the hidden layers.
        rounds: Rounds of data; in the first one the teacher acts, in later ones the network.
        samples: Decisions per round.
        shares: Of a round, each of whole episodes; the data do not depend on `processes`.
        duration: [s] of the longest episode on a random reference.
        randomization: Ranges of the robot's parameters.
        varied: Share of the episodes with a robot drawn from them.
        pushed: Share of the steps at which a random change of the action is added.
        push: Standard deviation [1] of that change.
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
    shares: Count = 16
    duration: Positive = 3.0
    randomization: Randomization = ROBOTS
    varied: Share = 0.7
    pushed: Share = 0.03
    push: NotNegative = 0.03
    epochs: Count = 6
    last_epochs: Count = 40
    batch: Count = 512
    rate: Positive = 2e-3
    processes: Whole = 2
    threads: Count = 1
    plant: str = MUJOCO

    def __post_init__(self) -> None:
        check_fields(self, "imitation")


def imitate(config: ImitationConfig, seed: int, show: Show) -> Network:
    """Train a network to act as the teacher does, in the states it gets into itself.

    Args:
        config: Size and settings.
        seed: Of everything random.
        show: Told the progress.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(config.threads)
    layers = new_layers(neural.feature_count(ARM), config.hidden, 3)
    parts: list[Dataset] = []
    network: Network | None = None
    with ExitStack() as stack:
        each = map
        if config.processes:
            each = stack.enter_context(worker_processes(config.processes)).map
        for k in range(config.rounds):
            seeds = np.random.SeedSequence([seed, k]).spawn(config.shares)
            jobs = [(config, network, one) for one in seeds]
            for i, part in enumerate(each(_collect, jobs)):
                parts.append(part)
                show(f"round {k + 1} of {config.rounds}: data", i + 1, config.shares)
            last = k == config.rounds - 1
            epochs = config.last_epochs if last else config.epochs
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
    batches = -(-len(seen) // config.batch)
    steps = epochs * batches
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


def _collect(job: tuple[ImitationConfig, Network | None, np.random.SeedSequence]) -> Dataset:
    """A share of a round: the teacher's decisions where it or the network acts.

    Inputs are features (k, n_features), outputs those of a network that give the teacher's action
    (k, n_inputs), both float32.
    """
    config, network, seed = job
    rng = np.random.default_rng(seed)
    teacher = MPC(ARM, neural.PERIOD, TEACHER)
    seen: list[np.ndarray] = []
    wanted: list[np.ndarray] = []
    while len(seen) < config.samples / config.shares:
        for one, action in _episode(config, network, teacher, rng):
            seen.append(neural.features(one))
            wanted.append(neural.output_of(action - one["previous_action"]))
    return Dataset(np.array(seen, np.float32), np.array(wanted, np.float32))


def _episode(
    config: ImitationConfig, network: Network | None, teacher: MPC, rng: np.random.Generator
) -> Iterator[tuple[Observation, np.ndarray]]:
    """Observations of the network, and the teacher's actions."""
    duration = config.duration * rng.uniform(0.3, 1.0)
    task = draw_task(rng, duration)
    plant = None if config.plant == MUJOCO else BeamPlant(config.plant)
    preview = (*neural.PREVIEW, *TEACHER.times)
    env = TrackingEnv(task, control_period=neural.PERIOD, preview=preview, plant=plant)
    actor = None if network is None else neural.NeuralPolicy(ARM, neural.PERIOD, network)
    observation, _ = env.reset(options=_start(config, task.start_input, rng))
    state, over = None, False
    while not over:
        mine, its = _views(observation)
        action, state = teacher.predict(its, state)
        yield mine, action
        if actor is not None:
            action, _ = actor.predict(mine)
        if rng.uniform() < config.pushed:
            action = action + rng.normal(0, config.push, action.shape)
        action = np.clip(action, -1, 1).astype(np.float32)
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated


def _start(
    config: ImitationConfig, start_input: tuple[float, ...], rng: np.random.Generator
) -> dict[str, object]:
    """Options of `reset`: often another robot, sometimes another start."""
    options: dict[str, object] = {}
    if rng.uniform() < config.varied:
        options["vary"] = config.randomization.draw(rng)
    if rng.uniform() < 0.3:
        options["start_input"] = np.array(start_input) + rng.normal(0, 2.0, 3)
    return options


def _views(observation: Observation) -> tuple[Observation, Observation]:
    """The same observation with the preview of the network, and with that of the teacher."""
    preview, mine = observation["reference_preview"], 2 * len(neural.PREVIEW)
    return (
        {**observation, "reference_preview": preview[:mine]},
        {**observation, "reference_preview": preview[mine:]},
    )
