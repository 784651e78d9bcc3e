"""Small networks as controllers of any robot, trained by imitation or reinforcement learning.

They read observables of a robot at suitable scales (`View`), or the vector that they were trained
on (`core.vector_reading`); either is an `Encoding`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property, partial
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import Arrays
from softrobot_env.core.files import models_dir
from softrobot_env.core.records import Positive, Record
from softrobot_env.core.vector_reading import Reading, reading_in
from softrobot_env.learned.network import Network, absorbed, check_ends, load_for
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import find_artifact

from ..base import FINE, REASONS, SATURATED, UNREACHABLE, Said, hold_for, state_sizes
from ..memoryless import Decide, Memoryless

#: Time [s] between two decisions on the arm.
PERIOD = 0.01

#: Times [s] ahead at which the policy of the arm sees the reference; the environments' default.
PREVIEW = (0.05, 0.1, 0.2, 0.4)

#: For other robots: least number of decisions in a period of the first mode, the periods [s] to
#: choose from, and the preview times in periods of the first mode.
_DECISIONS, _PERIODS = 60, (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
_AHEAD_TIMES = (1 / 24, 1 / 12, 1 / 6, 1 / 3)

#: For the arm, change of the action [1] up to which it is nearly linear in the output; and largest
#: change of a servo's action over what the servo can do in a period.
_FINE, _ROOM = 0.01, 2.0

#: Scale [1] of the current inputs.
_ACTION = 0.15

#: Largest magnitude of a feature [1].
_LARGEST = 10.0

_VIEW, _BEFORE = "view_", "previous_action"

#: Defaults for what earlier files do not contain.
_LATER = ("change", "most")


class Encoding(NamedTuple):
    """The inputs of a network, and the effect of its outputs.

    A feature is an entry x of the observables, perhaps minus another one: (x - origin) / scale, or
    gain * asinh of that where there is a gain, limited to +-largest. An output o in [-1, 1] is an
    action, or changes the current action by change * o, or by change * sinh(steepness * o).

    Attributes:
        take: (k,), indices of the entries.
        less: (k,), indices of the entries subtracted, -1 for none.
        origin, scale: (k,), in the unit of each.
        gain: (k,) [1], 0 for linear features.
        largest: [1].
        change, steepness: [1], 0 if not used.
    """

    take: ndarray
    less: ndarray
    origin: ndarray
    scale: ndarray
    gain: ndarray
    largest: float
    change: float
    steepness: float

    def features(self, flat: ndarray) -> ndarray:
        """Features, float32 (..., k), of all observations (..., size) in SI units."""
        less = np.where(self.less < 0, 0.0, flat[..., self.less])
        values = (flat[..., self.take] - less - self.origin) / self.scale
        curved = self.gain > 0
        values[..., curved] = self.gain[curved] * np.arcsinh(values[..., curved])
        return np.clip(values, -self.largest, self.largest).astype(np.float32)

    def increment(self, output: ndarray) -> ndarray:
        """Change of the action [1] for outputs, which are limited to [-1, 1]."""
        output = np.clip(output, -1.0, 1.0)
        return self.change * (np.sinh(self.steepness * output) if self.steepness else output)


def _places(observed: Mapping[str, int]) -> dict[str, ndarray]:
    """Indices of the observables' entries when they are concatenated."""
    ends = np.cumsum([*observed.values()])
    return {n: np.arange(end - observed[n], end) for n, end in zip(observed, ends, strict=True)}


