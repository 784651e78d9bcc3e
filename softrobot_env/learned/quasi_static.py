"""Training data and network of the quasi-static controller (thesis sec. 6.3).

The network is the local inverse (z_k, z_ref,k+1, u_k) -> u_k+1 of the statics z = tip(u).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from softrobot_env.learned.bayesian import Fit, Progress, train
from softrobot_env.learned.network import Network, Scaling, initial_network
from softrobot_env.robots import RobotParams

#: Neurons of the hidden layer.
HIDDEN = (30,)

#: Sectors, as seen from the clamp, in which the workspace has a range of distances each.
_SECTORS = 72

#: What the statics of a robot depend on, by name.
Describe = Callable[[RobotParams], dict[str, np.ndarray]]

#: Static tip (2,) [m] under reduced inputs (n_inputs,) [N].
Statics = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Sampling:
    """How training data are drawn.

    Attributes:
        pairs: Number of samples.
        force: [N], bound on every reduced input.
        change: [N], bound on the norm of the change u_k+1 - u_k (6.18).
        noise: [m], standard deviation on both coordinates of z_k. Without noise the network
            learns to trust z_k fully, and the loop is unstable at 5 Hz (audit of sec. 6.3); the
            default is the smallest with which all trainings tried gave a stable loop.
    """

    pairs: int = 10_000
    force: float = 20.0
    change: float = 0.05 * 20.0
    noise: float = 1.5e-3


@dataclass(frozen=True)
class Samples:
    """Training data.

    Attributes:
        inputs: (k, 4 + n_inputs): z_k [m], z_ref,k+1 [m], u_k [N].
        outputs: (k, n_inputs): u_k+1 [N].
    """

    inputs: np.ndarray
    outputs: np.ndarray

    @property
    def reached(self) -> np.ndarray:
        """(k, 2) [m], the tip positions asked for."""
        return self.inputs[:, 2:4]


def sample(tip: Statics, n_inputs: int, how: Sampling, rng: np.random.Generator) -> Samples:
    """Draw u_k uniformly within the force bound and u_k+1 uniformly in the ball around it."""
    before = rng.uniform(-how.force, how.force, (how.pairs, n_inputs))
    after = before + _in_ball(how.pairs, n_inputs, how.change, rng)
    outside = np.any(np.abs(after) > how.force, axis=1)
    while outside.any():
        after[outside] = before[outside] + _in_ball(outside.sum(), n_inputs, how.change, rng)
        outside = np.any(np.abs(after) > how.force, axis=1)
    here = np.array([tip(u) for u in before]) + how.noise * rng.standard_normal((how.pairs, 2))
    there = np.array([tip(u) for u in after])
    return Samples(np.hstack([here, there, before]), after)


def _in_ball(count: int, dimension: int, radius: float, rng: np.random.Generator) -> np.ndarray:
    """Points (count, dimension) uniform in the ball."""
    points = rng.standard_normal((count, dimension))
    share = rng.uniform(0, 1, (count, 1)) ** (1 / dimension)
    return radius * share * points / np.linalg.norm(points, axis=1, keepdims=True)


def fit_inverse(
    samples: Samples,
    rng: np.random.Generator,
    iterations: int = 200,
    progress: Progress | None = None,
) -> Fit:
    """Train a new network on samples."""
    inputs, outputs = Scaling.of(samples.inputs), Scaling.of(samples.outputs)
    network = initial_network(HIDDEN, inputs, outputs, rng)
    return train(network, samples.inputs, samples.outputs, iterations, progress)


def rms(network: Network, samples: Samples) -> float:
    """Root mean square error [N] of an output."""
    return float(np.sqrt(np.mean((network(samples.inputs) - samples.outputs) ** 2)))


def workspace(points: np.ndarray) -> np.ndarray:
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


def describe(robot: RobotParams) -> dict[str, np.ndarray]:
    """What the statics of a robot depend on, by name; the first is the robot's own name."""
    return {
        "robot": np.array(robot.name),
        "length": np.array(robot.length),
        "bending_stiffness": np.array(robot.bending_stiffness),
        "tendon_offset": np.array([t.offset for t in robot.tendons]),
        "tendon_end": np.array([t.end for t in robot.tendons]),
    }


def suits(about: dict[str, np.ndarray], robot: RobotParams, described: Describe = describe) -> bool:
    """Whether a network was trained for this robot, by the description that its file has."""
    wanted = described(robot)
    return all(name in about and _same(about[name], value) for name, value in wanted.items())


def load_for(
    path: Path, robot: RobotParams, command: str, described: Describe = describe
) -> tuple[Network, dict]:
    """Network and description from a file that belongs to a robot.

    Args:
        path: The file.
        robot: The robot.
        command: Makes the file.
        described: What the file tells of its robot.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It belongs to another robot.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no network at {path}; make it with `{command}`")
    network, about = Network.load(path)
    if not suits(about, robot, described):
        raise ValueError(
            f"{path} was trained for robot {str(about.get('robot'))!r} as it was then, not for "
            f"this {robot.name!r}; train it anew with `{command}`"
        )
    return network, about


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    if other.dtype.kind == "U":
        return str(one) == str(other)
    return one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=0)
