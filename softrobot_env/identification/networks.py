"""Quasi-static networks of the spatial rig: s -> z (thesis sec. 3.2) and z -> s (sec. 5.1)."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.core.registry import Registry
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.learned.training import train_validated

from .visits import RigData, split

#: Neurons of the hidden layers.
HIDDEN = (10, 10)

#: Number of samples to train with, and to stop the training with.
TRAINING, VALIDATION = 150, 32

#: Networks s -> z and z -> s.
DIRECTIONS = ("forward", "inverse")

_FEWEST = 200


@dataclass(frozen=True)
class Networks:
    """Networks of one rig.

    Attributes:
        forward, inverse: s -> z and z -> s.
        errors: rms on the test set by direction [m].
    """

    forward: Network
    inverse: Network
    errors: dict[str, float]


def networks_of(data: RigData, seed: int = 0) -> Networks:
    """Train both with 150 samples, as in the thesis; `seed` sets split and initial parameters.

    Raises:
        ValueError: Too few points.
    """
    count = len(data.lengths)
    if count < _FEWEST:
        raise ValueError(
            f"networks need {_FEWEST} points or more that were visited, got {count}: record more, "
            "or leave out the stage network"
        )
    rng = np.random.default_rng(seed)
    parts = split(count, rng)
    found, errors = {}, {}
    for name in DIRECTIONS:
        every = direction_of(data, name)
        training, watched = (
            every.take(rows[:most])
            for rows, most in ((parts.training, TRAINING), (parts.validation, VALIDATION))
        )
        found[name] = train_validated(training.new_network(HIDDEN, rng), training, watched).network
        errors[name] = rms(found[name], every.take(parts.test))
    return Networks(**found, errors=errors)


def direction_of(data: RigData, name: str) -> Dataset:
    """Inputs and outputs of the network of one of `DIRECTIONS`.

    Raises:
        ValueError: Unknown name.
    """
    pairs = ((data.lengths, data.measured), (data.measured, data.lengths))
    return Dataset(*Registry("direction", dict(zip(DIRECTIONS, pairs, strict=True))).find(name))


def distances(network: Network, data: Dataset) -> np.ndarray:
    """Norms (k,) of the errors of the outputs, in their unit."""
    return np.linalg.norm(network(data.inputs) - data.outputs, axis=1)


def rms(network: Network, data: Dataset) -> float:
    """Root of the mean squared norm of the errors, (3.6) and (5.1), in the outputs' unit."""
    return float(np.sqrt(np.mean(distances(network, data) ** 2)))
