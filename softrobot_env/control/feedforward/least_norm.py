"""Inputs of least norm that hold the tip of a robot with constant-curvature statics on a target."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics

#: Largest distance [m] from the target, and step [N] to a lesser norm left.
_REACHED, _SHORTEST = 1e-8, 1e-7
_NEWTON_ITERATIONS = 60


@dataclass(frozen=True)
class InverseStatics:
    """Outcome of `least_norm`.

    Attributes:
        reduced: (n_inputs,) [N], reduced tendon inputs.
        residual: [m], distance between the target and the tip these inputs hold.
        converged: Whether the tip is on the target at a local minimum of the tension norm.
    """

    reduced: np.ndarray
    residual: float
    converged: bool


def least_norm(
    statics: ConstantCurvatureStatics, target: np.ndarray, guess: np.ndarray
) -> InverseStatics:
    """Inputs of least norm that hold the tip on a target, near a guess.

    Minimises |u|^2 / 2 subject to tip(u) = target by a range- and null-space Newton method with
    step control.

    Args:
        statics: Of the robot.
        target: (2,) [m], (x, z).
        guess: (n_inputs,) [N], start; the nearest local minimum is found.

    Returns:
        The inputs. `converged` is False where the target cannot be reached from the guess; the
        inputs are then those of the smallest residual met.
    """
    u = np.array(guess, dtype=float)
    best, best_residual = u, np.inf
    for _ in range(_NEWTON_ITERATIONS):
        tip, first, second = statics.expand(u)
        gap = np.asarray(target) - tip
        residual = float(np.hypot(*gap))
        if residual < best_residual:
            best, best_residual = u, residual
        to_range, to_null = _newton_steps(u, gap, first, second)
        if residual < _REACHED and np.max(np.abs(to_null)) < _SHORTEST:
            return InverseStatics(u, residual, True)
        u = u + _shorten(to_range, statics.limit) + _shorten(to_null, statics.limit)
    return InverseStatics(best, best_residual, False)


def _newton_steps(
    u: np.ndarray, gap: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step towards the target in the row space of J, and down |u|^2 in its null space."""
    left, singular, right = np.linalg.svd(first)
    # Near the straight pose J loses rank; the damping bounds the step there and vanishes with
    # the gap, so it does not disturb convergence.
    damping = 1e-3 * np.hypot(*gap) * singular[0]
    # A straight arm with its tip on the target: no gain, where both are exactly zero.
    gain = singular / (singular**2 + damping + np.finfo(float).tiny)
    range_, null = right[: len(singular)].T, right[len(singular) :].T
    to_range = range_ @ (gain * (left.T @ gap))
    multiplier = -left @ (gain * (range_.T @ u))
    bend = np.eye(len(u)) + multiplier[0] * second[0] + multiplier[1] * second[1]
    hessian = null.T @ bend @ null
    values, vectors = np.linalg.eigh(hessian)
    slope = vectors.T @ (null.T @ u)
    return to_range, -null @ (vectors @ (slope / np.maximum(np.abs(values), 0.1)))


def _shorten(step: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The step, scaled down to at most a tenth of the tension limit."""
    return step / max(1.0, np.max(np.abs(step) / (0.1 * limit)))
