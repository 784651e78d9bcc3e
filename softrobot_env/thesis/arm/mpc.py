"""Model predictive control of the tip, thesis sec. 6.5: sequential quadratic programming."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams import planar_arm
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.compile.kernels import reference
from softrobot_env.control import base
from softrobot_env.control.linear_quadratic import BoundedSolver
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

from ..robots import ARM
from .estimation import update_estimate
from .mpc_prediction import Horizon, evaluate
from .mpc_settings import GAMMA, THESIS, MPCSettings

#: Share of the decrease that the model promises which a step must bring, and halvings for it.
_ARMIJO = 1e-4
_HALVINGS = 10

#: Promised decrease relative to the cost that drowns in rounding errors.
_ROUNDING = 1e-11


class Problem(NamedTuple):
    """What is given at a decision; shapes and units as in `prediction.evaluate`."""

    arm: Any
    start: ndarray
    force: ndarray
    before: ndarray
    reference: ndarray


@dataclass(frozen=True)
class Iterate:
    """Inputs over the horizon and what they cause.

    Attributes:
        inputs: (c, n_inputs) [N].
        guess: (p, stages, n) [1/(m s2)], the accelerations.
        path: (p, 2, n), states at the ends of the steps.
        cost: [1]; infinite if the prediction failed.
        gradient: (c n_inputs,) [1/N]; empty if not wanted.
        hessian: (c n_inputs, c n_inputs) [1/N2], of the Gauss-Newton model; empty likewise.
    """

    inputs: ndarray
    guess: ndarray
    path: ndarray
    cost: float
    gradient: ndarray
    hessian: ndarray


class Optimum(NamedTuple):
    """Result of an optimisation.

    Attributes:
        last: The best inputs found.
        costs: Cost [1] before the first and after each of the quadratic programs.
        failure: Why the inputs are no optimum, or None.
    """

    last: Iterate
    costs: tuple[float, ...]
    failure: str | None


class Optimiser:
    """Minimises the cost over inputs within +-limit (n_inputs,) [N]."""

    def __init__(self, settings: MPCSettings, limit: ndarray) -> None:
        """Raise ImportError without the solver's package."""
        self._settings, steps = settings, np.array(settings.steps)
        share = steps / steps[0]
        weights = settings.error * share, settings.rate * share, settings.effort * share
        change, gamma = np.full(len(steps), settings.change), GAMMA[settings.integrator]
        self._horizon = reference(Horizon(steps, settings.block, gamma, *weights, change))
        self._limit = np.tile(limit, len(settings.moves))
        self._solve = BoundedSolver()

    def evaluate(
        self, problem: Problem, inputs: ndarray, guess: ndarray, differentiate: bool = True
    ) -> Iterate:
        """Predict and, if wanted, differentiate; the arguments stay as they are."""
        path = np.empty((len(guess), 2, problem.arm.n))
        count = inputs.size if differentiate else 0
        gradient, hessian = np.empty(count), np.empty((count, count))
        guess = guess.copy()
        cost = evaluate(self._horizon, *problem, inputs, guess, path, gradient, hessian)
        return Iterate(inputs, guess, path, cost, gradient, hessian)

    def minimise(self, problem: Problem, inputs: ndarray, guess: ndarray) -> Optimum:
        """Improve on inputs (c, n_inputs) [N] until they change no more.

        Args:
            problem: What is given.
            inputs: Where to begin.
            guess: (p, stages, n), guess of the accelerations.
        """
        now = self.evaluate(problem, inputs, guess)
        if not now.cost < np.inf:
            return Optimum(now, (now.cost,), "prediction failed")
        costs, tolerance = [now.cost], self._settings.tolerance
        for left in reversed(range(self._settings.iterations)):
            step = self._step(now)
            if step is None:
                return Optimum(now, tuple(costs), "quadratic program not solved")
            after = self._search(problem, now, step, left > 0)
            if after is None:
                return Optimum(now, tuple(costs), "no lower cost along the step")
            now, stays = after, after is now
            costs.append(now.cost)
            if stays or (tolerance is not None and np.max(np.abs(step)) <= tolerance):
                return Optimum(now, tuple(costs), None)
        failure = None if tolerance is None else f"not converged in {len(costs) - 1} iterations"
        return Optimum(now, tuple(costs), failure)

    def _step(self, now: Iterate) -> ndarray | None:
        """Minimum (c, n_inputs) of the Gauss-Newton model, or None."""
        inputs = now.inputs.ravel()
        bounds = -self._limit - inputs, self._limit - inputs
        step = self._solve(now.hessian, now.gradient, *bounds)
        return None if step is None else step.reshape(now.inputs.shape)

    def _search(
        self, problem: Problem, now: Iterate, step: ndarray, differentiate: bool
    ) -> Iterate | None:
        """First of ever shorter steps that lowers the cost; None if there is none."""
        slope = float(now.gradient @ step.ravel())
        if -slope <= _ROUNDING * now.cost:  # as good as the optimum
            return now
        for halving in range(_HALVINGS):
            share = 0.5**halving
            inputs = now.inputs + share * step
            after = self.evaluate(problem, inputs, now.guess, differentiate)
            if after.cost <= now.cost + _ARMIJO * share * slope:
                return after
        return None


