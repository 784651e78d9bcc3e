"""Quadratic programs with bounds, by the dual active-set solver DAQP (Arnstroem et al. 2022)."""

import numpy as np

_OPTIMAL = 1
_TOLERANCE = 1e-9  # on the constraints, in the unit of x


class BoundedSolver:
    """Solver of strictly convex programs min 1/2 x H x + g x with finite bounds on x."""

    def __init__(self) -> None:
        """Raise ImportError if DAQP is not installed."""
        try:
            from daqp import solve
        except ImportError as reason:
            raise ImportError(
                'model predictive control needs the package daqp: pip install "softrobot_env[mpc]"'
            ) from reason
        self._solve = solve

    def __call__(
        self, hessian: np.ndarray, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> np.ndarray | None:
        """Minimum (k,) for H (k, k), g (k,) and bounds (k,); None if none was found."""
        rows = np.empty((0, len(gradient)))
        x, _, flag, _ = self._solve(hessian, gradient, rows, upper, lower, primal_tol=_TOLERANCE)
        if flag != _OPTIMAL or not np.all(np.isfinite(x)):
            return None
        return np.clip(x, lower, upper)
