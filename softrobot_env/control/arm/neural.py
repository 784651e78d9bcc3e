"""A small network as controller, trained by imitation and reinforcement learning."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from softrobot_env.control.base import hold_for, state_sizes
from softrobot_env.control.memoryless import Decide, Memoryless
from softrobot_env.control.status import FINE, REASONS, SATURATED, UNREACHABLE, Said
from softrobot_env.learned.network import Network, check_ends, load_for
from softrobot_env.learned.plain_inference import PlainInference, absorbed
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


class NeuralPolicy(Memoryless):
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
    preview = PREVIEW
    says = tuple(Said(REASONS[code]) for code in (FINE, SATURATED, UNREACHABLE))

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
        self.n_inputs = sizes["previous_action"]
        check_ends(network, (feature_count(robot), self.n_inputs))
        ahead = {"reference_velocity": 2, "reference_preview": 2 * len(PREVIEW)}
        self.sizes, self._reach, self._network = sizes | ahead, float(robot.length), network
        self._infer = PlainInference(network)
        self.prepare()

    def plain(self, observed: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """What the network gives, within the tension limit."""
        changes = increment(self._infer.batch(features(observed).astype(float)))
        wanted = np.clip(observed["previous_action"], -1.0, 1.0) + changes
        actions = np.clip(wanted, -1.0, 1.0)
        codes = np.where((actions != wanted).any(axis=1), SATURATED, FINE)
        far = np.hypot(*observed["reference"].T) > self._reach
        return actions, np.where(far, UNREACHABLE, codes)

    def compiled(self) -> Decide:
        """`neural_kernel.decide` with this network and these scales."""
        from softrobot_env.beams.numerics.compilation import reference
        from softrobot_env.control.arm.neural_kernel import NeuralLaw, decide
        from softrobot_env.learned.inference import parameters_of

        counts = [self.sizes[name] for name in ("curvature", "curvature_rate")]
        parameters, sizes = parameters_of(absorbed(self._network))
        law = NeuralLaw(
            ends=np.cumsum([self.sizes[name] for name in self.requires]),
            coarse=_COARSE_ERROR,
            fine=_FINE_ERROR,
            motion=np.repeat([_CURVATURE, _RATE], counts),
            velocity=_VELOCITY,
            ahead=_AHEAD,
            action=_ACTION,
            largest=_LARGEST,
            gain=_FINE,
            steepness=_STEEPNESS,
            reach=self._reach,
            parameters=parameters,
            sizes=sizes,
        )
        return partial(decide, reference(law))
