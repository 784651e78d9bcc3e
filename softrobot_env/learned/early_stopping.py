"""Levenberg-Marquardt training that stops when the error on validation data rises.

Least squares as MATLAB's `trainlm` does it with its default settings (thesis sec. 3.2): Hagan and
Menhaj, IEEE Trans. Neural Networks 5 (1994) 989-993. The network kept is that of the smallest
validation error.
"""

from dataclasses import dataclass

import numpy as np

from softrobot_env.learned.levenberg_marquardt import LeastSquares, Linearization, descend
from softrobot_env.learned.network import Dataset, Network

_DAMPING_START = 1e-3
_GRADIENT_TOLERANCE = 1e-7  # of the mean squared error of the scaled outputs
_PATIENCE = 6  # steps in which the validation error may be above its least one


@dataclass(frozen=True)
class Fit:
    """Outcome of `train`.

    Attributes:
        network: The network of the least validation error.
        training_error, validation_error: Its mean squared errors [1] of a scaled output.
        iterations: Number of steps done.
        best: Number of steps after which the network was that.
        reason: Why it stopped: "validation" (its error did not fall any more), "gradient" (a
            minimum), "damping" (no step lowers the error) or "iterations" (the largest number).
    """

    network: Network
    training_error: float
    validation_error: float
    iterations: int
    best: int
    reason: str


@dataclass(frozen=True)
class _Point:
    """Parameters (n,), sums of squared errors on both sets, and steps done."""

    parameters: np.ndarray
    error: float
    validation: float
    done: int


def train(network: Network, training: Dataset, validation: Dataset, iterations: int = 1000) -> Fit:
    """Minimise the sum of squared errors of the scaled outputs on the training data.

    Args:
        network: Where to start; its scaling is kept.
        training: Data that are fitted.
        validation: Data that stop the training after six steps in a row without a new least error.
        iterations: Largest number of steps.

    Raises:
        ValueError: Data that are not finite, of shapes that do not fit the network, or none.
    """
    if not (len(training) and len(validation)):
        raise ValueError("early stopping needs at least one sample to train and one to validate")
    problem = LeastSquares(network, training.inputs, training.outputs)
    watched = LeastSquares(network, validation.inputs, validation.outputs)
    start = network.parameters
    point = _Point(start, problem.squared_error(start), watched.squared_error(start), 0)
    best, damping, reason = point, _DAMPING_START, None
    while reason is None:
        near = problem.linearize(point.parameters)
        if 2 * np.linalg.norm(near.slope) < _GRADIENT_TOLERANCE * problem.errors:
            reason = "gradient"
            break
        step = _descend(problem, point, near, damping)
        if step is None:
            reason = "damping"
            break
        error, moved, damping = step
        point = _Point(moved, error, watched.squared_error(moved), point.done + 1)
        best = point if point.validation < best.validation else best
        reason = _reason(point.done, best.done, iterations)
    return Fit(
        network=network.with_parameters(best.parameters),
        training_error=best.error / problem.errors,
        validation_error=best.validation / watched.errors,
        iterations=point.done,
        best=best.done,
        reason=reason,
    )


def _reason(done: int, best: int, iterations: int) -> str | None:
    """Why to stop now, or None."""
    if done - best >= _PATIENCE:
        return "validation"
    return "iterations" if done >= iterations else None


def _descend(
    problem: LeastSquares, point: _Point, near: Linearization, damping: float
) -> tuple[float, np.ndarray, float] | None:
    """A lower error, its parameters, and the damping to begin with there; None if there is none."""

    def attempt(damping: float) -> tuple[float, np.ndarray]:
        moved = point.parameters - near.step(damping)
        return problem.squared_error(moved), moved

    return descend(attempt, point.error, damping)
