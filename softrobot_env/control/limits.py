"""Shared by kernels of control laws: the check for finite observations, and the action to keep."""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel


@kernel
def finite(values: ndarray) -> bool:
    """Whether all values (k,) are finite."""
    for value in values:  # noqa: SIM110  (a loop compiles well)
        if not np.isfinite(value):
            return False
    return True


@kernel
def kept(previous: ndarray) -> ndarray:
    """The fallback action (n_inputs,): the previous one, with zeros where that is not finite."""
    action = np.zeros(len(previous))
    for j in range(len(previous)):
        if np.isfinite(previous[j]):
            action[j] = min(max(previous[j], -1.0), 1.0)
    return action
