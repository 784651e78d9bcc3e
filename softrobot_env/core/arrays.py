"""Arrays of NumPy and of PyTorch alike: those of many robots live here or on a device.

A formula takes either kind. It uses what both name alike: operators, methods, and the functions of
the `namespace` of an array. What differs between them is here.
"""

import sys
from types import ModuleType
from typing import Any

import numpy as np
from numpy import ndarray


def namespace(array: Any) -> ModuleType:
    """The module whose functions take an array: `torch` for a tensor, else `numpy`."""
    if isinstance(array, ndarray):
        return np
    torch = sys.modules.get("torch")
    return torch if torch is not None and isinstance(array, torch.Tensor) else np


def like(values: ndarray, example: Any) -> Any:
    """Numbers (n, ...) as an array of the kind, and on the device, of another."""
    kind = namespace(example)
    return values if kind is np else kind.as_tensor(values, device=example.device)


def on_host(tree: Any) -> Any:
    """The same with NumPy's arrays in place of tensors; dicts and tuples are gone through."""
    if isinstance(tree, dict):
        return {name: on_host(value) for name, value in tree.items()}
    if isinstance(tree, tuple):
        return tuple(on_host(value) for value in tree)
    return tree if namespace(tree) is np else tree.detach().cpu().numpy()


class HostArrays:
    """NumPy's arrays."""

    def real(self, values: Any) -> ndarray:
        """Numbers as float64, not copied if they are."""
        return np.asarray(values, float)

    def copy(self, values: ndarray) -> ndarray:
        """A new array of float64."""
        return values.copy()

    def flags(self, mask: ndarray) -> ndarray:
        """A mask of NumPy's (n,) bool."""
        return mask

    def index(self, which: ndarray) -> ndarray:
        """Whole numbers of NumPy's (k,), to index with."""
        return which

    def rows(self, column: ndarray, at: ndarray) -> ndarray:
        """Rows (k, ...), new ones, that an `index` picks."""
        return column.take(at, axis=0)

    def host(self, values: ndarray) -> ndarray:
        """As an array of NumPy."""
        return values


class TorchArrays(HostArrays):
    """Tensors of float64 on a device of PyTorch.

    Attributes:
        device: The device.
    """

    def __init__(self, device: str) -> None:
        import torch

        self._torch, self.device = torch, torch.device(device)

    def real(self, values: Any) -> Any:
        """See `HostArrays`."""
        return self._torch.as_tensor(values, dtype=self._torch.float64, device=self.device)

    def copy(self, values: Any) -> Any:
        """See `HostArrays`."""
        return values.to(self._torch.float64, copy=True)

    def flags(self, mask: ndarray) -> Any:
        """See `HostArrays`."""
        return self._torch.as_tensor(mask, device=self.device)

    index = flags

    def rows(self, column: Any, at: Any) -> Any:
        """See `HostArrays`."""
        return column[at]

    def host(self, values: Any) -> ndarray:
        """See `HostArrays`."""
        return values.detach().cpu().numpy()


#: NumPy's.
HOST = HostArrays()
