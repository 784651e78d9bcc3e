"""Equilibria of rods by shooting: integrals along a rod, and what is unknown at its ends."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.optimize import root

from softrobot_env.core.equilibrium import EquilibriumError

_RTOL, _ATOL = 1e-11, 1e-13


def integral(
    slope: Callable[[float, ndarray], ndarray],
    span: tuple[float, float],
    start: ndarray,
    stations: ndarray | None = None,
) -> ndarray:
    """States (n, k) of an initial-value problem at stations (k,); without them (n,) at the end."""
    found = solve_ivp(slope, span, start, "DOP853", stations, rtol=_RTOL, atol=_ATOL).y
    return found[:, -1] if stations is None else found


def grown(
    missing: Callable[[ndarray, float], ndarray],
    guess: ndarray,
    what: str,
    steps: int = 4,
    most: float = 1e-9,
    **options: Any,
) -> ndarray:
    """Unknowns (n,) for which nothing is missing under the full load.

    The load is raised in equal steps, so that the solution connected to the guess is found.

    Args:
        missing: From unknowns (n,) and the share of the load [1] to what is missing (n,).
        guess: (n,), without load.
        what: That is in equilibrium, for people.
        steps: Of the load.
        most: What may be missing.
        **options: Of `scipy.optimize.root`.

    Raises:
        EquilibriumError: No solution was found.
    """
    unknown = guess
    for share in np.arange(1, steps + 1) / steps:
        found = root(missing, unknown, (share,), **{"tol": 1e-12} | options)
        unknown = found.x
    if not np.abs(found.fun).max() <= most:
        raise EquilibriumError(f"no equilibrium of {what}: {found.message}")
    return unknown
