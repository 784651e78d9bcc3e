"""Levenberg-Marquardt training with Bayesian regularisation.

MacKay, Neural Computation 4 (1992) 415-447, with the Gauss-Newton approximation and the updates of
Foresee and Hagan, ICNN 1997, 1930-1935, as in MATLAB's `trainbr` (thesis sec. 6.3.1).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from softrobot_env.learned.network import Network

_CHUNK = 1000  # samples whose Jacobian is held at once
_DAMPING_START, _DAMPING_LIMIT = 5e-3, 1e10
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


class _Problem:
    """Scaled data, and what the cost needs of them."""

    def __init__(self, network: Network, inputs: np.ndarray, outputs: np.ndarray) -> None:
        self._network = network
        self._inputs = network.inputs.scale(inputs)
        self._outputs = network.outputs.scale(outputs)
        self.errors = self._outputs.size

    def point(self, parameters: np.ndarray, alpha: float, beta: float) -> _Point:
        """The cost's parts at parameters (n,)."""
        values = self._network.with_parameters(parameters).activations(self._inputs)
        error = float(np.sum((values[-1] - self._outputs) ** 2))
        return _Point(parameters, error, float(parameters @ parameters), alpha, beta)

    def expand(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J^T e (n,) and J^T J (n, n) of the errors e and their Jacobian J."""
        network = self._network.with_parameters(parameters)
        n = len(parameters)
        slope, square = np.zeros(n), np.zeros((n, n))
        for k in range(0, len(self._inputs), _CHUNK):
            inputs = self._inputs[k : k + _CHUNK]
            error = network.activations(inputs)[-1] - self._outputs[k : k + _CHUNK]
            jacobian = network.jacobian(inputs).reshape(-1, n)
            slope += jacobian.T @ error.ravel()
            square += jacobian.T @ jacobian
        return slope, square


def train(
    network: Network,
    inputs: np.ndarray,
    outputs: np.ndarray,
    iterations: int = 200,
    progress: Progress | None = None,
) -> Fit:
    """Minimise F = beta E_D + alpha E_W, re-estimating alpha and beta after every step.

    E_D is the sum of squared errors of the scaled outputs, E_W that of the parameters. With the
    number gamma = n - alpha tr((beta J^T J + alpha I)^-1) of effective parameters,
    alpha = gamma / (2 E_W) and beta = (N - gamma) / (2 E_D) for N errors maximise the evidence.

    Args:
        network: Where to start; its scaling is kept.
        inputs: (k, n_in).
        outputs: (k, n_out).
        iterations: Largest number of steps.
        progress: Called after every step.

    Raises:
        ValueError: Data that are not finite, or of shapes that do not fit the network.
    """
    _check(network, inputs, outputs)
    problem = _Problem(network, inputs, outputs)
    # As trainbr begins: all parameters are taken as effective.
    start = problem.point(network.parameters, 0.0, 1.0)
    point = _reweigh(start, float(len(start.parameters)), problem.errors)
    gamma, damping, done, converged = float(len(start.parameters)), _DAMPING_START, 0, False
    costs: list[float] = []
    while done < iterations and not converged:
        slope, square = problem.expand(point.parameters)
        step = _descend(problem, point, slope, square, damping)
        if step is None:
            converged = True
            break
        moved, damping = step
        gamma = _effective(square, point)
        decrease = point.cost - moved.cost
        costs.append(decrease / abs(point.cost))
        point, done = _reweigh(moved, gamma, problem.errors), done + 1
        converged = len(costs) >= _PATIENCE and sum(costs[-_PATIENCE:]) < _GAIN_TOLERANCE
        if progress is not None:
            progress(done, iterations, point.data_error)
    return Fit(
        network=network.with_parameters(point.parameters),
        alpha=point.alpha,
        beta=point.beta,
        effective_parameters=gamma,
        squared_error=point.data_error,
        iterations=done,
        converged=converged,
    )


def _check(network: Network, inputs: np.ndarray, outputs: np.ndarray) -> None:
    wanted = [(len(inputs), network.sizes[0]), (len(inputs), network.sizes[-1])]
    if [inputs.shape, outputs.shape] != wanted:
        raise ValueError(
            f"training data must have shapes {wanted[0]} and {wanted[1]}, got {inputs.shape} and "
            f"{outputs.shape}"
        )
    if not (np.all(np.isfinite(inputs)) and np.all(np.isfinite(outputs))):
        raise ValueError("training data must be finite")
    if outputs.size <= len(network.parameters):
        raise ValueError(
            f"{outputs.size} errors cannot determine {len(network.parameters)} parameters and "
            "their noise; give more samples than that"
        )


def _reweigh(point: _Point, gamma: float, errors: int) -> _Point:
    """The same parameters with alpha and beta of the largest evidence for a given gamma."""
    alpha = gamma / (2 * point.size) if point.size > 0 else 1.0
    beta = (errors - gamma) / (2 * point.data_error) if point.data_error > 0 else 1.0
    return _Point(point.parameters, point.data_error, point.size, alpha, beta)


def _effective(square: np.ndarray, point: _Point) -> float:
    """Number gamma of effective parameters."""
    n = len(square)
    inverse = cho_solve(cho_factor(point.beta * square + point.alpha * np.eye(n)), np.eye(n))
    return n - point.alpha * float(np.trace(inverse))


def _descend(
    problem: _Problem, point: _Point, slope: np.ndarray, square: np.ndarray, damping: float
) -> tuple[_Point, float] | None:
    """A point of lower cost and the damping to begin with there; None if there is none."""
    gradient = point.beta * slope + point.alpha * point.parameters
    while damping <= _DAMPING_LIMIT:
        hessian = point.beta * square + (point.alpha + damping) * np.eye(len(square))
        try:
            step = cho_solve(cho_factor(hessian), gradient)
        except LinAlgError:
            damping *= 10
            continue
        trial = problem.point(point.parameters - step, point.alpha, point.beta)
        if trial.cost < point.cost:
            return trial, max(damping / 10, 1e-20)
        damping *= 10
    return None