#: Part of the limit from which an input counts as saturated.
_FULL = 1 - 1e-9


@dataclass(frozen=True)
class Estimate:
    """Deviation of the robot from its model, see `estimation.update_estimate`.

    Attributes:
        stiffness: Factor [1] on the nominal stiffness.
        force: (n,) [N m2] on the curvatures.
        information: (2,) [s], see `estimation.update_estimate`.
    """

    stiffness: float
    force: ndarray
    information: ndarray


@dataclass(frozen=True)
class MPCState:
    """What the next decision needs.

    Attributes:
        action: (n_inputs,) [1], the last one that was determined.
        plan: The last optimum; None to begin anew from the inputs in force.
        seen: (2, n), curvatures and rates at the last decision; None before the first one.
        estimate: What the model leaves unexplained.
        status: Why the action is not the one wanted, or None.
    """

    action: ndarray
    plan: Iterate | None
    seen: ndarray | None
    estimate: Estimate
    status: str | None


class MPC(base.Controller):
    """Optimises the inputs over a horizon and applies the first of them.

    Predicts with the planar constant-curvature arm from the full state and resolves the
    redundancy of the inputs by their cost. Where the optimisation fails the last action that was
    determined is kept, and the next one begins anew; the state's `status` says why.
    """

    def __init__(
        self, robot: RobotParams, control_period: float, settings: MPCSettings = THESIS
    ) -> None:
        """Prepare for a robot.

        Args:
            robot: The nominal robot.
            control_period: [s] between calls of `predict`.
            settings: Horizon, cost and optimisation, as of the arm.

        Raises:
            ValueError: A robot that is no planar arm, or a control period that does not divide
                the settings' period.
            ImportError: The solver of the quadratic programs is not installed.
        """
        self.hold = base.hold_for(settings.period, control_period, "model predictive control")
        self.requires = _required(settings)
        sizes = base.state_sizes(robot)
        self.sizes = {name: size for name, size in sizes.items() if name in self.requires}
        if settings.preview:
            self.preview = settings.times
            self.sizes["reference_preview"] = 2 * len(settings.times)
        self._reach = robot.length
        settings = _scaled(settings, robot)
        self._settings, self._arm = settings, make_planar_arm(robot)
        self._limit = TendonMap(robot).input_scale
        self._optimiser = Optimiser(settings, self._limit)
        self._no_guess, self._shift = settings.no_guess(self._arm.n), settings.shift

    def start(self, observation: Observation) -> MPCState:
        """Begin from the action in force."""
        action = base.usable(observation["previous_action"])
        estimate = Estimate(1.0, np.zeros(self._arm.n), np.zeros(2))
        return MPCState(action, None, None, estimate, None)

    def act(self, observation: Observation, state: MPCState) -> tuple[ndarray, MPCState]:
        """First input of the optimum, or the last action that was determined."""
        for name in self.requires:
            if not np.all(np.isfinite(observation[name])):
                status = f"{base.REASONS[base.NOT_FINITE]}: {name}"
                return state.action, replace(state, plan=None, seen=None, status=status)
        seen = np.stack([observation["curvature"], observation["curvature_rate"]])
        before = self._limit * observation["previous_action"]
        estimate = self._estimate(seen, before, state)
        arm = self._arm._replace(stiffness=estimate.stiffness * self._arm.stiffness)
        problem = Problem(arm, seen, estimate.force, before, self._reference(observation))
        optimum = self._optimiser.minimise(problem, *self._beginning(before, state))
        now = MPCState(state.action, None, seen, estimate, None)
        if np.hypot(*observation["reference"]) > self._reach:
            now = replace(now, status=base.REASONS[base.UNREACHABLE])
        if optimum.failure is not None:
            reasons = filter(None, (now.status, f"last action kept: {optimum.failure}"))
            return now.action, replace(now, status="; ".join(reasons))
        return self._apply(optimum.last, now)

    def _apply(self, optimum: Iterate, state: MPCState) -> tuple[ndarray, MPCState]:
        action = np.clip(optimum.inputs[0] / self._limit, -1.0, 1.0)
        status = base.REASONS[base.SATURATED] if np.any(np.abs(action) >= _FULL) else state.status
        return action, replace(state, action=action, plan=optimum, status=status)

    def _beginning(self, before: ndarray, state: MPCState) -> tuple[ndarray, ndarray]:
        """Inputs and accelerations to begin from: the last plan, one period on."""
        if state.plan is None:
            return np.tile(before, (len(self._shift), 1)), self._no_guess
        return state.plan.inputs[self._shift], state.plan.guess

    def _reference(self, observation: Observation) -> ndarray:
        """(p + 1, 2) [m], now and at the ends of the steps, less the tip's offset."""
        now = observation["reference"]
        points = np.tile(now, (len(self._settings.steps) + 1, 1))
        if self._settings.preview:
            points[1:] = observation["reference_preview"].reshape(-1, 2)
        return points - self._offset(observation) if self._settings.estimate else points

    def _offset(self, observation: Observation) -> ndarray:
        """Tip (2,) [m] as measured, less that of the measured curvatures."""
        tip, jacobian = np.empty(2), np.empty((2, self._arm.n))
        curvature = np.ascontiguousarray(observation["curvature"])
        planar_arm.tip(self._arm, curvature, tip, jacobian)
        return observation["tip_position"] - tip

    def _estimate(self, seen: ndarray, before: ndarray, state: MPCState) -> Estimate:
        """Estimate after another period with inputs `before` (n_inputs,) [N].

        Observations that are absurd, though finite, leave it as it was.
        """
        if not self._settings.estimate or state.seen is None:
            return state.estimate
        force, information = state.estimate.force.copy(), state.estimate.information.copy()
        stiffness = update_estimate(
            self._arm,
            self._settings.period,
            *state.seen,
            *seen,
            before,
            self._limit,
            True,
            information,
            force,
        )
        if not np.isfinite(stiffness + force.sum() + information.sum()):
            return state.estimate
        return Estimate(stiffness, force, information)


def _scaled(settings: MPCSettings, robot: RobotParams) -> MPCSettings:
    """Settings whose inputs [1/N2] weigh as much as the arm's that move its tip as far."""
    share = (_tip_by_input(robot) / _tip_by_input(ARM)) ** 2
    return replace(settings, effort=share * settings.effort, change=share * settings.change)


def _tip_by_input(robot: RobotParams) -> float:
    """Twice the motion [m/N] of the tip of a straight arm by an input that bends all of it."""
    return robot.length**2 * abs(robot.tendons[0].offset[0]) / robot.bending_stiffness


def _required(settings: MPCSettings) -> tuple[str, ...]:
    names = ["curvature", "curvature_rate", "reference", "previous_action"]
    names += ["reference_preview"] if settings.preview else []
    names += ["tip_position"] if settings.estimate else []
    return tuple(names)
