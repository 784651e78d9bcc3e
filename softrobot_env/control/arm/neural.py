"""A small network as controller, trained by imitation and reinforcement learning."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from softrobot_env.control.base import Controller, hold_for, state_sizes, usable
from softrobot_env.control.status import NOT_FINITE, REASONS, SATURATED, UNREACHABLE, Said
from softrobot_env.interfaces import Observation
from softrobot_env.learned.network import Network, check_ends, load_for
from softrobot_env.paths import models_dir
from softrobot_env.robots import RobotParams

#: Time [s] between two decisions.
PERIOD = 0.01

#: Times [s] ahead at which the policy sees the reference; the environments' default.
PREVIEW = (0.05, 0.1, 0.2, 0.4)

#: Keyword arguments of the environment that the policy needs.
ENVIRONMENT = {"control_period": PERIOD, "preview": PREVIEW}

#: Change of the action [1] up to which `increment` is nearly linear, and its steepness, by which
#: outputs of +-1 change the action by +-1.
_FINE = 0.01
_STEEPNESS = float(np.arcsinh(1 / _FINE))

#: Scales of the features: two of the tip's error [m], the second one within asinh, then reference
#: velocity [m/s], preview less reference [m], curvature [1/m], its rate [1/(m s)] and action [1].
_COARSE_ERROR, _FINE_ERROR = 0.05, 0.001
_VELOCITY, _AHEAD, _CURVATURE, _RATE, _ACTION = 0.1, 0.02, 3.0, 20.0, 0.15

#: Largest feature [1], of either sign.
_LARGEST = 10.0


def features(observation: Mapping[str, np.ndarray]) -> np.ndarray:
    """What the network sees, float32 (..., 29) of observations (..., size) in SI units.

    Errors come twice: proportionally, and compressed so that a tenth of a millimetre still counts.
    """
    reference = observation["reference"]
    error = reference - observation["tip_position"]
    preview = observation["reference_preview"]
    ahead = preview - np.tile(reference, preview.shape[-1] // 2)
    parts = (
        error / _COARSE_ERROR,
        np.arcsinh(error / _FINE_ERROR) / 2,
        observation["reference_velocity"] / _VELOCITY,
        ahead / _AHEAD,
        observation["curvature"] / _CURVATURE,
        observation["curvature_rate"] / _RATE,
        observation["previous_action"] / _ACTION,
    )
    return np.clip(np.concatenate(parts, axis=-1), -_LARGEST, _LARGEST).astype(np.float32)


def feature_count(robot: RobotParams) -> int:
    """Number of `features` of a robot."""
    sizes = state_sizes(robot)
    return 6 + 2 * len(PREVIEW) + 2 * sizes["curvature"] + sizes["previous_action"]


def increment(output: np.ndarray) -> np.ndarray:
    """Change of the action [1] of outputs in [-1, 1]: fine about zero, coarse far away."""
    return _FINE * np.sinh(_STEEPNESS * np.clip(output, -1.0, 1.0))


def output_of(change: np.ndarray) -> np.ndarray:
    """Inverse of `increment`, limited to [-1, 1]."""
    return np.clip(np.arcsinh(change / _FINE) / _STEEPNESS, -1.0, 1.0)


class NeuralPolicy(Controller):
    """u_k+1 = u_k + increment(g(features)), g a small tanh network, every 10 ms.

    As the network only changes the action in force, it integrates: a steady error moves on. The
    environment's preview must be `PREVIEW`. When an observation is not finite, the action in
    force is kept.
    """

    requires = (
        "tip_position",
        "curvature",
        "curvature_rate",
        "reference",
        "reference_velocity",
        "reference_preview",
        "previous_action",
    )

    def __init__(
        self, robot: RobotParams, control_period: float, weights: str | Path | Network
    ) -> None:
        """Load the network.

        Args:
            robot: Nominal robot, the one the network was trained for.
            control_period: [s] between calls, a whole fraction of 10 ms.
            weights: File that `softrobot train` wrote, the name of one in the models' folder, or
                a network at hand.

        Raises:
            ValueError: Another robot, or a control period that does not divide 10 ms.
            FileNotFoundError: No such file.
        """
        self.hold = hold_for(PERIOD, control_period, "the network")
        sizes, network = state_sizes(robot), weights
        if not isinstance(weights, Network):  # an absolute path stays what it is
            network, _ = load_for(models_dir() / weights, robot, "softrobot train")
        check_ends(network, (feature_count(robot), sizes["previous_action"]))
        sizes |= {
            "reference_velocity": 2,
            "reference_preview": 2 * len(PREVIEW),
        }
        self.sizes, self._reach = sizes, robot.length
        weights = tuple(weight.astype(float) for weight in network.weights)
        self._network = replace(network, weights=weights)  # mixed precision would be slower

    def start(self, observation: Observation) -> Said:
        """Nothing is remembered."""
        return Said(None)

    def act(self, observation: Observation, state: Said) -> tuple[np.ndarray, Said]:
        """What the network gives, within the tension limit."""
        before = observation["previous_action"]
        for name in self.requires:
            if not np.isfinite(observation[name]).all():
                kept = np.clip(usable(before), -1.0, 1.0)
                return kept, Said(f"{REASONS[NOT_FINITE]}: {name}")
        wanted = np.clip(before, -1.0, 1.0) + increment(self._network(features(observation)))
        action = np.clip(wanted, -1.0, 1.0)
        status = REASONS[SATURATED] if np.any(action != wanted) else None
        if np.hypot(*observation["reference"]) > self._reach:
            status = REASONS[UNREACHABLE]
        return action, Said(status)
