"""Networks as machine code, for real time: `forward` for other kernels, and `CompiledInference`."""

import math
from functools import cache

import numba
import numpy as np
from numpy import ndarray

from softrobot_env.compile import OFF

from .network import Network, absorbed, refuse_inputs

_kernel = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})


def parameters_of(layers: list[tuple[ndarray, ndarray]]) -> tuple[ndarray, ndarray]:
    """What `forward` takes of some layers: all parameters in one row, and the layers' sizes.

    Of each layer come the weights of the first neuron below in all its neurons, then those of the
    second one, and last the biases: so neurons are computed side by side.
    """
    parts = [part.T.ravel() for layer in layers for part in layer]
    sizes = [layers[0][0].shape[1], *(len(bias) for _, bias in layers)]
    return np.concatenate(parts), np.array(sizes, np.int64)


class CompiledInference:
    """A network as machine code; fastest with contiguous arrays of doubles."""

    def __init__(self, network: Network) -> None:
        """Compile, or load what an earlier process compiled."""
        self._parameters, self._sizes = parameters_of(absorbed(network))
        self._outputs = network.sizes[-1]
        _compile()

    def __call__(self, inputs: ndarray) -> ndarray:
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

    def batch(self, inputs: ndarray) -> ndarray:
        """Outputs (k, n_out) for inputs (k, n_in), one by one.

        Raises:
            ValueError: Inputs of another shape.
        """
        inputs = self._doubles(inputs, 2)
        out = np.empty((len(inputs), self._outputs))
        _many(inputs, self._parameters, self._sizes, out)
        return out

    def _doubles(self, inputs: ndarray, dimensions: int) -> ndarray:
        """A copy as the kernels take it."""
        size = self._sizes[0]
        if np.ndim(inputs) != dimensions or np.shape(inputs)[-1] != size:
            refuse_inputs(f"({size},)" if dimensions == 1 else f"(k, {size})", inputs)
        return np.array(inputs, dtype=float, order="C")


# ---------------------------------------------------------------- tanh

# With t = exp(-2 |x|), tanh |x| is (1 - t) / (1 + t). -2 |x| is k log 2 + r: the series of exp r is
# as good as doubles, 2^k is made of bits. Nothing branches, so that neurons go side by side; the
# library's tanh takes four times as long.

#: 1 / log 2, and log 2 as a number of few digits, whose multiples are exact, and the rest.
_PER_LOG_2 = 1 / math.log(2)
_LOG_2, _REST = float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33")

#: Added to a number, rounds it, and puts the integer into the last bits.
_ROUND = 1.5 * 2.0**52

#: Beyond, tanh is one; a double's bits of its fraction, and zero of its exponent.
_FAR, _FRACTION, _ZERO = 20.0, 52, 1023

#: Of the series 1 + r + r^2 / 2 + ..., the highest power first.
_SERIES = tuple(1 / math.factorial(n) for n in range(13, -1, -1))


@numba.njit(inline="always", error_model="numpy", fastmath={"contract", "nsz"})
def _tanh(x):
    size = abs(x)
    if size > _FAR:  # so that what is no number stays none
        size = _FAR
    rounded = _ROUND - 2 * _PER_LOG_2 * size
    k = rounded - _ROUND
    r = (-2 * size - k * _LOG_2) - k * _REST
    series = _SERIES[0]
    for coefficient in _SERIES[1:]:
        series = series * r + coefficient
    power = (np.float64(rounded).view(np.int64) + _ZERO) << _FRACTION
    t = series * np.int64(power).view(np.float64)
    return math.copysign((1 - t) / (1 + t), x)


# ---------------------------------------------------------------- layers


@_kernel
def _layer(values, parameters, out):
    """Write what the neurons of a layer add up.

    Args:
        values: (n_below,).
        parameters: Weights and biases, see `parameters_of`.
        out: (n_here,).
    """
    below, here = len(values), len(out)
    for i in range(here):  # assigned as a whole, it would take seconds to compile
        out[i] = parameters[below * here + i]
    whole = below - below % 4
    for j in range(0, whole, 4):  # four at once read and write `out` once
        a, b, c, d = values[j], values[j + 1], values[j + 2], values[j + 3]
        rows = parameters[j * here : (j + 4) * here]
        first, second = rows[:here], rows[here : 2 * here]
        third, fourth = rows[2 * here : 3 * here], rows[3 * here :]
        for i in range(here):
            out[i] = out[i] + first[i] * a + second[i] * b + third[i] * c + fourth[i] * d
    for j in range(whole, below):
        row = parameters[j * here : (j + 1) * here]
        for i in range(here):
            out[i] += row[i] * values[j]


@_kernel
def forward(values, parameters, sizes, out):
    """Write the outputs (n_out,) of a network, see `parameters_of`, for inputs (n_in,).

    An array made here and returned would cost more than a layer.
    """
    scratch, at, last = np.empty((2, sizes[1:].max())), 0, len(sizes) - 2
    for layer in range(last + 1):
        end = at + (sizes[layer] + 1) * sizes[layer + 1]
        result = out if layer == last else scratch[layer % 2, : sizes[layer + 1]]
        _layer(values, parameters[at:end], result)
        if layer < last:
            for i in range(len(result)):
                result[i] = _tanh(result[i])
        values, at = result, end


@_kernel
def _one(inputs, parameters, sizes, out):
    if len(inputs) != sizes[0]:
        raise ValueError
    forward(inputs, parameters, sizes, out)


@_kernel
def _many(inputs, parameters, sizes, out):
    for i in range(len(inputs)):
        forward(inputs[i], parameters, sizes, out[i])


@cache
def _compile() -> None:
    """Compile for contiguous doubles and nothing else, so that no call waits for the compiler."""
    for kernel, values in () if OFF else ((_one, "f8[::1]"), (_many, "f8[:, ::1]")):
        kernel.compile(f"({values}, f8[::1], i8[::1], {values})")
        kernel.disable_compile()
