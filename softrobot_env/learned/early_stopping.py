"""Levenberg-Marquardt training that stops when the error on validation data rises.

Least squares as MATLAB's `trainlm` does it with its default settings (thesis sec. 3.2): Hagan and
Menhaj, IEEE Trans. Neural Networks 5 (1994) 989-993. The network kept is that of the smallest
validation error.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from softrobot_env.core.continuation import descend
from softrobot_env.learned.levenberg_marquardt import RULE, LeastSquares, Linearization
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
    cost: float
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
    problem = LeastSquares(network, training)
    watched = LeastSquares(network, validation)

    def at(parameters: np.ndarray, done: int) -> _Point:
        errors = problem.squared_error(parameters), watched.squared_error(parameters)
        return _Point(parameters, *errors, done)

    def stepped(point: _Point, near: Linearization, damping: float) -> _Point:
        return at(point.parameters - near.step(damping), point.done + 1)

    point = at(network.parameters, 0)
    best, damping, reason = point, _DAMPING_START, None
    while reason is None:
        near = problem.linearize(point.parameters)
        if 2 * np.linalg.norm(near.slope) < _GRADIENT_TOLERANCE * problem.errors:
            reason = "gradient"
            break
        moved, damping = descend(point, partial(stepped, point, near), damping, RULE)
        if moved is None:
            reason = "damping"
            break
        point = moved
        best = point if point.validation < best.validation else best
        if point.done - best.done >= _PATIENCE:
            reason = "validation"
        elif point.done >= iterations:
            reason = "iterations"
    errors = best.cost / problem.errors, best.validation / watched.errors
    return Fit(network.with_parameters(best.parameters), *errors, point.done, best.done, reason)
