"""Static equilibrium of any beam model: Newton's method with load stepping."""

import numpy as np

from softrobot_env.beams.mechanics import bandwidth, iteration_matrix, residual
from softrobot_env.beams.numerics import band
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.equilibrium import EquilibriumError

_ITERATIONS = 60
_LARGEST_CHANGE = 0.5  # of a coordinate's scale in one iteration
_CONVERGED = 1e-10
_STALLED = 1e-7  # where a change that no longer shrinks is rounding error
_SMALLEST_LOAD_STEP = 1 / 256


@kernel
def newton_equilibrium(model, u, q):
    """Replace q (n,) by the equilibrium under inputs u; number of iterations, -1 if not found."""
    n, width = model.n, bandwidth(model)
    zero, change = np.zeros(n), np.empty(n)
    matrix, pivot = np.empty((n, 3 * width + 1)), np.empty(n, np.int64)
    before = np.inf
    for iteration in range(_ITERATIONS):
        iteration_matrix(model, q, zero, zero, u, 0.0, 0.0, matrix)
        residual(model, q, zero, zero, u, change)
        if not band.factor(matrix, width, pivot):
            return -1
        band.solve(matrix, width, pivot, change)
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(change[i]) / model.scale[i])
        if not np.isfinite(largest):
            return -1
        share = min(1.0, _LARGEST_CHANGE / largest) if largest > 0 else 1.0
        for i in range(n):
            q[i] -= share * change[i]
        if largest < _CONVERGED or (largest < _STALLED and largest > 0.5 * before):
            return iteration + 1
        before = largest
    return -1


def follow_loads(scaled_data, u: np.ndarray, guess: np.ndarray, first: float) -> np.ndarray:
    """Equilibrium under full loads, reached in steps that are halved where Newton fails.

    Args:
        scaled_data: Function from a factor on gravity and pretension to the model's data.
        u: (n_inputs,), scaled along.
        guess: (n,), start.
        first: First step, as a share of the loads; 1 tries them at once.

    Raises:
        ValueError: The first step is no share of the loads.
        EquilibriumError: Newton's method failed even for the smallest step.
    """
    if not 0 < first <= 1:
        raise ValueError(f"the first load step must be a share in (0, 1], got {first!r}")
    q, reached, step = guess.copy(), 0.0, first
    while reached < 1:
        share = min(1.0, reached + step)
        trial = q.copy()
        if newton_equilibrium(scaled_data(share), share * u, trial) > 0:
            q, reached = trial, share
        elif step > _SMALLEST_LOAD_STEP:
            step /= 2
        else:
            raise EquilibriumError(
                f"no equilibrium beyond {reached:.1%} of the loads: Newton's method fails for "
                f"steps of {step:.2%} of them"
            )
    return q
