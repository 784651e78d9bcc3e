"""Network of a robot's inverse statics: the tip's place -> the actions that hold it there.

The quasi-static controller of the thesis (sec. 5.1) for any robot, trained with samples of the
inverse statics of its MuJoCo chain.
"""

from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.records import Count, Record
from softrobot_env.learned.network import Dataset, Network
from softrobot_env.learned.training import train_regularised
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Held, InverseStatics
from softrobot_env.scene.registry import model_scene

from .request import Metrics, TrainingRequest, quantity_mm

#: Of the places that are known, those that another is looked for from.
_NEIGHBOURS = 3

#: Share of the samples that the training does not see.
_KEPT = 0.15


@dataclass(frozen=True)
class Learning(Record):
    """How a network is trained.

    Attributes:
        samples: Number of places; some are left out, where no inputs hold the tip.
        hidden: Neurons of each hidden layer.
        iterations: Most steps of the training.
    """

    samples: Count = 1200
    hidden: tuple[Count, ...] = (20, 20)
    iterations: Count = 150


@dataclass(frozen=True)
class Trained:
    """A network, and how well it knows places that it has not seen.

    Attributes:
        network: Tip (k,) [m] in the world's x and z, x and y, or x, y and z -> actions.
        about: For its file: of which robot it is, the places it has seen and how near to one of
            them a place has to be.
        errors: (n,) [m], how far from places it has not seen it brings the tip to rest.
    """

    network: Network
    about: dict[str, object]
    errors: ndarray


def train(
    robot: RobotParams, seed: int = 0, show: ProgressCallback = quiet, how: Learning | None = None
) -> Trained:
    """Train the network of a robot.

    Raises:
        ValueError: The robot has no tendons, or its tip only moves on a line.
        EquilibriumError: There is none for the action 0.
    """
    how = how or Learning()
    rng = np.random.default_rng(seed)
    inverse = inverse_of(robot)
    tips, held = hold_sample(inverse, how.samples, show)
    scale, centre = inverse.inputs.input_scale, inverse.inputs.input_centre
    data = Dataset(tips, (held.inputs - centre) / scale)
    order = rng.permutation(len(tips))
    kept = max(1, int(_KEPT * len(tips)))
    seen, unseen = data.take(order[kept:]), order[:kept]
    fit = train_regularised(
        seen.new_network(how.hidden, rng),
        seen,
        how.iterations,
        lambda done, total, error: show(f"squared error {error:.4g}", done, total),
    )
    errors = _errors(inverse, fit.network, tips[unseen], held.postures[unseen])
    about = fingerprint(robot) | {
        "tips": seen.inputs,
        "spacing": _spacing(seen.inputs),
        "error": float(np.median(errors)),
        "seed": seed,
    }
    return Trained(fit.network, about, errors)


def run(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Train as requested and write the file."""
    how = Learning(samples=400, iterations=20) if "quick" in request.settings else None
    trained = train(request.robot, request.seed, show, how)
    trained.network.save(request.path, trained.about)
    off = trained.errors
    return [
        ("median error of the tip at rest, unseen places", quantity_mm(median(off))),
        ("largest", quantity_mm(max(off))),
        ("parameters", str(len(trained.network.parameters))),
    ]


def inverse_of(robot: RobotParams) -> InverseStatics:
    """Inverse statics in all coordinates that a robot's inputs move freely."""
    inverse = InverseStatics(build_scene(model_scene(robot)))
    if inverse.freedom < 2:
        raise ValueError(
            f"robot {robot.name!r} has {inverse.freedom} independent input: its tip moves on a "
            "line, and a network of places needs two"
        )
    planar = inverse.scene.config.bending == "planar"
    axes = [0, 2] if planar else [0, 1, 2][: min(3, inverse.freedom)]
    return inverse.along(np.eye(3)[axes])


def hold_sample(
    inverse: InverseStatics, count: int, show: ProgressCallback = quiet
) -> tuple[ndarray, Held]:
    """Places (n, k) [m] all over the workspace, and the inputs of least norm that hold them.

    Each is looked for from the nearest that are known, so that neighbours have like inputs.
    """
    sample = inverse.sample(count)
    points = np.array([inverse.tip(posture) for posture in sample.postures])
    tips = points @ inverse.directions.T
    rows, found = [inverse.solve(points[:1])], [0]
    for k in range(1, len(tips)):
        if k % 20 == 0:
            show("inverse statics", k, len(tips))
        near = np.argsort(norm(tips[found] - tips[k], axis=1))[:_NEIGHBOURS]
        tried = [inverse.solve(points[k : k + 1], rows[i], anywhere=False) for i in near]
        reached = [held for held in tried if held.errors[0] <= inverse.tolerance]
        if reached:
            rows.append(min(reached, key=lambda held: norm(held.inputs[0])))
            found.append(k)
    return tips[found], Held(*(np.concatenate(parts) for parts in zip(*rows, strict=True)))


def _errors(inverse: InverseStatics, network: Network, tips: ndarray, postures: ndarray) -> ndarray:
    """Distances (n,) [m] of tips (n, k) from where the network's inputs let them rest."""
    actions = np.clip(network(tips), -1.0, 1.0)
    wanted = inverse.inputs.from_actions(actions)
    rests = [inverse.posture(u, q) for u, q in zip(wanted, postures, strict=True)]
    reached = np.array([inverse.directions @ inverse.tip(rest) for rest in rests])
    return norm(reached - tips, axis=1)


def _spacing(tips: ndarray) -> float:
    """[m], within which nearly every place has another."""
    apart = norm(tips[:, None] - tips[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.quantile(apart.min(axis=1), 0.98))
