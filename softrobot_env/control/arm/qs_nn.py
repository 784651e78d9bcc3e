"""Quasi-static controller: a network as local inverse of the statics, at 5 Hz (thesis sec. 6.3)."""

from pathlib import Path

import numpy as np

from softrobot_env.artifacts import find_artifact
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.control.base import Controller, hold_for
from softrobot_env.control.status import NOT_FINITE, REASONS, SATURATED, Said
from softrobot_env.interfaces import Observation
from softrobot_env.learned.inference import absorbed
from softrobot_env.learned.network import Network, load_for
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

#: Time [s] between two decisions: the transients of one input decay in part before the next.
PERIOD = 0.2

#: Distance [m] by which the reference may lie beyond the tip positions of the training data,
#: a random sample that keeps some distance from the boundary of the workspace.
_MARGIN = 1e-3

_REQUIRES = ("tip_position", "reference_preview", "previous_action")
_LIMITED, _OUTSIDE, _BAD = 1, 2, 4  # codes of `_decide`; `_BAD` plus the index of an observable
_STATUSES = (
    None,
    REASONS[SATURATED],
    "outside the trained workspace",
    f"outside the trained workspace, {REASONS[SATURATED]}",
    *(f"{REASONS[NOT_FINITE]}: {name}" for name in _REQUIRES),
)


_STATES = tuple(Said(status) for status in _STATUSES)


class QuasiStaticNetwork(Controller):
    """u_k+1 = g(z_k, z_ref(t_k+1), u_k) every 0.2 s, g a network of 7-30-3 neurons (Fig. 6.8).

    The environment's preview must be the reference at the next decision alone: `preview=(0.2,)`.
    Beyond the workspace it was trained for the network extrapolates, and the state's `status` says
    so. When an observation is not finite, the action in force is kept.
    """

    requires = _REQUIRES

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
        self._n_inputs = len(robot.tendons) // 2
        ends = (4 + self._n_inputs, self._n_inputs)
        network, about = load_for(path, robot, "qs_nn", ends=ends)
        about.check_shape("workspace", (None, 2))
        self._network = _fold(network, TendonMap(robot).input_scale, about["workspace"])
        self.sizes = {"tip_position": 2, "previous_action": self._n_inputs}

    def start(self, observation: Observation) -> Said:
        """Nothing is remembered.

        Raises:
            ValueError: The environment has another preview than 0.2 s.
        """
        size = len(observation["reference_preview"])
        if size != 2:
            raise ValueError(
                f"qs_nn needs an environment with preview=({PERIOD:g},), the reference at its next "
                f"decision; this one's reference_preview has {size} entries, not 2"
            )
        return _STATES[0]

    def act(self, observation: Observation, state: Said) -> tuple[np.ndarray, Said]:
        """What the network gives, within the tension limit."""
        action = np.empty(self._n_inputs, np.float32)
        code = _decide(
            *self._network,  # a structure costs a call more than one by one
            np.ascontiguousarray(observation["tip_position"]),
            np.ascontiguousarray(observation["reference_preview"]),
            np.ascontiguousarray(observation["previous_action"]),
            action,
        )
        return action, _STATES[code]


def _fold(
    network: Network, input_scale: np.ndarray, workspace: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The network from observations in SI units to an action, as `_decide` takes it.

    Returns:
        rows: (n_hidden, n_in + 1 + n_inputs): of each hidden neuron the weights and bias of the
            raw inputs, and its weights in the action.
        offset: (n_inputs,) [1], biases of the action.
        workspace: (n_sectors, 2) [m], see `learned.quasi_static.workspace`, with the margin.
    """
    if len(network.weights) != 2:
        raise ValueError(f"qs_nn has one hidden layer, this network {len(network.weights) - 1}")
    (into, threshold), (out, offset) = absorbed(network)
    into[:, 4:] *= input_scale  # of actions, not inputs in N
    return (
        np.hstack([into, threshold[:, None], (out / input_scale[:, None]).T]),
        offset / input_scale,
        workspace + _MARGIN * np.array([-1.0, 1.0]),
    )


@kernel
def _decide(
    rows: np.ndarray,
    offset: np.ndarray,
    workspace: np.ndarray,
    tip: np.ndarray,
    target: np.ndarray,
    previous: np.ndarray,
    action: np.ndarray,
) -> int:
    """Write the action and return what is to be said about it, an index of `_STATUSES`."""
    n = len(action)
    sound = True
    for j in range(n):  # what stays where an observation cannot be used
        sound &= np.isfinite(previous[j])
        action[j] = min(max(previous[j], -1.0), 1.0) if np.isfinite(previous[j]) else 0.0
    if not np.isfinite(tip[0] + tip[1]):
        return _BAD
    if not np.isfinite(target[0] + target[1]):
        return _BAD + 1
    if not sound:
        return _BAD + 2
    total = offset.copy()
    for row in rows:
        value = row[0] * tip[0] + row[1] * tip[1] + row[2] * target[0] + row[3] * target[1]
        for j in range(n):
            value += row[4 + j] * previous[j]
        # tanh(x) = 1 - 2 / (exp(2 x) + 1), twice as fast as the library's.
        value = 1.0 - 2.0 / (np.exp(2.0 * (value + row[4 + n])) + 1.0)
        for j in range(n):
            total[j] += row[5 + n + j] * value
    code = 0
    for j in range(n):
        action[j] = min(max(total[j], -1.0), 1.0)
        if abs(total[j]) > 1.0:
            code = _LIMITED
    sectors = len(workspace)
    share = (np.arctan2(target[0], target[1]) + np.pi) / (2 * np.pi)
    nearest, farthest = workspace[min(int(share * sectors), sectors - 1)]
    distance = np.sqrt(target[0] * target[0] + target[1] * target[1])
    if not nearest <= distance <= farthest:
        code += _OUTSIDE
    return code
