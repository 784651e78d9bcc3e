"""Parts of linear-quadratic laws: discretisation, gains, interpolation, quadratic programs.

Quadratic programs are solved by the dual active-set solver DAQP (Arnstroem et al. 2022).
"""

import numpy as np
from numpy import ndarray
from scipy.linalg import expm, solve_continuous_are

from softrobot_env.core.extras import install_command

#: DAQP's flag of an optimum, and its tolerance [1] on the bounds.
_OPTIMAL, _TOLERANCE = 1, 1e-9


def discretized(a: ndarray, b: ndarray, period: float) -> tuple[ndarray, ndarray]:
    """Exact A (n, n) and B (n, m) over a period [s] with constant inputs."""
    n, m = b.shape
    both = expm(period * np.block([[a, b], [np.zeros((m, n + m))]]))
    return both[:n, :n], both[:n, n:]


def integral_gains(
    system: tuple[ndarray, ndarray],
    outputs: ndarray,
    input_weight: float,
    error_weight: float = 1.0,
    leak: float = 0.0,
) -> ndarray:
    """Gains [K, K_i] (m, n + k) of an LQI regulator: the integrals e. = C x are states.

    They minimise int (error_weight |e|^2 + input_weight |u|^2) dt.

    Args:
        system: A (n, n) and B (n, m) of x. = A x + B u.
        outputs: C (k, n).
        input_weight, error_weight: Weights.
        leak: [1/s], decay of the integrals in the design.
    """
    (a, b), (k, n) = system, outputs.shape
    m = b.shape[1]
    a = np.block([[a, np.zeros((n, k))], [outputs, -leak * np.eye(k)]])
    b = np.vstack([b, np.zeros((k, m))])
    weights = np.diag([0.0] * n + [error_weight] * k)
    riccati = solve_continuous_are(a, b, weights, input_weight * np.eye(m))
    return b.T @ riccati / input_weight


def lines(times: ndarray, knots: ndarray) -> ndarray:
    """Weights (t, k) of linear interpolation between knots (k,), at times (t,)."""
    return np.stack([np.interp(times, knots, one) for one in np.eye(len(knots))], axis=1)


def hats(steps: int, knots: tuple[float, ...], period: float) -> ndarray:
    """Weights (steps + 1, knots) with which the reference at every step follows from the knots.

    The present reference, relative to which the others are given, has no weight.
    """
    return lines(period * np.arange(steps + 1), np.concatenate(([0.0], knots)))[:, 1:]


class BoundedSolver:
    """Solver of strictly convex programs min 1/2 x H x + g x with bounds on x and on A x."""

    def __init__(self) -> None:
        """Raise ImportError if DAQP is not installed."""
        try:
            from daqp import solve
        except ImportError as reason:
            raise ImportError(
                f"model predictive control needs the package daqp: {install_command('mpc')}"
            ) from reason
        self._solve = solve

    def __call__(
        self,
        hessian: ndarray,
        gradient: ndarray,
        lower: ndarray,
        upper: ndarray,
        rows: ndarray | None = None,
    ) -> ndarray | None:
        """Minimum (k,) for H (k, k) and g (k,); None if none was found.

        Args:
            hessian, gradient: H and g.
            lower, upper: (k + r,), bounds of x and A x.
            rows: A (r, k); none unless given.
        """
        count = len(gradient)
        rows = np.empty((0, count)) if rows is None else rows
        x, _, flag, _ = self._solve(hessian, gradient, rows, upper, lower, primal_tol=_TOLERANCE)
        if flag != _OPTIMAL or not np.all(np.isfinite(x)):
            return None
        return np.clip(x, lower[:count], upper[:count])
