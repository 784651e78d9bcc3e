"""Levenberg-Marquardt training of networks: regularised by Bayes, or stopped by validation data.

A step of Levenberg and Marquardt is (J^T J + mu I)^-1 J^T e, with the Jacobian J of the errors e
by the parameters. With more parameters than errors the same step is J^T (J J^T + mu I)^-1 e. For
that J is never formed: within a layer, the derivatives of an output by the weights are the product
of what enters the layer and of the output's slope, so that J J^T is a sum over the layers of
products of two small Gram matrices, and J^T v is one backpropagation of v.

`train_regularised` does as MATLAB's `trainbr` (thesis sec. 6.3.1): MacKay, Neural Computation 4
(1992) 415-447, with the Gauss-Newton approximation and the updates of Foresee and Hagan, ICNN 1997,
1930-1935. `train_validated` does as `trainlm` with its default settings (thesis sec. 3.2): Hagan
and Menhaj, IEEE Trans. Neural Networks 5 (1994) 989-993; the network kept is that of the smallest
validation error.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.linalg import cho_factor, cho_solve

from softrobot_env.core.continuation import Damping, descend

from .network import Dataset, Network

#: How the damping mu of a training changes.
_RULE = Damping(most=1e10)

_CHUNK = 1000  # samples whose Jacobian is held at once


class Linearization(NamedTuple):
    """The errors near some parameters.

    Attributes:
        slope: J^T e (n,).
        step: From a damping to (J^T J + damping I)^-1 J^T e (n,); LinAlgError if that matrix is not
            definite.
    """

    slope: ndarray
    step: Callable[[float], ndarray]


class LeastSquares:
    """Errors e of a network on scaled data (k, n_in) and (k, n_out), as functions of parameters.

    Attributes:
        errors: Their number, k n_out.
    """

    def __init__(self, network: Network, data: Dataset) -> None:
        """Raise ValueError unless the data are finite and of shapes that fit the network."""
        inputs, outputs = data.inputs, data.outputs
        wanted = [(len(inputs), network.sizes[0]), (len(inputs), network.sizes[-1])]
        if [inputs.shape, outputs.shape] != wanted:
            raise ValueError(
                f"training data must have shapes {wanted[0]} and {wanted[1]}, got {inputs.shape} "
                f"and {outputs.shape}"
            )
        if not (np.all(np.isfinite(inputs)) and np.all(np.isfinite(outputs))):
            raise ValueError("training data must be finite")
        self._network = network
        self._inputs = network.inputs.scale(inputs)
        self._outputs = network.outputs.scale(outputs)
        self.errors = self._outputs.size

    def squared_error(self, parameters: ndarray) -> float:
        """Sum of the squared errors at parameters (n,)."""
        values = self._network.with_parameters(parameters).activations(self._inputs)
        return float(np.sum((values[-1] - self._outputs) ** 2))

    def gauss_newton(self, parameters: ndarray) -> tuple[ndarray, ndarray]:
        """J^T e (n,) and J^T J (n, n)."""
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

    def linearize(self, parameters: ndarray) -> Linearization:
        """The errors near parameters (n,), in whichever form has the smaller matrix."""
        if len(parameters) <= self.errors:
            slope, square = self.gauss_newton(parameters)
            return Linearization(
                slope, lambda damping: cho_solve(cho_factor(damped(square, damping)), slope)
            )
        return self.linearize_dual(parameters)

    def linearize_dual(self, parameters: ndarray) -> Linearization:
        """As `linearize`, by the matrix J J^T (k n_out, k n_out)."""
        network = self._network.with_parameters(parameters)
        values = network.activations(self._inputs)
        error, square = values[-1] - self._outputs, gram(network, values)

        def step(damping: float) -> ndarray:
            factor = cho_factor(damped(square, damping), overwrite_a=True)
            weight = cho_solve(factor, error.ravel())
            return backpropagate(network, values, weight.reshape(error.shape))

        return Linearization(backpropagate(network, values, error), step)


def damped(matrix: ndarray, damping: float) -> ndarray:
    """A copy with damping added to its diagonal."""
    out = matrix.copy()
    out.flat[:: len(matrix) + 1] += damping
    return out


def backpropagate(network: Network, values: list[ndarray], weight: ndarray) -> ndarray:
    """J^T v (n,) for v (k, n_out), with J the derivative of the scaled outputs by the parameters.

    Args:
        network: The network.
        values: Its activations.
        weight: v.
    """
    blocks = []
    for layer in reversed(range(len(network.weights))):
        below = values[layer]
        blocks += [weight.sum(axis=0), (weight.T @ below).ravel()]
        weight = (weight @ network.weights[layer]) * (1 - below**2)
    return np.concatenate(blocks[::-1])


def gram(network: Network, values: list[ndarray]) -> ndarray:
    """J J^T (k n_out, k n_out), rows by samples, then outputs; arguments as `backpropagate`."""
    samples, outputs = values[-1].shape
    total = np.zeros((samples, outputs, samples, outputs))
    for below, slope in network.slopes(values):
        flat = np.ascontiguousarray(slope).reshape(samples * outputs, -1)
        part = (flat @ flat.T).reshape(total.shape)
        part *= (below @ below.T + 1)[:, None, :, None]
        total += part
    return total.reshape(samples * outputs, -1)


# ---------------------------------------------------------------- Bayesian regularisation

_REGULARISED_START = 5e-3  # of the damping
_GAIN_TOLERANCE = 1e-7  # relative decrease of the cost over `_STALLED` iterations
_STALLED = 10

#: Called after each step with its number, their largest number, and E_D.
Progress = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Regularised:
    """Outcome of `train_regularised`; errors and parameters in scaled quantities.

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

    parameters: ndarray
    data_error: float
    size: float
    alpha: float
    beta: float

    @property
    def cost(self) -> float:
        return self.beta * self.data_error + self.alpha * self.size


