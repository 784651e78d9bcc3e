"""Least squares of a network's parameters: errors, Gauss-Newton terms and damped steps.

A step of Levenberg and Marquardt is (J^T J + mu I)^-1 J^T e, with the Jacobian J of the errors e
by the parameters. With more parameters than errors the same step is J^T (J J^T + mu I)^-1 e. For
that J is never formed: within a layer, the derivatives of an output by the weights are the product
of what enters the layer and of the output's slope, so that J J^T is a sum over the layers of
products of two small Gram matrices, and J^T v is one backpropagation of v.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from softrobot_env.core.continuation import Damping
from softrobot_env.learned.network import Dataset, Network

#: How the damping mu of a training changes.
RULE = Damping(most=1e10)

_CHUNK = 1000  # samples whose Jacobian is held at once


class Linearization(NamedTuple):
    """The errors near some parameters.

    Attributes:
        slope: J^T e (n,).
        step: From a damping to (J^T J + damping I)^-1 J^T e (n,); LinAlgError if that matrix is not
            definite.
    """

    slope: np.ndarray
    step: Callable[[float], np.ndarray]


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

    def squared_error(self, parameters: np.ndarray) -> float:
        """Sum of the squared errors at parameters (n,)."""
        values = self._network.with_parameters(parameters).activations(self._inputs)
        return float(np.sum((values[-1] - self._outputs) ** 2))

    def gauss_newton(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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

    def linearize(self, parameters: np.ndarray) -> Linearization:
        """The errors near parameters (n,), in whichever form has the smaller matrix."""
        if len(parameters) <= self.errors:
            slope, square = self.gauss_newton(parameters)
            return Linearization(
                slope, lambda damping: cho_solve(cho_factor(damped(square, damping)), slope)
            )
        return self.linearize_dual(parameters)

    def linearize_dual(self, parameters: np.ndarray) -> Linearization:
        """As `linearize`, by the matrix J J^T (k n_out, k n_out)."""
        network = self._network.with_parameters(parameters)
        values = network.activations(self._inputs)
        error, square = values[-1] - self._outputs, gram(network, values)

        def step(damping: float) -> np.ndarray:
            factor = cho_factor(damped(square, damping), overwrite_a=True)
            weight = cho_solve(factor, error.ravel())
            return backpropagate(network, values, weight.reshape(error.shape))

        return Linearization(backpropagate(network, values, error), step)


def damped(matrix: np.ndarray, damping: float) -> np.ndarray:
    """A copy with damping added to its diagonal."""
    out = matrix.copy()
    out.flat[:: len(matrix) + 1] += damping
    return out


def backpropagate(network: Network, values: list[np.ndarray], weight: np.ndarray) -> np.ndarray:
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


def gram(network: Network, values: list[np.ndarray]) -> np.ndarray:
    """J J^T (k n_out, k n_out), rows by samples, then outputs; arguments as `backpropagate`."""
    samples, outputs = values[-1].shape
    total = np.zeros((samples, outputs, samples, outputs))
    for below, slope in network.slopes(values):
        flat = np.ascontiguousarray(slope).reshape(samples * outputs, -1)
        part = (flat @ flat.T).reshape(total.shape)
        part *= (below @ below.T + 1)[:, None, :, None]
        total += part
    return total.reshape(samples * outputs, -1)