@dataclass(frozen=True)
class View(Record):
    """What a robot's network sees, at which scales, and when it decides.

    Attributes:
        period: [s] between two decisions.
        preview: [s], times ahead at which it sees the reference.
        dimensions: Coordinates of the tip.
        inputs: Number of actions.
        state: Observables of the robot's motion.
        sizes: Their sizes.
        scales: Of each, in its unit.
        coarse, fine: [m], scales of the tip's error, the second one inside asinh.
        velocity: [m/s], scale of the reference's velocity.
        ahead: [m], scale of the preview minus the reference.
        action: Scale [1] of the current inputs.
        change, most: [1], change of an action up to which it is nearly linear in the output, and
            the change for an output of 1.
    """

    period: Positive
    preview: tuple[Positive, ...]
    dimensions: int
    inputs: int
    state: tuple[str, ...]
    sizes: tuple[int, ...]
    scales: tuple[Positive, ...]
    coarse: Positive
    fine: Positive
    velocity: Positive
    ahead: Positive
    action: Positive
    change: Positive = _FINE
    most: Positive = 1.0

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment that the policy needs."""
        return {"control_period": self.period, "preview": self.preview}

    @property
    def steepness(self) -> float:
        """s [1]: an output o changes an action by `change` * sinh(s o)."""
        return float(np.arcsinh(self.most / self.change))

    def increment(self, output: ndarray) -> ndarray:
        """Change of the action [1] for outputs in [-1, 1]: fine near zero, coarse far away."""
        return self.encoding.increment(output)

    def output_of(self, change: ndarray) -> ndarray:
        """Inverse of `increment`, limited to [-1, 1]."""
        return np.clip(np.arcsinh(change / self.change) / self.steepness, -1.0, 1.0)

    @property
    def count(self) -> int:
        """Number of features."""
        return (3 + len(self.preview)) * self.dimensions + sum(self.sizes) + self.inputs

    @property
    def observed(self) -> dict[str, int]:
        """Observables that are read, with their sizes."""
        return {
            "tip_position": self.dimensions,
            **dict(zip(self.state, self.sizes, strict=True)),
            "reference": self.dimensions,
            "reference_velocity": self.dimensions,
            "reference_preview": len(self.preview) * self.dimensions,
            _BEFORE: self.inputs,
        }

    @cached_property
    def encoding(self) -> Encoding:
        """Errors enter twice: linearly, and compressed so that a tenth of a millimetre counts."""
        at = _places(self.observed)
        tip, reference = at["tip_position"], at["reference"]
        nothing = {name: np.full(len(places), -1) for name, places in at.items()}
        parts = [
            (reference, tip, self.coarse, 0.0),
            (reference, tip, self.fine, 0.5),
            (at["reference_velocity"], nothing["reference"], self.velocity, 0.0),
            (at["reference_preview"], np.tile(reference, len(self.preview)), self.ahead, 0.0),
        ]
        scales = {**dict(zip(self.state, self.scales, strict=True)), _BEFORE: self.action}
        parts += [(at[name], nothing[name], scale, 0.0) for name, scale in scales.items()]
        take, less, scale, gain = (
            np.concatenate([np.broadcast_to(part[k], len(part[0])) for part in parts])
            for k in range(4)
        )
        more = _LARGEST, self.change, self.steepness
        return Encoding(take, less, np.zeros(len(take)), scale, gain, *more)

    def about(self) -> dict[str, Any]:
        """The description of the view in a network's file."""
        return {f"{_VIEW}{field.name}": getattr(self, field.name) for field in fields(self)}


def view_in(about: Arrays, robot: RobotParams) -> View:
    """The view described in a file; without a description, that of the arm."""
    names = [field.name for field in fields(View)]
    if f"{_VIEW}{names[0]}" not in about:
        return arm_view(robot)
    stored = [n for n in names if n not in _LATER or f"{_VIEW}{n}" in about]
    return View(**{name: about[f"{_VIEW}{name}"].tolist() for name in stored})


def arm_view(robot: RobotParams) -> View:
    """The view of the thesis' arm, with the scales of its shipped networks."""
    sizes, state = state_sizes(robot), ("curvature", "curvature_rate")
    return View(
        period=PERIOD,
        preview=PREVIEW,
        dimensions=sizes["tip_position"],
        inputs=sizes["previous_action"],
        state=state,
        sizes=tuple(sizes[name] for name in state),
        scales=(3.0, 20.0),
        coarse=0.05,
        fine=0.001,
        velocity=0.1,
        ahead=0.02,
        action=_ACTION,
    )


def view_of(robot: RobotParams, sizes: Mapping[str, int], period: float | None = None) -> View:
    """The view of any robot, with scales that would be about the same for the arm.

    Args:
        robot: The robot.
        sizes: Entries of its observables.
        period: [s] between two decisions, by default from the first mode.

    Raises:
        ValueError, EquilibriumError: It has no first mode at rest.
    """
    from ..scheduled.timing import timing_of

    first = timing_of(robot).first
    if period is None:
        period = max((p for p in _PERIODS if _DECISIONS * p <= first), default=_PERIODS[0])
    rate, bend = 2 * pi / first, 1.5 / robot.length
    scales = {"curvature": bend, "curvature_rate": 1.3 * bend * rate}
    if robot.drive.kind == "length":  # positions of the servos, which may lag behind the inputs
        scales["tendon_length"] = _ACTION * float(robot_inputs(robot).input_scale.max())
    most = min(
        1.0, _ROOM * robot.drive.speed * period / float(robot_inputs(robot).input_scale.min())
    )
    ahead = dict.fromkeys(max(1, round(share * first / period)) for share in _AHEAD_TIMES)
    return View(
        period=period,
        preview=tuple(round(steps * period, 9) for steps in ahead),
        dimensions=sizes["tip_position"],
        inputs=sizes["previous_action"],
        state=tuple(scales),
        sizes=tuple(sizes[name] for name in scales),
        scales=tuple(scales.values()),
        coarse=0.1 * robot.reach,
        fine=0.002 * robot.reach,
        velocity=0.04 * robot.reach * rate,
        ahead=0.04 * robot.reach,
        action=_ACTION,
        change=min(_FINE * _DECISIONS * period / first, most / 10),
        most=most,
    )


def features(observation: Mapping[str, ndarray], view: View) -> ndarray:
    """What the network sees, float32 (..., count) of observations (..., size) in SI units."""
    flat = np.concatenate([observation[name] for name in view.observed], axis=-1)
    return view.encoding.features(flat)


