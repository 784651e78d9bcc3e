"""Quadratic programs with bounds, by the dual active-set solver DAQP (Arnstroem et al. 2022)."""

from collections.abc import Callable

import numpy as np

#: Minimum of 1/2 x H x + g x within bounds, from (H, g, lower, upper); None if none was found.
BoundedSolver = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]

_OPTIMAL = 1
_TOLERANCE = 1e-9  # on the constraints, in the unit of x


def make_bounded_solver() -> BoundedSolver:
    """Solver of strictly convex programs with finite bounds.

    Raises:
        ImportError: DAQP is not installed.
    """
    try:
        import daqp
    except ImportError as reason:
        raise ImportError(
            'model predictive control needs the package daqp: pip install "softrobot_env[mpc]"'
        ) from reason

    def solve(
        hessian: np.ndarray, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> np.ndarray | None:
        rows = np.empty((0, len(gradient)))
        x, _, flag, _ = daqp.solve(hessian, gradient, rows, upper, lower, primal_tol=_TOLERANCE)
        if flag != _OPTIMAL or not np.all(np.isfinite(x)):
            return None
        return np.clip(x, lower, upper)

    return solve
