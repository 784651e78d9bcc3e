"""Networks without their layers' scalings, in plain NumPy where nothing compiled is loaded."""

import sys
from typing import Protocol

import numpy as np
from numpy import ndarray

from .network import Network, absorbed, refuse_inputs


def numba_is_loaded() -> bool:
    """Whether compiled code costs no import of Numba, which takes half a second, any more.

    Every simulation has loaded it: who makes the environment before the policy gets compiled
    decisions. Rarely is a policy worth the import that decides without a simulation.
    """
    return "numba" in sys.modules


def inference(network: Network) -> "Inference":
    """A network for real time: compiled where Numba is loaded, else in plain NumPy."""
    if not numba_is_loaded():
        return PlainInference(network)
    from .inference import CompiledInference

    return CompiledInference(network)


class Inference(Protocol):
    """A network for real time."""

    def __call__(self, inputs: ndarray) -> ndarray:
        """Outputs (n_out,) for inputs (n_in,)."""

    def batch(self, inputs: ndarray) -> ndarray:
        """Outputs (k, n_out) for inputs (k, n_in)."""


class PlainInference:
    """A network as NumPy computes it."""

    def __init__(self, network: Network) -> None:
        *self._hidden, self._last = absorbed(network)
        self._size = network.sizes[0]

    def __call__(self, inputs: ndarray) -> ndarray:
        """Outputs (n_out,) for inputs (n_in,).

        Raises:
            ValueError: Inputs of another shape.
        """
        if np.shape(inputs) != (self._size,):
            refuse_inputs(f"({self._size},)", inputs)
        return self._outputs(np.asarray(inputs))

    def batch(self, inputs: ndarray) -> ndarray:
        """Outputs (k, n_out) for inputs (k, n_in), all at once.

        Raises:
            ValueError: Inputs of another shape.
        """
        if np.ndim(inputs) != 2 or np.shape(inputs)[1] != self._size:
            refuse_inputs(f"(k, {self._size})", inputs)
        return self._outputs(np.asarray(inputs))

    def _outputs(self, values: ndarray) -> ndarray:
        for weight, bias in self._hidden:
            values = np.tanh(values @ weight.T + bias)
        weight, bias = self._last
        return values @ weight.T + bias
