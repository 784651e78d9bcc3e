"""Quasi-static controller: a network as local inverse of the statics, at 5 Hz (thesis sec. 6.3)."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy import ndarray

from softrobot_env.control.base import REASONS, SATURATED, Said, hold_for
from softrobot_env.control.feedforward.law import Feedforward
from softrobot_env.control.memoryless import Decide, Memoryless
from softrobot_env.core.interfaces import Policy
from softrobot_env.learned.network import Network, Scaling, absorbed, load_for
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.artifacts import find_artifact

#: Time [s] between two decisions: the transients of one input decay in part before the next.
PERIOD = 0.2

#: Distance [m] by which the reference may lie beyond the tip positions of the training data,
#: a random sample that keeps some distance from the boundary of the workspace.
_MARGIN = 1e-3

#: Added up, they are the codes of what is said.
_LIMITED, _OUTSIDE = 1, 2


class QuasiStaticNetwork(Memoryless):
    """u_k+1 = g(z_k, z_ref(t_k+1), u_k) every 0.2 s, g a network of 7-30-3 neurons (Fig. 6.8).

    As trained it corrects next to nothing of what the measured tip tells of a wrong model: it is a
    feedforward law (docs/models/qs_nn.md has why no training makes it another).

    The environment's preview must be the reference at the next decision alone: `preview=(0.2,)`.
    Beyond the workspace it was trained for the network extrapolates, and the state's `status` says
    so. When an observation is not finite, the action in force is kept.
    """

    requires = ("tip_position", "reference_preview", "previous_action")
    preview = (PERIOD,)
    says = (
        Said(None),
        Said(REASONS[SATURATED]),
        Said("outside the trained workspace"),
        Said(f"outside the trained workspace, {REASONS[SATURATED]}"),
    )

    def __init__(
        self, robot: RobotParams, control_period: float, weights: str | Path | None = None
    ) -> None:
        """Load the network.

        Args:
            robot: Nominal robot, the one the network was trained for.
            control_period: [s] between calls, a whole fraction of 0.2 s.
            weights: File that `softrobot train qs_nn` wrote; found unless given, see
                `artifacts.find_artifact`.

        Raises:
            ValueError: Another robot, or a control period that does not divide 0.2 s.
            FileNotFoundError: No such file.
        """
        self.hold = hold_for(PERIOD, control_period, "qs_nn")
        path = find_artifact(robot, "qs_nn") if weights is None else Path(weights)
        self.n_inputs = len(robot.tendons) // 2
        self.sizes = {"tip_position": 2, "reference_preview": 2, "previous_action": self.n_inputs}
        ends = (4 + self.n_inputs, self.n_inputs)
        network, about = load_for(path, robot, "qs_nn", ends=ends)
        about.check_shapes({"workspace": (None, 2)})
        self._network = _of_actions(network, TendonMap(robot).input_scale)
        self._workspace = about["workspace"] + _MARGIN * np.array([-1.0, 1.0])
        self._infer = PlainInference(self._network)
        self.prepare()

    def plain(self, observed: dict[str, ndarray]) -> tuple[ndarray, ndarray]:
        """What the network gives, within the tension limit."""
        wanted = self._infer.batch(np.hstack([observed[name] for name in self.requires]))
        limited = (np.abs(wanted) > 1.0).any(axis=1)
        x, z = observed["reference_preview"].T
        share = (np.arctan2(x, z) + np.pi) / (2 * np.pi)
        sectors = len(self._workspace)
        at = np.minimum((share * sectors).astype(int), sectors - 1)
        nearest, farthest = self._workspace[at].T
        distance = np.hypot(x, z)
        inside = (nearest <= distance) & (distance <= farthest)
        return np.clip(wanted, -1.0, 1.0), _LIMITED * limited + _OUTSIDE * ~inside

    def compiled(self) -> Decide:
        """`qs_nn_kernel.decide` with this network and workspace."""
        from softrobot_env.learned.inference import parameters_of

        from .qs_nn_kernel import decide

        return partial(decide, *parameters_of(absorbed(self._network)), self._workspace)


def _of_actions(network: Network, input_scale: ndarray) -> Network:
    """The network from tip, reference and actions to actions, in place of inputs in N."""
    ends = np.concatenate([np.ones(4), input_scale]), input_scale
    inputs, outputs = (
        Scaling(scaling.low / scale, scaling.high / scale)
        for scaling, scale in zip((network.inputs, network.outputs), ends, strict=True)
    )
    return replace(network, inputs=inputs, outputs=outputs)


def make_network(
    robot: RobotParams, control_period: float, weights: str | Path | None = None
) -> Policy:
    """The quasi-static network: the thesis' local inverse of the arm, or one of places.

    Args:
        robot: The arm.
        control_period: [s] between calls.
        weights: File of either kind; found unless given, see `artifacts.find_artifact`.

    Raises:
        ValueError: No network of this robot, or a control period that the arm's cannot have.
        FileNotFoundError: No such file.
    """
    path = find_artifact(robot, "qs_nn") if weights is None else Path(weights)
    if not path.is_file() or "workspace" in Network.load(path)[1]:
        return QuasiStaticNetwork(robot, control_period, path)
    return Feedforward(robot, control_period, weights=path)
