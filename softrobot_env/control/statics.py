"""The equilibrium of the planar arm that puts its tip on a target, followed step by step."""

import numpy as np

from softrobot_env.beams.compilation import kernel
from softrobot_env.beams.planar_arm import PlanarArm, tip

#: Squared damping [m2/N2] of the inverse: J loses rank in the straight pose.
_DAMPING = 1e-8
_ITERATIONS = 5
_TOLERANCE = 1e-7  # m


@kernel
def equilibrium(
    arm: PlanarArm, inputs: np.ndarray, force: np.ndarray, scale: float, out: np.ndarray
) -> None:
    """Set out (n,) [1/m] to the curvature at rest.

    Args:
        arm: The arm.
        inputs: (n_inputs,) [N].
        force: (n,), more generalised force on the curvatures.
        scale: Factor [1] on the arm's stiffness.
        out: Set.
    """
    for i in range(arm.n):
        total = force[i]
        for j in range(len(inputs)):
            total += arm.inputs[i, j] * inputs[j]
        out[i] = total / (scale * arm.stiffness)


@kernel
def inverse_jacobian(
    arm: PlanarArm, jacobian: np.ndarray, scale: float, out: np.ndarray, null: np.ndarray
) -> None:
    """Set J+ and the projector on the null space of the static tip Jacobian J by the inputs.

    Args:
        arm: The arm.
        jacobian: (2, n) [m2], derivative of the tip by the curvatures.
        scale: Factor [1] on the arm's stiffness.
        out: (n_inputs, 2) [N/m], set to the damped pseudo-inverse.
        null: (n_inputs, n_inputs), set.
    """
    m = arm.inputs.shape[1]
    by_inputs = jacobian @ arm.inputs / (scale * arm.stiffness)
    a, b, d = _DAMPING, 0.0, _DAMPING
    for j in range(m):
        a += by_inputs[0, j] ** 2
        b += by_inputs[0, j] * by_inputs[1, j]
        d += by_inputs[1, j] ** 2
    size = a * d - b * b
    for j in range(m):
        x, z = by_inputs[0, j], by_inputs[1, j]
        out[j, 0], out[j, 1] = (d * x - b * z) / size, (a * z - b * x) / size
    for j in range(m):
        for k in range(m):
            null[j, k] = -out[j, 0] * by_inputs[0, k] - out[j, 1] * by_inputs[1, k]
        null[j, j] += 1


@kernel
def follow(
    arm: PlanarArm,
    target: np.ndarray,
    force: np.ndarray,
    scale: float,
    relaxation: float,
    limit: np.ndarray,
    inputs: np.ndarray,
    curvature: np.ndarray,
    inverse: np.ndarray,
) -> float:
    """Move inputs on to those that hold the tip at a target, by Newton's method.

    The redundancy is resolved step by step: the inputs move straight to the target, and relax
    towards those of least norm that hold it.

    Args:
        arm: The arm.
        target: (2,) [m], (x, z).
        force: (n,), more generalised force on the curvatures.
        scale: Factor [1] on the arm's stiffness.
        relaxation: Share [1] of the way to the least norm taken in this call.
        limit: (n_inputs,) [N], largest inputs.
        inputs: (n_inputs,) [N], moved.
        curvature: (n,) [1/m], set to the equilibrium's.
        inverse: (n_inputs, 2) [N/m], set to the pseudo-inverse of the static tip Jacobian.

    Returns:
        Distance [m] from the target that is left.
    """
    m = len(inputs)
    point, jacobian, null = np.empty(2), np.empty((2, arm.n)), np.empty((m, m))
    gap = np.inf
    for iteration in range(_ITERATIONS):
        equilibrium(arm, inputs, force, scale, curvature)
        tip(arm, curvature, point, jacobian)
        inverse_jacobian(arm, jacobian, scale, inverse, null)
        to_x, to_z = target[0] - point[0], target[1] - point[1]
        gap = np.hypot(to_x, to_z)
        if gap < _TOLERANCE and iteration:
            break
        step = inverse[:, 0] * to_x + inverse[:, 1] * to_z
        if iteration == 0:
            step = step - relaxation * (null @ inputs)
        for j in range(m):
            inputs[j] = min(max(inputs[j] + step[j], -limit[j]), limit[j])
    return gap
