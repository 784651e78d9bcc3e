"""What an equilibrium is: its error, its stability and its load steps, alike for every model.

Beam models and compiled scenes find their equilibria in ways of their own and judge them here.
"""

from numbers import Integral

import numpy as np
from numpy import ndarray
from numpy.linalg import LinAlgError, cholesky, eigvals, solve

#: Kinds of stability that can be asked for.
STABILITY = ("static", "dynamic")

#: Imaginary part of an eigenvalue, as a share of its size, that may be rounding error.
_REAL = 1e-6
#: Growth, as a share of the fastest rate, that may be rounding error.
_GROWTH = 1e-7


class EquilibriumError(RuntimeError):
    """No static equilibrium was found, or only an unstable one."""


def stability_asked(check: bool | str) -> str | None:
    """The kind of stability that `check_stability` asks for: of `STABILITY`, or None.

    True means "static".

    Raises:
        ValueError: Neither a truth value nor one of these words.
    """
    if isinstance(check, bool | np.bool_):
        return "static" if check else None
    if check not in STABILITY:
        words = ", ".join(repr(word) for word in STABILITY)
        raise ValueError(f"check_stability must be True, False, {words}, got {check!r}")
    return check


def checked_load_steps(load_steps: int) -> int:
    """The least number of equal steps in which loads and gravity grow from zero.

    Raises:
        ValueError: No whole number, or less than one.
    """
    if not (isinstance(load_steps, Integral) and load_steps >= 1):
        raise ValueError(f"load_steps must be a whole number, at least one, got {load_steps!r}")
    return int(load_steps)


def require_stable(
    kind: str, stiffness: ndarray, mass: ndarray, damping: ndarray | None = None
) -> None:
    """Refuse an equilibrium of M x'' + D x' + K x = 0 that the robot would leave by itself.

    Statically stable is what loads at rest can give: no deviation grows without swinging, so
    M s^2 + K has no positive root. Where forces have a potential, it is then a minimum. Forces
    without one (follower loads, moments of fixed direction) may still make the robot swing up:
    that is flutter, which depends on mass and damping. Only "dynamic" refuses it.

    Args:
        kind: Of `STABILITY`.
        stiffness, mass, damping: K, M and D (n, n) in independent coordinates; K may be
            unsymmetric. The damping is needed for "dynamic".

    Raises:
        EquilibriumError: The equilibrium is unstable; the message names the switch.
    """
    growth = static_growth(stiffness, mass)
    if growth is not None:
        raise EquilibriumError(
            "the equilibrium is unstable: the loads drive deviations on, which grow by "
            f"exp({growth:.3g} t) without damping; check_stability=False returns it all the same"
        )
    if kind == "dynamic":
        growth = flutter_growth(stiffness, mass, damping)
        if growth is not None:
            raise EquilibriumError(
                f"the equilibrium flutters: deviations swing and grow by exp({growth:.3g} t); "
                "check_stability='static' accepts it"
            )


def static_growth(stiffness: ndarray, mass: ndarray) -> float | None:
    """Fastest rate [1/s] at which an undamped deviation grows without swinging, None if none does.

    Args:
        stiffness, mass: As in `require_stable`.
    """
    if positive_definite(stiffness):
        return None
    try:
        # The eigenvalues 1 / w^2 of K^-1 M, not those of M^-1 K: soft modes are then exact.
        squares = -eigvals(solve(stiffness, mass))
    except LinAlgError:
        return 0.0  # a deviation that nothing opposes
    growing = (squares.real > 0) & (np.abs(squares.imag) <= _REAL * np.abs(squares))
    return float(1 / np.sqrt(squares.real[growing].min())) if growing.any() else None


def positive_definite(stiffness: ndarray) -> bool:
    """Whether every deviation (n,) is opposed: then no eigenvalue is real and negative."""
    try:
        cholesky((stiffness + stiffness.T) / 2)
    except LinAlgError:
        return False
    return True


def flutter_growth(stiffness: ndarray, mass: ndarray, damping: ndarray) -> float | None:
    """Fastest rate [1/s] at which a damped deviation grows, None if all of them die away.

    Args:
        stiffness, mass, damping: As in `require_stable`.
    """
    n = len(mass)
    solved = solve(mass, np.hstack([stiffness, damping]))
    first_order = np.block([[np.zeros((n, n)), np.eye(n)], [-solved[:, :n], -solved[:, n:]]])
    growth = float(np.max(eigvals(first_order).real))
    # Rounding scatters the poles.
    fastest = float(np.sqrt(np.max(np.abs(eigvals(solved[:, :n])))))
    return growth if growth > _GROWTH * fastest else None
