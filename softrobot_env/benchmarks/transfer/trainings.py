"""Policies trained or tuned on one plant or another.

Of the arm: the quasi-static network learns the statics of a plant; the imitation and PPO act on it
while they learn. Its gain tables are designed from closed forms of constant curvature. Of other
robots: gain tables from equilibria and linear models of a plant.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.benchmarks.laps import RefusedRow, refusal
from softrobot_env.core.jobs import quiet
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.learned import bayesian
from softrobot_env.learned.network import describe
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG, RobotParams, find_robot
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import scene_of
from softrobot_env.thesis.arm import quasi_static
from softrobot_env.training.artifacts import save, save_vector_policy
from softrobot_env.training.imitation import ImitationConfig, imitate
from softrobot_env.training.references import generic_task
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import TrainingRequest

#: Of their random numbers.
_SEED = 0

#: Much less than what is shipped was trained with; the same for every plant.
_PAIRS = 1500
_IMITATION = ImitationConfig(
    rounds=3, samples=5000, shares=2, epochs=6, last_epochs=30, processes=0
)

#: Steps of PPO as stable-baselines3 comes, of each of its environments between two updates, and
#: the paces of their random paths, in laps per period of the first mode.
_STEPS, _BETWEEN, _PACES = 120_000, 1024, (0.1, 0.2, 0.3, 0.4) * 2

#: Tables that are also designed from another plant than the chain, and that plant.
TABLES, OTHER = ("lqi", "lq_preview", "mpc", "mpc_preview"), "pcc"


@dataclass(frozen=True)
class Trained:
    """A policy that was trained for this study.

    Attributes:
        robot, policy: Names.
        plant: That it was trained on.
        option: The policy's keyword argument for its file.
        file: The file.
    """

    robot: str
    policy: str
    plant: str
    option: str
    file: Path


def train_qs_nn(plant: str, path: Path) -> None:
    """Train the quasi-static network on a plant's statics, and save it."""
    tip, how = _statics(plant), quasi_static.Sampling(pairs=_PAIRS)
    drawn, start = (np.random.default_rng(s) for s in np.random.SeedSequence(_SEED).spawn(2))
    samples = quasi_static.sample(tip, TendonMap(ARM).n_inputs, how, drawn)
    fit = bayesian.train(samples.new_network(quasi_static.HIDDEN, start), samples)
    reached = quasi_static.workspace(samples.inputs[:, 2:4])
    fit.network.save(path, {**describe(ARM), "workspace": reached, "seed": _SEED})


def train_imitation(plant: str, path: Path) -> None:
    """Train an imitation on a plant, and save it."""
    save(imitate(replace(_IMITATION, plant=plant), _SEED, quiet), path, _SEED)


def train_ppo(plant: str, path: Path) -> None:
    """Train PPO on a few random paths on a plant, single environments one after the other."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    torch.set_num_threads(1)
    env = DummyVecEnv([partial(_vectors, plant, k, pace) for k, pace in enumerate(_PACES)])
    model = PPO("MlpPolicy", env, n_steps=_BETWEEN, seed=_SEED, device="cpu").learn(_STEPS)
    save_vector_policy(path, model, env.envs[0], _SEED)
    env.close()


def _vectors(plant: str, seed: int, pace: float) -> TrackingEnv:
    """The arm on a random path, as learning libraries see it."""
    own = {} if plant == MUJOCO else {"plant": BeamPlant(plant)}
    task = generic_task("random", ARM, seed=seed, frequency=pace)
    return TrackingEnv(task, observe_as="vector", **own)


#: Policy of the arm -> how it is trained, and the plants that it is trained on.
NETWORKS: dict[str, tuple[Callable[[str, Path], None], tuple[str, ...]]] = {
    "qs_nn": (train_qs_nn, (MUJOCO, "pcc", "cosserat")),
    "imitation": (train_imitation, (MUJOCO, "pcc")),
    "ppo": (train_ppo, (MUJOCO, "pcc")),
}


def train_network(policy: str, plant: str, folder: Path) -> Trained:
    """Train one of `NETWORKS`."""
    path = folder / f"{ARM.name}_{policy}_{plant}.npz"
    NETWORKS[policy][0](plant, path)
    return Trained(ARM.name, policy, plant, "weights", path)


def tune_tables(name: str, folder: Path) -> list[Trained | RefusedRow]:
    """Design the tables of a robot from the other plant, or say why not."""
    robot, out = find_robot(name), []
    for policy in TABLES:
        path = folder / f"{name}_{policy}_{OTHER}.npz"
        why = _untunable(robot)
        try:
            if why is None:
                TRAININGS[policy].run(TrainingRequest(robot, path, _SEED, {"plant": OTHER}), quiet)
        except ValueError as error:
            why = str(error)
        if why is not None:
            out.append(refusal(name, policy, f"tuned on {OTHER}", why))
        else:
            out.append(Trained(name, policy, OTHER, "gains", path))
    return out


def _untunable(robot: RobotParams) -> str | None:
    """Why tables of a robot cannot be designed from another plant; None if they can."""
    if robot == ARM:
        return "the arm's gains are those of the closed form of constant curvature on any plant"
    if robot == RIG:
        return (
            f"tables are tuned for {EQUIVALENT_RIG.name!r}, which stands as it does, in its place"
        )
    return None


def _statics(plant: str) -> quasi_static.Statics:
    """Static tip (2,) [m] of a plant by reduced inputs (n_inputs,) [N]."""
    tendons = TendonMap(ARM)
    if plant == MUJOCO:
        scene = build_scene(scene_of(ARM))
        return lambda inputs: scene.tip(scene.equilibrium(tendons.command(inputs)))[[0, 2]]
    model = BeamPlant(plant)(ARM).model
    return lambda inputs: model.tip(model.equilibrium(tendons.command(inputs)))[[0, 2]]
