"""What kernels of control laws share: finite observations, limits of inputs, the action kept."""

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel


@kernel
def finite(values: np.ndarray) -> bool:
    """Whether all values (k,) are finite."""
    for value in values:  # noqa: SIM110  (a loop is what compiles well)
        if not np.isfinite(value):
            return False
    return True


@kernel
def kept(previous: np.ndarray) -> np.ndarray:
    """Action (n_inputs,) for want of a better one: the previous, zero where that is no number."""
    action = np.zeros(len(previous))
    for j in range(len(previous)):
        if np.isfinite(previous[j]):
            action[j] = min(max(previous[j], -1.0), 1.0)
    return action


@kernel
def excess(inputs: np.ndarray, limit: np.ndarray) -> float:
    """Sum of how far inputs (n_inputs,) lie beyond their limits, relative to these."""
    total = 0.0
    for j in range(len(inputs)):
        total += max(abs(inputs[j]) / limit[j] - 1, 0.0)
    return total


@kernel
def limited(inputs: np.ndarray, limit: np.ndarray, action: np.ndarray) -> bool:
    """Set an action (n_inputs,) in [-1, 1] from inputs and limits (n_inputs,) [N].

    Returns:
        Whether an input had to be limited.
    """
    saturated = False
    for j in range(len(inputs)):
        wanted = inputs[j] / limit[j]
        action[j] = min(max(wanted, -1.0), 1.0)
        saturated |= action[j] != wanted
    return saturated
