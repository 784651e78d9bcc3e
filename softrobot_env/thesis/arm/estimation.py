"""What a model of the arm leaves unexplained: its stiffness, and forces on its curvatures."""

import numpy as np
from numpy import ndarray

from softrobot_env.beams.planar_arm import PlanarArm, inertia_forces
from softrobot_env.compile.kernels import kernel

#: Part of the full actuation that balances of forces are good for, and of the inertia forces,
#: where the lumped model is coarse.
_FLOOR, _INERTIA_SHARE = 0.02, 0.5
_FORGETTING = 0.2  # s, memory of the stiffness estimate
_BANDWIDTH = 50.0  # 1/s, of the force estimate

#: Part of the full actuation up to which curvature and rates may contradict each other, as what
#: the damping would have to do; a measurement beyond that is an outlier.
_CONTRADICTION = 0.2

#: [s], trust in the nominal stiffness: as if it had been observed for so long at the floor.
_PRIOR = 0.03

#: Factors [1] on the stiffness that the estimate is kept in.
_RANGE = (0.3, 3.0)


@kernel
def update_estimate(
    arm: PlanarArm,
    period: float,
    before: ndarray,
    rate_before: ndarray,
    curvature: ndarray,
    rate: ndarray,
    inputs: ndarray,
    full: ndarray,
    adapt: bool,
    information: ndarray,
    force: ndarray,
) -> float:
    """Update a stiffness factor s and a force d from M a + k + s K (q + mu v) = B u + d.

    The balance is integrated over the period, in which the stiff part moves: the damping does
    mu K times the change of the curvature, exactly. s is a least-squares estimate with
    forgetting, weighted by how well the balance can be trusted (right after a jump of the inputs
    the fast modes, coarse in the model, make it useless); d is low-pass filtered and at most the
    full actuation. Where curvatures and rates contradict each other nothing is learned.

    Args:
        arm: The nominal arm.
        period: [s] between the two states.
        before, rate_before: (n,), curvatures [1/m] and rates at the start of the period.
        curvature, rate: (n,), at its end.
        inputs: (n_inputs,) [N] applied in it.
        full: (n_inputs,) [N], full-scale inputs.
        adapt: Whether to estimate s; it is 1 otherwise.
        information: (2,) [s], what of the numerator and of the denominator of s is beyond the trust
            in the nominal stiffness; updated.
        force: (n,), d, updated.

    Returns:
        The stiffness factor.
    """
    n = arm.n
    if _contradict(arm, period, before, rate_before, curvature, rate, full):
        return stiffness_factor(adapt, information)
    mass, missing, elastic = np.empty((n, n)), np.empty(n), np.empty(n)
    middle, rate_middle = (before + curvature) / 2, (rate_before + rate) / 2
    inertia_forces(arm, middle, rate_middle, mass, missing)
    change = (rate - rate_before) / period
    scale, inertia = _actuation(arm, full), 0.0
    for i in range(n):
        moving = 0.0
        for k in range(n):
            moving += mass[i, k] * change[k]
        inertia = max(inertia, abs(moving))
        missing[i] += moving
        for j in range(len(inputs)):
            missing[i] -= arm.inputs[i, j] * inputs[j]
        slope = arm.damping_time * (curvature[i] - before[i]) / period
        elastic[i] = arm.stiffness * (middle[i] + slope)
    floor = _FLOOR * scale / len(inputs)
    spread = floor + _INERTIA_SHARE * inertia
    if adapt:
        kept, weight = np.exp(-period / _FORGETTING), period / spread**2
        information *= kept
        for i in range(n):
            information[0] += weight * elastic[i] * (force[i] - missing[i])
            information[1] += weight * elastic[i] ** 2
    factor = stiffness_factor(adapt, information)
    share = (1 - np.exp(-_BANDWIDTH * period)) * floor / spread
    for i in range(n):
        force[i] += share * (missing[i] + factor * elastic[i] - force[i])
        force[i] = min(max(force[i], -scale), scale)
    return factor


@kernel
def stiffness_factor(adapt: bool, information: ndarray) -> float:
    """Stiffness factor from its information (2,) [s]."""
    if not adapt:
        return 1.0
    return min(max((_PRIOR + information[0]) / (_PRIOR + information[1]), _RANGE[0]), _RANGE[1])


@kernel
def _actuation(arm: PlanarArm, full: ndarray) -> float:
    """Largest force on a curvature [N m2] under full inputs (n_inputs,) [N]."""
    largest = 0.0
    for i in range(arm.n):
        total = 0.0
        for j in range(len(full)):
            total += arm.inputs[i, j] * full[j]
        largest = max(largest, total)
    return largest


@kernel
def _contradict(
    arm: PlanarArm,
    period: float,
    before: ndarray,
    rate_before: ndarray,
    curvature: ndarray,
    rate: ndarray,
    full: ndarray,
) -> bool:
    """Whether curvatures moved otherwise than their rates say, at the start or at the end."""
    allowed = _CONTRADICTION * _actuation(arm, full) / (arm.damping_time * arm.stiffness)
    for i in range(arm.n):
        moved = (curvature[i] - before[i]) / period
        low, high = min(rate_before[i], rate[i]), max(rate_before[i], rate[i])
        if not low - allowed <= moved <= high + allowed:
            return True
    return False
