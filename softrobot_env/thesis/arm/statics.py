"""How the arm's laws follow a target: on from the last inputs, under known forces and stiffness.

The tip has two coordinates, the arm more inputs than that; what is left free is resolved towards
the least norm of the inputs, that is the least tension. Called until nothing changes, `follow`
takes some 70 calls and comes to rest 0.07 mN (median of 500 targets; 10 % more than 12 mN, one 5 N
on another branch) from the least norm, which `feedforward.statics.least_norm` solves for to the
end, whatever the limits of the inputs; that takes 40 times as long as a call of `follow`.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.beams.planar_arm import PlanarArm, tip
from softrobot_env.compile.kernels import kernel

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


@kernel
def inverse_jacobian(
    by_inputs: ndarray, free: ndarray, damping: float, out: ndarray, null: ndarray
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
    inputs: ndarray,
    target: ndarray,
    force: ndarray,
    scale: float,
    curvature: ndarray,
    jacobian: ndarray,
    way: ndarray,
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
    target: ndarray,
    force: ndarray,
    scale: float,
    limit: ndarray,
    inputs: ndarray,
    curvature: ndarray,
    inverse: ndarray,
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
