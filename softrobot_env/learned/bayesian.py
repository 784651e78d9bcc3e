"""Levenberg-Marquardt training with Bayesian regularisation.

MacKay, Neural Computation 4 (1992) 415-447, with the Gauss-Newton approximation and the updates of
Foresee and Hagan, ICNN 1997, 1930-1935, as in MATLAB's `trainbr` (thesis sec. 6.3.1).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from softrobot_env.core.continuation import descend
from softrobot_env.learned.levenberg_marquardt import RULE, LeastSquares, damped
from softrobot_env.learned.network import Dataset, Network

_DAMPING_START = 5e-3
_GAIN_TOLERANCE = 1e-7  # relative decrease of the cost over `_PATIENCE` iterations
_PATIENCE = 10

#: Called after each step with its number, their largest number, and E_D.
Progress = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Fit:
    """Outcome of `train`; errors and parameters in scaled quantities.

    Attributes:
        network: The trained network.
        alpha, beta: Weights of E_W and E_D in the cost; 1 / (2 beta) estimates the variance of
            the noise on the scaled outputs.
        effective_parameters: gamma [1], parameters that the data determine.
        squared_error: E_D [1], sum over samples and outputs.
        iterations: Number of steps done.
        converged: Whether it stopped by itself, not at the largest number of iterations.
    """

    network: Network
    alpha: float
    beta: float
    effective_parameters: float
    squared_error: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class _Point:
    """Parameters (n,) with their E_D and E_W, and the weights alpha and beta of these."""

    parameters: np.ndarray
    data_error: float
    size: float
    alpha: float
    beta: float

    @property
    def cost(self) -> float:
        return self.beta * self.data_error + self.alpha * self.size


def _point(problem: LeastSquares, parameters: np.ndarray, alpha: float, beta: float) -> _Point:
    """The cost's parts at parameters (n,)."""
    error = problem.squared_error(parameters)
    return _Point(parameters, error, float(parameters @ parameters), alpha, beta)


def train(
    network: Network,
    samples: Dataset,
    iterations: int = 200,
    progress: Progress | None = None,
) -> Fit:
    """Minimise F = beta E_D + alpha E_W, re-estimating alpha and beta after every step.

    E_D is the sum of squared errors of the scaled outputs, E_W that of the parameters. With the
    number gamma = n - alpha tr((beta J^T J + alpha I)^-1) of effective parameters,
    alpha = gamma / (2 E_W) and beta = (N - gamma) / (2 E_D) for N errors maximise the evidence.

    Args:
        network: Where to start; its scaling is kept.
        samples: Data that are fitted.
        iterations: Largest number of steps.
        progress: Called after every step.

    Raises:
        ValueError: Data that are not finite, or of shapes that do not fit the network.
    """
    problem = LeastSquares(network, samples)
    if problem.errors <= len(network.parameters):
        raise ValueError(
            f"{problem.errors} errors cannot determine {len(network.parameters)} parameters and "
            "their noise; give more samples than that"
        )
    # As trainbr begins: all parameters are taken as effective.
    start = _point(problem, network.parameters, 0.0, 1.0)
    point = _reweigh(start, float(len(start.parameters)), problem.errors)
    gamma, damping, done, converged = float(len(start.parameters)), _DAMPING_START, 0, False
    costs: list[float] = []
    while done < iterations and not converged:
        slope, square = problem.gauss_newton(point.parameters)
        step = partial(_stepped, problem, point, slope, square)
        moved, damping = descend(point, step, damping, RULE)
        if moved is None:
            converged = True
            break
        gamma = _effective(square, point)
        decrease = point.cost - moved.cost
        costs.append(decrease / abs(point.cost))
        point, done = _reweigh(moved, gamma, problem.errors), done + 1
        converged = len(costs) >= _PATIENCE and sum(costs[-_PATIENCE:]) < _GAIN_TOLERANCE
        if progress is not None:
            progress(done, iterations, point.data_error)
    trained = network.with_parameters(point.parameters)
    return Fit(trained, point.alpha, point.beta, gamma, point.data_error, done, converged)


def _stepped(
    problem: LeastSquares, point: _Point, slope: np.ndarray, square: np.ndarray, damping: float
) -> _Point:
    """Where a damped step leads."""
    gradient = point.beta * slope + point.alpha * point.parameters
    hessian = damped(point.beta * square, point.alpha + damping)
    way = cho_solve(cho_factor(hessian), gradient)
    return _point(problem, point.parameters - way, point.alpha, point.beta)


def _reweigh(point: _Point, gamma: float, errors: int) -> _Point:
    """The same parameters with alpha and beta of the largest evidence for a given gamma."""
    alpha = gamma / (2 * point.size) if point.size > 0 else 1.0
    beta = (errors - gamma) / (2 * point.data_error) if point.data_error > 0 else 1.0
    return replace(point, alpha=alpha, beta=beta)


def _effective(square: np.ndarray, point: _Point) -> float:
    """Number gamma of effective parameters."""
    n = len(square)
    inverse = cho_solve(cho_factor(point.beta * square + point.alpha * np.eye(n)), np.eye(n))
    return n - point.alpha * float(np.trace(inverse))