def _of_vector(reading: Reading) -> Encoding:
    """The encoding of a network that was trained on vectors."""
    k = len(reading.take)
    less = np.full(k, -1)
    less[reading.relative] = reading.less
    origin, scale = (np.array(x, float) for x in (reading.origin, reading.scale))
    take, change = np.array(reading.take, np.int64), float(reading.change)
    return Encoding(take, less, origin, scale, np.ones(k), np.inf, change, 0.0)


def learned_environment(
    policy: str, robot: RobotParams, weights: str | Path | None = None
) -> dict[str, Any]:
    """The control period and preview that a robot's trained policy needs of an environment.

    Those of the arm's networks if there is no file of the policy; `make_policy` requires one.
    """
    try:
        _, about = Network.load(find_artifact(robot, policy) if weights is None else weights)
        return (reading_in(about) or view_in(about, robot)).environment
    except (OSError, ValueError):
        return {"control_period": PERIOD, "preview": PREVIEW}


class NeuralPolicy(Memoryless):
    """u = g(x), or u_k+1 = u_k + h(g(x)), g a small tanh network and x what it sees.

    A network that only changes the current action acts as an integrator: a steady error keeps
    moving it. Its `View` or vector defines how often it decides and which preview the environment
    must have: for the arm every 10 ms, and `PREVIEW`. When an observation is not finite, the
    current action is kept.

    Attributes:
        view: What it sees; None for a network that was trained on vectors.
    """

    says = tuple(Said(REASONS[code]) for code in (FINE, SATURATED, UNREACHABLE))

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        weights: str | Path | Network | None = None,
        policy: str = "imitation",
        view: View | Reading | None = None,
    ) -> None:
        """Load the network.

        Args:
            robot: Nominal robot, the one the network was trained for.
            control_period: [s] between calls, a whole fraction of the network's period.
            weights: File written by `softrobot train`, the name of one in the models' folder, or a
                network object; by default that of `policy`, see `artifacts.find_artifact`.
            policy: Name of the policy that the network belongs to.
            view: View of a network object, or the vector that it reads; by default the arm's view.

        Raises:
            ValueError: The robot is another one, the control period does not divide the network's,
                or the sizes of the network's inputs and outputs do not fit.
            FileNotFoundError: No such file.
        """
        network, reading, self.n_inputs = weights, None, robot_inputs(robot).n_inputs
        if not isinstance(weights, Network):
            # An absolute path stays unchanged.
            path = find_artifact(robot, policy) if weights is None else models_dir() / weights
            network, about = load_for(path, robot, policy)
            reading = reading_in(about)
            view = view_in(about, robot) if reading is None else None
        elif isinstance(view, Reading):
            reading, view = view, None
        elif view is None:
            view = arm_view(robot)
        needed = (reading or view).environment
        self.hold = hold_for(needed["control_period"], control_period, "the network")
        self.view, self.preview = view, tuple(needed["preview"])
        self._base, self._reach = np.empty(0), np.inf
        if reading is None:
            self._encoding, self.sizes = view.encoding, view.observed
            base = np.array(robot.clamp.position, float)
            self._base = base[[0, 2] if robot.moves_in_xz else slice(view.dimensions)]
            self._reach = float(robot.reach)
        else:
            self._encoding = _of_vector(reading)
            sizes = zip(map(str, reading.names), map(int, reading.sizes), strict=True)
            self.sizes = {**dict(sizes), _BEFORE: self.n_inputs}
        check_ends(network, (len(self._encoding.take), self.n_inputs))
        self.requires = tuple(self.sizes)
        self._network, self._infer = network, PlainInference(network)
        self.prepare()

    def plain(self, observed: Mapping[str, ndarray]) -> tuple[ndarray, ndarray]:
        """The output of the network, within the limits."""
        flat = np.hstack([observed[name] for name in self.requires])
        given = self._infer.batch(self._encoding.features(flat).astype(float))
        wanted = np.clip(given, -1.0, 1.0)
        if self._encoding.change:
            wanted = np.clip(observed[_BEFORE], -1.0, 1.0) + self._encoding.increment(given)
        actions = np.clip(wanted, -1.0, 1.0)
        codes = np.where((actions != wanted).any(axis=1), SATURATED, FINE)
        if len(self._base):
            far = np.linalg.norm(observed["reference"] - self._base, axis=1) > self._reach
            codes = np.where(far, UNREACHABLE, codes)
        return actions, codes

    def compiled(self) -> Decide:
        """`vector_kernel.decide` for this network and its encoding."""
        from softrobot_env.compile.kernels import reference
        from softrobot_env.learned.inference import parameters_of

        from .vector_kernel import NetworkLaw, decide

        places = _places(self.sizes)
        law = NetworkLaw(
            sum(self.sizes.values()),
            places[_BEFORE][0],
            places["reference"][0] if len(self._base) else 0,
            self._base,
            self._reach,
            self._encoding,
            *parameters_of(absorbed(self._network)),
        )
        return partial(decide, reference(law))
