"""Quasi-static networks of the spatial rig: s -> z (thesis sec. 3.2) and z -> s (sec. 5.1)."""

import numpy as np

from softrobot_env.identification.visits import RigData
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.registries import Registry

#: Neurons of the hidden layers.
HIDDEN = (10, 10)

#: Samples to train, and to stop the training with.
TRAINING, VALIDATION = 150, 32

#: Networks s -> z and z -> s.
DIRECTIONS = ("forward", "inverse")


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
