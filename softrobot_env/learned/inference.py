"""Networks for real time: one sample at a time, compiled or in plain NumPy.

The scalings are absorbed by the first and the last layer, so that nothing but the layers is left.
"""

from functools import cache
from math import tanh
from typing import NoReturn

import numba
import numpy as np

from softrobot_env.learned.network import Network


def absorbed(network: Network) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights and biases of the layers between inputs and outputs that are not scaled."""
    weights = [np.array(w, dtype=float) for w in network.weights]
    biases = [np.array(b, dtype=float) for b in network.biases]
    weights[0] /= network.inputs.half
    biases[0] -= weights[0] @ network.inputs.centre
    weights[-1] *= network.outputs.half[:, None]
    biases[-1] = network.outputs.restore(biases[-1])
    return list(zip(weights, biases, strict=True))


class PlainInference:
    """A network as NumPy computes it."""

    def __init__(self, network: Network) -> None:
        *self._hidden, self._last = absorbed(network)
        self._size = network.sizes[0]

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Outputs (n_out,) for inputs (n_in,).

        Raises:
            ValueError: Inputs of another shape.
        """
        if np.shape(inputs) != (self._size,):
            _refuse(f"({self._size},)", inputs)
        for weight, bias in self._hidden:
            inputs = np.tanh(weight @ inputs + bias)
        weight, bias = self._last
        return weight @ inputs + bias


class CompiledInference:
    """A network as machine code; fastest with contiguous arrays of doubles."""

    def __init__(self, network: Network) -> None:
        """Compile, or load what an earlier process compiled."""
        layers = absorbed(network)
        self._parameters = np.concatenate([part.ravel() for pair in layers for part in pair])
        self._sizes = np.array(network.sizes, dtype=np.int64)
        self._outputs = network.sizes[-1]
        _compile()

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Outputs (n_out,) for inputs (n_in,).

        Raises:
            ValueError: Inputs of another shape.
        """
        out = np.empty(self._outputs)
        try:
            _one(inputs, self._parameters, self._sizes, out)
        except (TypeError, ValueError):  # another type of array, or another shape
            _one(self._doubles(inputs, 1), self._parameters, self._sizes, out)
        return out

    def batch(self, inputs: np.ndarray) -> np.ndarray:
        """Outputs (k, n_out) for inputs (k, n_in), one by one.

        Raises:
            ValueError: Inputs of another shape.
        """
        inputs = self._doubles(inputs, 2)
        out = np.empty((len(inputs), self._outputs))
        _many(inputs, self._parameters, self._sizes, out)
        return out

    def _doubles(self, inputs: np.ndarray, dimensions: int) -> np.ndarray:
        """A copy as the kernels take it."""
        size = self._sizes[0]
        if np.ndim(inputs) != dimensions or np.shape(inputs)[-1] != size:
            _refuse(f"({size},)" if dimensions == 1 else f"(k, {size})", inputs)
        return np.array(inputs, dtype=float, order="C")


def _refuse(wanted: str, inputs: np.ndarray) -> NoReturn:
    raise ValueError(f"the network needs inputs of shape {wanted}, got {np.shape(inputs)}")


_kernel = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})


@_kernel
def _one(inputs: np.ndarray, parameters: np.ndarray, sizes: np.ndarray, out: np.ndarray) -> None:
    """Write outputs into `out`; parameters are the weights by rows and the biases of each layer.

    An array made here and returned would cost more than all the layers.
    """
    if len(inputs) != sizes[0]:
        raise ValueError
    width, last = sizes[1:].max(), len(sizes) - 2
    scratch = np.empty((2, width))
    values, at = inputs, 0
    for layer in range(last + 1):
        below, here = sizes[layer], sizes[layer + 1]
        bias = at + below * here
        result = out if layer == last else scratch[layer % 2]
        for i in range(here):
            total = parameters[bias + i]
            for j in range(below):
                total += parameters[at + i * below + j] * values[j]
            result[i] = tanh(total) if layer < last else total
        values, at = result, bias + here


@_kernel
def _many(inputs: np.ndarray, parameters: np.ndarray, sizes: np.ndarray, out: np.ndarray) -> None:
    """Write the outputs of every row."""
    for i in range(len(inputs)):
        _one(inputs[i], parameters, sizes, out[i])


@cache
def _compile() -> None:
    """Compile for contiguous doubles and nothing else, so that no call waits for the compiler."""
    for kernel, values in ((_one, "f8[::1]"), (_many, "f8[:, ::1]")):
        kernel.compile(f"({values}, f8[::1], i8[::1], {values})")
        kernel.disable_compile()