def _point(problem: LeastSquares, parameters: ndarray, alpha: float, beta: float) -> _Point:
    """The cost's parts at parameters (n,)."""
    error = problem.squared_error(parameters)
    return _Point(parameters, error, float(parameters @ parameters), alpha, beta)


def train_regularised(
    network: Network, samples: Dataset, iterations: int = 200, progress: Progress | None = None
) -> Regularised:
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
    gamma, damping, done, converged = float(len(start.parameters)), _REGULARISED_START, 0, False
    costs: list[float] = []
    while done < iterations and not converged:
        slope, square = problem.gauss_newton(point.parameters)
        step = partial(_stepped, problem, point, slope, square)
        moved, damping = descend(point, step, damping, _RULE)
        if moved is None:
            converged = True
            break
        gamma = _effective(square, point)
        decrease = point.cost - moved.cost
        costs.append(decrease / abs(point.cost))
        point, done = _reweigh(moved, gamma, problem.errors), done + 1
        converged = len(costs) >= _STALLED and sum(costs[-_STALLED:]) < _GAIN_TOLERANCE
        if progress is not None:
            progress(done, iterations, point.data_error)
    trained = network.with_parameters(point.parameters)
    return Regularised(trained, point.alpha, point.beta, gamma, point.data_error, done, converged)


def _stepped(
    problem: LeastSquares, point: _Point, slope: ndarray, square: ndarray, damping: float
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


def _effective(square: ndarray, point: _Point) -> float:
    """Number gamma of effective parameters."""
    n = len(square)
    inverse = cho_solve(cho_factor(point.beta * square + point.alpha * np.eye(n)), np.eye(n))
    return n - point.alpha * float(np.trace(inverse))


# ---------------------------------------------------------------- early stopping

_VALIDATED_START = 1e-3  # of the damping
_GRADIENT_TOLERANCE = 1e-7  # of the mean squared error of the scaled outputs
_PATIENCE = 6  # steps in which the validation error may be above its least one


@dataclass(frozen=True)
class Validated:
    """Outcome of `train_validated`.

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
class _Watched:
    """Parameters (n,), sums of squared errors on both sets, and steps done."""

    parameters: ndarray
    cost: float
    validation: float
    done: int


def train_validated(
    network: Network, training: Dataset, validation: Dataset, iterations: int = 1000
) -> Validated:
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

    def at(parameters: ndarray, done: int) -> _Watched:
        errors = problem.squared_error(parameters), watched.squared_error(parameters)
        return _Watched(parameters, *errors, done)

    def stepped(point: _Watched, near: Linearization, damping: float) -> _Watched:
        return at(point.parameters - near.step(damping), point.done + 1)

    point = at(network.parameters, 0)
    best, damping, reason = point, _VALIDATED_START, None
    while reason is None:
        near = problem.linearize(point.parameters)
        if 2 * np.linalg.norm(near.slope) < _GRADIENT_TOLERANCE * problem.errors:
            reason = "gradient"
            break
        moved, damping = descend(point, partial(stepped, point, near), damping, _RULE)
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
    return Validated(
        network.with_parameters(best.parameters), *errors, point.done, best.done, reason
    )
