"""What kernels of control laws share: finite observations, and the action kept."""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel


@kernel
def finite(values: ndarray) -> bool:
    """Whether all values (k,) are finite."""
    for value in values:  # noqa: SIM110  (a loop is what compiles well)
        if not np.isfinite(value):
            return False
    return True


@kernel
def kept(previous: ndarray) -> ndarray:
    """Action (n_inputs,) for want of a better one: the previous, zero where that is no number."""
    action = np.zeros(len(previous))
    for j in range(len(previous)):
        if np.isfinite(previous[j]):
            action[j] = min(max(previous[j], -1.0), 1.0)
    return action
