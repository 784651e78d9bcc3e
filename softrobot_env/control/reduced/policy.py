"""`ssm_mpc` and `ssm_lq`: plans on a model learned from a robot's recorded motion."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import Arrays
from softrobot_env.core.interfaces import Observation
from softrobot_env.learned.reduction.model import ReducedModel
from softrobot_env.learned.reduction.polynomials import Monomials, Motion
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import read_artifact

from .. import base
from ..limits import kept
from ..linear_quadratic import BoundedSolver, lines
from .environment import ARTIFACT, SAMPLES, preview_times
from .planning import ahead, estimate, program

#: Shares of a plan's duration at which its inputs are chosen; in between they are interpolated.
_NODES = (0.0, 0.04, 0.09, 0.15, 0.22, 0.3, 0.4, 0.5, 0.62, 0.75, 1.0)

#: Share of the drives' speed reserved for inputs that the model does not contain.
_ASIDE = 0.4

#: [m2], weight of the sum of squared changes of actions in a sample.
_SMOOTHNESS = 1e-2

#: Bound on plausible observables, in SI units.
_ABSURD = 1e5


@dataclass(frozen=True)
class Learned(ReducedModel):
    """A model, with its errors and the range of its training data.

    Attributes:
        process: (n + m, n + m), covariance of its error in a sample, and of its inputs.
        noise: (n, n), covariance of states computed from outputs.
        lower, upper: (m,), range of the reduced inputs in its training data.
        farthest: [m], largest distance of training outputs from their origin.
    """

    process: ndarray
    noise: ndarray
    lower: ndarray
    upper: ndarray
    farthest: ndarray

    @classmethod
    def read(cls, data: Arrays) -> "Learned":
        """See `ReducedModel.read`."""
        model = super().read(data)
        n, m = model.dimension, model.basis.shape[1]
        shapes = {"process": (n + m, n + m), "noise": (n, n), "lower": (m,), "upper": (m,)}
        data.check_shapes(shapes | {"farthest": ()})
        return model


class _Past(NamedTuple):
    """Memory of the policy.

    Attributes:
        tips: (delays, o) [m], measured last, newest first.
        inputs: (lag + 1, m) reduced inputs, oldest first.
        x, disturbance, covariance: See `planning.estimate`.
        nodes: (c, m), the plan.
        code: Key of `REASONS`.
    """

    tips: ndarray
    inputs: ndarray
    x: ndarray
    disturbance: ndarray
    covariance: ndarray
    nodes: ndarray
    code: int

    status = base.Memory.status


class ReducedPlanner(base.Controller):
    """Plans actions on the learned model so that the tip follows its reference."""

    requires = ("tip_position", "reference", "reference_preview", "previous_action")

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        constrained: bool = True,
        weights: str | Path | None = None,
        tip_delay: float = 0.0,
        action_delay: float = 0.0,
    ) -> None:
        """Load the learned model.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls, a whole fraction of the model's period.
            constrained: Whether plans respect the limits of actions, of the drives' speed, and of
                the inputs in the training data; otherwise the first action is clipped there.
            weights: File; by default searched for, see `artifacts.find_artifact`.
            tip_delay: [s], delay of the measured tip, in training as here.
            action_delay: [s], delay of the actions that was not in the training data, a multiple of
                the model's period. The reference is shown for the time when they act.

        Raises:
            ValueError: There is no model of this robot, or the control period or delay does not fit
                it.
            FileNotFoundError: No such file.
            ImportError: The solver of constrained plans is not installed.
        """
        self._model = model = Learned.read(read_artifact(robot, ARTIFACT, weights))
        what = f"the reduced model of {robot.name!r}"
        self.hold = base.hold_for(model.period, control_period, what)
        self._late = round(tip_delay / model.period)
        steps = round(action_delay / model.period)
        if abs(steps * model.period - action_delay) > 1e-9:
            raise ValueError(
                f"action_delay: must be a multiple of {model.period:g} s, got {action_delay!r}"
            )
        self._under_way = model.lag + steps
        self.preview = preview_times(model.period, model.lag)
        o = len(model.origin)
        self.sizes = {
            "tip_position": o,
            "reference": o,
            "reference_preview": o * len(self.preview),
            "previous_action": len(model.rest),
        }
        shape = np.ascontiguousarray(model.shape[:o]), model.scale[: model.dimension]
        self._shape = Motion(*Monomials(model.shape_powers).chain, *shape, model.period, 0)
        self._places = places = np.unique(np.round(np.array(_NODES) * (SAMPLES - 1))).astype(int)
        self._weights = lines(np.arange(SAMPLES), places)
        self._shifted = lines(np.minimum(places + 1, SAMPLES - 1), places)
        self._rate = robot.drive.speed / robot_inputs(robot).input_scale * model.period
        self._solve = BoundedSolver() if constrained else None

    def start(self, observation: Observation) -> _Past:
        """Begin at rest at the measured tip, or at the model's rest if that is implausible."""
        model = self._model
        tip = np.array(observation["tip_position"], float)
        tip = tip if (np.abs(tip) < _ABSURD).all() else model.origin
        action = kept(np.array(observation["previous_action"], float))
        inputs = model.reduced_inputs(action)
        tips = np.tile(tip, (model.delays, 1))
        m, n = len(inputs), model.dimension
        covariance = np.zeros((n + m, n + m))
        covariance[:n, :n] = self._model.noise
        covariance[n:, n:] = 1e-2 * np.eye(m)
        return _Past(
            tips,
            np.tile(inputs, (self._under_way + 1, 1)),
            model.encode(tips.ravel()),
            np.zeros(m),
            covariance,
            np.tile(inputs, (len(self._places), 1)),
            0,
        )

    def act(self, observation: Observation, state: _Past) -> tuple[ndarray, _Past]:
        """The first action of the plan."""
        model = self._model
        before = np.asarray(observation["previous_action"], float)
        tip = np.asarray(observation["tip_position"], float)
        seen = np.concatenate(
            [tip, before, observation["reference"], observation["reference_preview"]]
        )
        if not (np.abs(seen) < _ABSURD).all():
            code = base.NOT_COMPUTED if np.isfinite(seen).all() else base.NOT_FINITE
            return kept(before), state._replace(code=code)
        inputs = np.vstack([state.inputs[1:], model.reduced_inputs(before)])
        tips = np.vstack([tip, state.tips[:-1]])
        x, disturbance = state.x.copy(), state.disturbance.copy()
        covariance = state.covariance.copy()
        measured = model.encode(tips.ravel())
        motion, o = model.motion, len(tip)
        estimate(
            motion, x, disturbance, covariance, state.inputs[0], measured, model.process,
            model.noise,
        )  # fmt: skip
        begin = ahead(motion, x, disturbance, inputs[1:]) if self._under_way else x
        times = np.array((0.0, *self.preview))
        shown = np.vstack(
            [observation["reference"], observation["reference_preview"].reshape(-1, o)]
        )
        wanted = (model.lag + 1 + np.arange(SAMPLES) - self._late) * model.period
        reference = np.stack([np.interp(wanted, times, column) for column in shown.T], axis=1)
        nodes, code = self._shifted @ state.nodes, 0
        aside = self._aside(before, inputs[-1])
        hessian, gradient = program(
            motion, self._shape, model.origin, begin, disturbance, self._weights, nodes, reference,
            inputs[-1], _SMOOTHNESS,
        )  # fmt: skip
        step = self._step(hessian, gradient, nodes, before, aside)
        if step is None:
            return kept(before), state._replace(
                tips=tips, inputs=inputs, x=model.encode(tips.ravel()),
                disturbance=np.zeros_like(disturbance), code=base.NOT_COMPUTED,
            )  # fmt: skip
        nodes = nodes + step
        wanted_action = model.rest + aside + model.basis @ nodes[0]
        rate = self._rate
        action = np.clip(np.clip(wanted_action, before - rate, before + rate), -1.0, 1.0)
        at_limit = (np.abs(action) > 1 - 1e-6) | (np.abs(action - before) > rate * (1 - 1e-6))
        if np.linalg.norm(reference - model.origin, axis=1).max() > model.farthest:
            code = base.UNREACHABLE
        elif np.abs(action - wanted_action).max() > 1e-6 or at_limit.any():
            code = base.SATURATED
        return action, _Past(tips, inputs, x, disturbance, covariance, nodes, code)

    def _step(
        self, hessian: ndarray, gradient: ndarray, nodes: ndarray, before: ndarray, aside: ndarray
    ) -> ndarray | None:
        """Change of the plan; None if it is not finite."""
        if not (np.isfinite(hessian).all() and np.isfinite(gradient).all()):
            return None
        hessian = hessian + 1e-9 * np.trace(hessian) / len(hessian) * np.eye(len(hessian))
        if self._solve is None:
            return np.linalg.solve(hessian, -gradient).reshape(nodes.shape)
        model, (count, _) = self._model, nodes.shape
        lower = np.minimum(model.lower - nodes, 0.0).ravel()
        upper = np.maximum(model.upper - nodes, 0.0).ravel()
        each = np.kron(np.eye(count), model.basis)
        actions = model.rest + aside + nodes @ model.basis.T
        rows, low, high = [each], [(-1 - actions).ravel()], [(1 - actions).ravel()]
        if np.isfinite(self._rate).all():
            gaps = np.diff(self._places, prepend=self._places[0] - 1)
            change = np.diff(np.vstack([before, actions]), axis=0).ravel()
            most = np.outer(gaps, self._rate).ravel()
            rows.append(np.kron(np.eye(count) - np.eye(count, k=-1), model.basis))
            low.append(-most - change)
            high.append(most - change)
        scale = np.trace(hessian) / len(hessian)
        found = self._solve(
            hessian / scale,
            gradient / scale,
            np.concatenate([lower, *low]),
            np.concatenate([upper, *high]),
            np.vstack(rows),
        )
        return None if found is None else found.reshape(nodes.shape)

    def _aside(self, before: ndarray, inputs: ndarray) -> ndarray:
        """The component of an action outside the model's inputs, decaying to zero.

        Episodes may start elsewhere than the training data: with tendons less taut, for instance.
        """
        model = self._model
        aside = before - model.rest - model.basis @ inputs
        return aside - np.clip(aside, -_ASIDE * self._rate, _ASIDE * self._rate)
