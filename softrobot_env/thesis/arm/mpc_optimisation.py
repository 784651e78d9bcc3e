"""Sequential quadratic programming over a horizon of the planar arm."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from softrobot_env.control.linear_quadratic import BoundedSolver
from softrobot_env.thesis.arm.mpc_prediction import evaluate
from softrobot_env.thesis.arm.mpc_settings import MPCSettings

#: Share of the decrease that the model promises which a step must bring, and halvings for it.
_ARMIJO = 1e-4
_HALVINGS = 10

#: Promised decrease relative to the cost that drowns in rounding errors.
_ROUNDING = 1e-11


class Problem(NamedTuple):
    """What is given at a decision; shapes and units as in `prediction.evaluate`."""

    arm: Any
    start: np.ndarray
    force: np.ndarray
    before: np.ndarray
    reference: np.ndarray


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

    inputs: np.ndarray
    guess: np.ndarray
    path: np.ndarray
    cost: float
    gradient: np.ndarray
    hessian: np.ndarray


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

    def __init__(self, settings: MPCSettings, limit: np.ndarray) -> None:
        """Raise ImportError without the solver's package."""
        self._settings, self._horizon = settings, settings.horizon()
        self._limit = np.tile(limit, len(settings.moves))
        self._solve = BoundedSolver()

    def evaluate(
        self, problem: Problem, inputs: np.ndarray, guess: np.ndarray, differentiate: bool = True
    ) -> Iterate:
        """Predict and, if wanted, differentiate; the arguments stay as they are."""
        path = np.empty((len(guess), 2, problem.arm.n))
        count = inputs.size if differentiate else 0
        gradient, hessian = np.empty(count), np.empty((count, count))
        guess = guess.copy()
        cost = evaluate(self._horizon, *problem, inputs, guess, path, gradient, hessian)
        return Iterate(inputs, guess, path, cost, gradient, hessian)

    def minimise(self, problem: Problem, inputs: np.ndarray, guess: np.ndarray) -> Optimum:
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

    def _step(self, now: Iterate) -> np.ndarray | None:
        """Minimum (c, n_inputs) of the Gauss-Newton model, or None."""
        inputs = now.inputs.ravel()
        bounds = -self._limit - inputs, self._limit - inputs
        step = self._solve(now.hessian, now.gradient, *bounds)
        return None if step is None else step.reshape(now.inputs.shape)

    def _search(
        self, problem: Problem, now: Iterate, step: np.ndarray, differentiate: bool
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
