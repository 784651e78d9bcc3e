"""Inverse statics of the planar arm: which inputs hold its tip on a target.

The tip has two coordinates, the arm more inputs than that; what is left free is resolved towards
the least norm of the inputs, that is the least tension, in two ways for two purposes:

    least_norm   solves to the end, whatever the limits of the inputs: for a controller that has
                 nothing but the statics, and nothing to correct a remainder
    follow       moves on from the last inputs, within their limits, under known forces and with
                 a known stiffness: for a law that decides every millisecond

Neither can stand in for the other. Called until nothing changes, `follow` takes some 70 calls and
comes to rest 0.07 mN (median of 500 targets; 10 % more than 12 mN, one 5 N on another branch) from
the least norm; `least_norm` takes 40 times as long as a call of `follow`.
"""

from dataclasses import dataclass

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.closed_forms.planar_arm import PlanarArm, tip
from softrobot_env.beams.numerics.compilation import kernel

#: Of `least_norm`: largest distance [m] from the target, and step [N] to a lesser norm left.
_REACHED, _SHORTEST = 1e-8, 1e-7
_NEWTON_ITERATIONS = 60

#: Of `follow`: squared damping [m2/N2] of the inverse: J loses rank in the straight pose.
_DAMPING = 1e-8
#: Growth [1/N2] of the damping with the squared distance from the target, where J changes a lot.
_DAMPING_BY_GAP = 1e-2
#: [m], distance from the equilibrium to the reference that counts as out of reach.
REACH = 1e-4

#: Share of the way to the inputs of least norm per decision of 1 ms.
_RELAXATION = 0.02

_ITERATIONS = 5
_HALVINGS = 3  # of a step that leads away from the target
_TOLERANCE = 1e-7  # m


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


@kernel
def inverse_jacobian(
    by_inputs: np.ndarray, free: np.ndarray, damping: float, out: np.ndarray, null: np.ndarray
) -> None:
    """Set the damped pseudo-inverse of J and the projector on its null space.

    Args:
        by_inputs: J (2, n_inputs) [m/N], derivative of the tip by the inputs.
        free: (n_inputs,), 1 for inputs that may move, else 0.
        damping: [m2/N2].
        out: (n_inputs, 2) [N/m], set.
        null: (n_inputs, n_inputs), set.
    """
    m = by_inputs.shape[1]
    a, b, d = damping, 0.0, damping
    for j in range(m):
        a += free[j] * by_inputs[0, j] ** 2
        b += free[j] * by_inputs[0, j] * by_inputs[1, j]
        d += free[j] * by_inputs[1, j] ** 2
    size = a * d - b * b
    for j in range(m):
        x, z = free[j] * by_inputs[0, j], free[j] * by_inputs[1, j]
        out[j, 0], out[j, 1] = (d * x - b * z) / size, (a * z - b * x) / size
    for j in range(m):
        for k in range(m):
            null[j, k] = -out[j, 0] * by_inputs[0, k] - out[j, 1] * by_inputs[1, k]
            null[j, k] *= free[k]
        null[j, j] += free[j]


@kernel
def _gap(
    arm: PlanarArm,
    inputs: np.ndarray,
    target: np.ndarray,
    force: np.ndarray,
    scale: float,
    curvature: np.ndarray,
    jacobian: np.ndarray,
    way: np.ndarray,
) -> float:
    """Distance [m] from the equilibrium's tip to a target; sets the last three arguments."""
    for i in range(arm.n):
        total = force[i]
        for j in range(len(inputs)):
            total += arm.inputs[i, j] * inputs[j]
        curvature[i] = total / (scale * arm.stiffness)
    tip(arm, curvature, way, jacobian)
    for i in range(2):
        way[i] = target[i] - way[i]
    return np.hypot(way[0], way[1])


@kernel
def follow(
    arm: PlanarArm,
    target: np.ndarray,
    force: np.ndarray,
    scale: float,
    limit: np.ndarray,
    inputs: np.ndarray,
    curvature: np.ndarray,
    inverse: np.ndarray,
) -> float:
    """Move inputs on to those that hold the tip at a target, or nearest to it within the limits.

    Gauss-Newton with the inputs at their limits set aside. The redundancy is resolved step by
    step: the inputs move straight to the target, and relax towards those of least norm that hold
    it.

    Args:
        arm: The arm.
        target: (2,) [m], (x, z).
        force: (n,), more generalised force on the curvatures.
        scale: Factor [1] on the arm's stiffness.
        limit: (n_inputs,) [N], largest inputs.
        inputs: (n_inputs,) [N], moved.
        curvature: (n,) [1/m], set to the equilibrium's.
        inverse: (n_inputs, 2) [N/m], set to the pseudo-inverse of the static tip Jacobian.

    Returns:
        Distance [m] from the target that is left.
    """
    m = len(inputs)
    jacobian, way, null, free = np.empty((2, arm.n)), np.empty(2), np.empty((m, m)), np.ones(m)
    gap = _gap(arm, inputs, target, force, scale, curvature, jacobian, way)
    before, trial = inputs.copy(), np.empty(m)
    for iteration in range(_ITERATIONS):
        by_inputs = jacobian @ arm.inputs / (scale * arm.stiffness)
        for j in range(m):
            pull = by_inputs[0, j] * way[0] + by_inputs[1, j] * way[1]
            outward = pull if inputs[j] > 0 else -pull
            free[j] = 0.0 if abs(inputs[j]) >= limit[j] and outward > 0 else 1.0
        inverse_jacobian(by_inputs, free, _DAMPING + _DAMPING_BY_GAP * gap**2, inverse, null)
        if iteration and gap < _TOLERANCE:
            break
        step = inverse[:, 0] * way[0] + inverse[:, 1] * way[1]
        if iteration == 0:
            step -= _RELAXATION * (null @ inputs)
        before[:] = inputs
        for _ in range(_HALVINGS):
            for j in range(m):
                trial[j] = min(max(before[j] + step[j], -limit[j]), limit[j])
            reached = _gap(arm, trial, target, force, scale, curvature, jacobian, way)
            if reached <= max(gap, _TOLERANCE):
                break
            step *= 0.5
        inputs[:], gap = trial, reached
    return gap
