"""Networks that learned on vectors, as policies that read dicts and choose inputs."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.control.base import (
    FINE,
    REASONS,
    SATURATED,
    Said,
    hold_for,
)
from softrobot_env.control.learned import neural
from softrobot_env.control.memoryless import Decide, Memoryless
from softrobot_env.core.files import models_dir
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.vector_reading import Reading, reading_in
from softrobot_env.learned.network import Network, absorbed, check_ends, load_for
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import find_artifact

_BEFORE = "previous_action"


def make_learned(
    robot: RobotParams,
    control_period: float,
    weights: str | Path | Network | None = None,
    policy: str = "imitation",
    view: neural.View | None = None,
) -> Policy:
    """The policy of a network, by what its file says that it reads: features, or a vector.

    Args:
        robot, control_period, weights, policy, view: As of `neural.NeuralPolicy`.

    Raises:
        ValueError, FileNotFoundError: As there.
    """
    if isinstance(weights, Network):
        return neural.NeuralPolicy(robot, control_period, weights, policy, view)
    path = find_artifact(robot, policy) if weights is None else models_dir() / weights
    network, about = load_for(path, robot, policy)
    reading = reading_in(about)
    if reading is None:
        return neural.NeuralPolicy(robot, control_period, path, policy)
    return VectorNetwork(robot, control_period, network, reading)


def learned_environment(
    policy: str, robot: RobotParams, weights: str | Path | None = None
) -> dict[str, Any]:
    """What a trained policy of a robot needs of an environment: its control period and preview.

    That of the arm's networks unless there is a file of the policy, which `make_policy` asks for.
    """
    try:
        path = find_artifact(robot, policy) if weights is None else Path(weights)
        reading = reading_in(Network.load(path)[1])
    except (OSError, ValueError):
        reading = None
    if reading is not None:
        return reading.environment
    return neural.environment_of(policy, robot, weights)


class VectorNetwork(Memoryless):
    """u = g(x), or u_k+1 = u_k + c g(x): x the vector of `Reading`, g bounded by 1.

    Any network that learned with `observe_as="vector"`, in any environment of that robot that has
    its observables, control period and preview. Where an observation is not finite, the action in
    force is kept.
    """

    says = tuple(Said(REASONS[code]) for code in (FINE, SATURATED))

    def __init__(
        self, robot: RobotParams, control_period: float, network: Network, reading: Reading
    ) -> None:
        """Put network and reading together.

        Args:
            robot: The one that the network was trained for.
            control_period: [s] between calls, a whole fraction of the network's own.
            network: From the vector to actions.
            reading: How the vector is read.

        Raises:
            ValueError: The control period does not divide the network's, or the network's ends are
                not those of vector and inputs.
        """
        self.hold = hold_for(float(reading.period), control_period, "the network")
        self.n_inputs = robot_inputs(robot).n_inputs
        check_ends(network, (len(reading.take), self.n_inputs))
        self.preview = tuple(map(float, reading.preview))
        names = tuple(map(str, reading.names))
        self.requires = (*names, *(() if _BEFORE in names else (_BEFORE,)))
        self.sizes = dict(zip(names, map(int, reading.sizes), strict=True))
        self.sizes[_BEFORE] = self.n_inputs
        self._reading, self._network = reading, network
        self._infer = PlainInference(network)
        self.prepare()

    def plain(self, observed: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """What the network gives, within the limits."""
        flat = np.concatenate([observed[str(name)] for name in self._reading.names], axis=1)
        seen = self._reading(flat).astype(np.float32).astype(float)
        wanted = np.clip(self._infer.batch(seen), -1.0, 1.0)
        if not self._reading.change:
            return wanted, np.full(len(wanted), FINE)
        wanted = np.clip(observed[_BEFORE], -1.0, 1.0) + self._reading.change * wanted
        actions = np.clip(wanted, -1.0, 1.0)
        return actions, np.where((actions != wanted).any(axis=1), SATURATED, FINE)

    def compiled(self) -> Decide:
        """`vector_kernel.decide` with this network and this reading."""
        from softrobot_env.beams.numerics.compilation import reference
        from softrobot_env.control.learned.vector_kernel import VectorLaw, decide
        from softrobot_env.learned.inference import parameters_of

        reading = self._reading
        less = np.full(len(reading.take), -1)
        less[reading.relative] = reading.less
        widths = np.cumsum([0, *(self.sizes[name] for name in self.requires)])
        parameters, sizes = parameters_of(absorbed(self._network))
        law = VectorLaw(
            width=int(widths[-1]),
            before=int(widths[self.requires.index(_BEFORE)]),
            take=np.ascontiguousarray(reading.take, dtype=np.int64),
            less=less,
            origin=np.ascontiguousarray(reading.origin, dtype=float),
            scale=np.ascontiguousarray(reading.scale, dtype=float),
            change=float(reading.change),
            parameters=parameters,
            sizes=sizes,
        )
        return partial(decide, reference(law))
