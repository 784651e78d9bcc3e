"""Cheap policies of the arm, trained on one plant or another.

The quasi-static network learns the statics of a plant, the imitation acts on it while it learns.
Gain tables are designed from closed forms of the constant-curvature arm: there is nothing to swap.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.benchmarks.jobs import quiet
from softrobot_env.learned import bayesian, quasi_static
from softrobot_env.learned.network import describe
from softrobot_env.robots import ARM
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import scene_of
from softrobot_env.training.artifacts import save
from softrobot_env.training.imitation import ImitationConfig, imitate

#: Of their random numbers.
_SEED = 0

#: Much less than what is shipped was trained with; the same for every plant.
_PAIRS = 1500
_IMITATION = ImitationConfig(
    rounds=3, samples=5000, shares=2, epochs=6, last_epochs=30, processes=0
)


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


#: Policy -> how it is trained, and the plants that it is trained on.
TRAININGS: dict[str, tuple[Callable[[str, Path], None], tuple[str, ...]]] = {
    "qs_nn": (train_qs_nn, (MUJOCO, "pcc", "cosserat")),
    "imitation": (train_imitation, (MUJOCO, "pcc")),
}


def _statics(plant: str) -> quasi_static.Statics:
    """Static tip (2,) [m] of a plant by reduced inputs (n_inputs,) [N]."""
    tendons = TendonMap(ARM)
    if plant == MUJOCO:
        scene = build_scene(scene_of(ARM))
        return lambda inputs: scene.tip(scene.equilibrium(tendons.command(inputs)))[[0, 2]]
    model = BeamPlant(plant)(ARM).model
    return lambda inputs: model.tip(model.equilibrium(tendons.command(inputs)))[[0, 2]]
