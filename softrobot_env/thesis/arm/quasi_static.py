"""Training data and network of the quasi-static controller (thesis sec. 6.3).

The network is the local inverse (z_k, z_ref,k+1, u_k) -> u_k+1 of the statics z = tip(u).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Count, NotNegative, Positive, Record
from softrobot_env.learned.network import Dataset, Network

#: Neurons of the hidden layer.
HIDDEN = (30,)

#: Sectors, as seen from the clamp, in which the workspace has a range of distances each.
_SECTORS = 72

#: Static tip (2,) [m] under reduced inputs (n_inputs,) [N].
Statics = Callable[[ndarray], ndarray]


@dataclass(frozen=True)
class Sampling(Record):
    """How training data are sampled.

    Attributes:
        pairs: Number of samples.
        force: [N], bound on every reduced input.
        change: [N], bound on the norm of the change u_k+1 - u_k (6.18).
        noise: [m], standard deviation on both coordinates of z_k. Without noise the network
            learns to trust z_k fully, and the loop is unstable at 5 Hz (audit of sec. 6.3); the
            default is the smallest with which all trainings made gave a stable loop.
    """

    pairs: Count = 10_000
    force: Positive = 20.0
    change: Positive = 0.05 * 20.0
    noise: NotNegative = 1.5e-3


def sample(tip: Statics, n_inputs: int, how: Sampling, rng: np.random.Generator) -> Dataset:
    """Inputs (z_k [m], z_ref,k+1 [m], u_k [N]) (k, 4 + n_inputs), and outputs u_k+1 [N].

    u_k is uniform within the force bound, u_k+1 in the ball around it.
    """
    before = rng.uniform(-how.force, how.force, (how.pairs, n_inputs))
    after = before + _in_ball(how.pairs, n_inputs, how.change, rng)
    outside = np.any(np.abs(after) > how.force, axis=1)
    while outside.any():
        after[outside] = before[outside] + _in_ball(outside.sum(), n_inputs, how.change, rng)
        outside = np.any(np.abs(after) > how.force, axis=1)
    here = np.array([tip(u) for u in before]) + how.noise * rng.standard_normal((how.pairs, 2))
    there = np.array([tip(u) for u in after])
    return Dataset(np.hstack([here, there, before]), after)


def _in_ball(count: int, dimension: int, radius: float, rng: np.random.Generator) -> ndarray:
    """Points (count, dimension) uniform in the ball."""
    points = rng.standard_normal((count, dimension))
    share = rng.uniform(0, 1, (count, 1)) ** (1 / dimension)
    return radius * share * points / np.linalg.norm(points, axis=1, keepdims=True)


def rms(network: Network, samples: Dataset) -> float:
    """Root mean square error [N] of an output."""
    return float(np.sqrt(np.mean((network(samples.inputs) - samples.outputs) ** 2)))


def workspace(points: ndarray) -> ndarray:
    """Smallest and largest distance [m] from the clamp of points (k, 2) [m], by sector.

    Returns:
        (n_sectors, 2), sectors of equal size by the angle from straight up, from -pi to pi; in
        empty ones the smallest is inf and the largest -inf.
    """
    share = (np.arctan2(points[:, 0], points[:, 1]) + pi) / (2 * pi)
    sector = np.minimum((share * _SECTORS).astype(int), _SECTORS - 1)
    distance = np.hypot(points[:, 0], points[:, 1])
    ranges = np.tile([np.inf, -np.inf], (_SECTORS, 1))
    np.minimum.at(ranges[:, 0], sector, distance)
    np.maximum.at(ranges[:, 1], sector, distance)
    return ranges
