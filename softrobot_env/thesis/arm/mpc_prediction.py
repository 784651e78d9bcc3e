"""Prediction of the planar arm over a horizon, its cost and the cost's Gauss-Newton model.

The state at the end of a step follows from implicit stages: with base (q^, v^) and s = gamma h,

    a: M a + k + K (q + mu v) - B u - d = 0,   v = v^ + s a,   q = q^ + s v.

Gamma = 1 with the step's start as base is the implicit Euler method. Gamma = 1 - 1 / sqrt(2) with
a second stage, whose base is the start plus (1 - gamma) h times the first stage's (v, a), is the
L-stable method of order two of Alexander (1977). Newton's matrix comes from complex steps of the
residual and is exact; the stages' derivatives by the inputs follow from the converged equations.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams import planar_arm
from softrobot_env.compile.kernels import kernel, structure

_STEP = 1e-30  # imaginary: its square vanishes beside one

#: Newton's iteration ends with a change of the curvatures [1/m] below this; convergence is
#: quadratic, so that what is left is far smaller.
_NEWTON_CHANGE = 1e-6
_NEWTON_ITERATIONS = 20


@structure
class Horizon(NamedTuple):
    """Grid and weights of the cost, p steps and c input blocks.

    Attributes:
        steps: (p,) [s].
        block: (p,) int, row of the inputs in force during a step.
        gamma: Diagonal coefficient [1] of the integrator, one of `settings.GAMMA`.
        error: (p,) [1/m2] on the tip error at the end of a step.
        rate: (p,) [s2/m2] on the mean rate of the tip error over a step.
        effort: (p,) [1/N2] on the inputs during a step.
        change: (p,) [1/N2] on their change from the step before.
    """

    steps: ndarray
    block: ndarray
    gamma: float
    error: ndarray
    rate: ndarray
    effort: ndarray
    change: ndarray


@kernel
def _eliminate(matrix: ndarray, right: ndarray, columns: int) -> bool:
    """Solve in place for the first columns of right (n, k); whether the matrix is regular."""
    n = len(matrix)
    for i in range(n):
        pivot = i
        for r in range(i + 1, n):
            if abs(matrix[r, i]) > abs(matrix[pivot, i]):
                pivot = r
        if not abs(matrix[pivot, i]) > 0:
            return False
        if pivot != i:
            for c in range(n):
                matrix[i, c], matrix[pivot, c] = matrix[pivot, c], matrix[i, c]
            for c in range(columns):
                right[i, c], right[pivot, c] = right[pivot, c], right[i, c]
        for r in range(i + 1, n):
            factor = matrix[r, i] / matrix[i, i]
            for c in range(i + 1, n):
                matrix[r, c] -= factor * matrix[i, c]
            for c in range(columns):
                right[r, c] -= factor * right[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(columns):
            total = right[i, c]
            for r in range(i + 1, n):
                total -= matrix[i, r] * right[r, c]
            right[i, c] = total / matrix[i, i]
    return True


@kernel
def _newton_system(
    arm: Any, s: float, q: ndarray, v: ndarray, a: ndarray, u: ndarray, matrix: Any
) -> ndarray:
    """Residual (n, 1) of a stage, and set its derivative (n, n) by the acceleration."""
    n = arm.n
    q1, v1 = q.astype(np.complex128), v.astype(np.complex128)
    a1, u1 = a.astype(np.complex128), u.astype(np.complex128)
    out, right = np.empty(n, np.complex128), np.empty((n, 1))
    for j in range(n):
        q1[j] += s * s * _STEP * 1j
        v1[j] += s * _STEP * 1j
        a1[j] += _STEP * 1j
        planar_arm.residual(arm, q1, v1, a1, u1, out)
        for i in range(n):
            matrix[i, j], right[i, 0] = out[i].imag / _STEP, out[i].real
        q1[j], v1[j], a1[j] = q[j], v[j], a[j]
    return right


@kernel
def _solve_stage(
    arm: Any, s: float, u: ndarray, force: ndarray, base: ndarray, state: ndarray, a: ndarray
) -> bool:
    """Set state (2, n) and acceleration a (n,), its guess before, of a stage with a base (2, n).

    Returns:
        Whether Newton's iteration converged.
    """
    n, q, v = arm.n, state[0], state[1]
    matrix = np.empty((n, n))
    for _ in range(_NEWTON_ITERATIONS):
        for i in range(n):
            v[i] = base[1, i] + s * a[i]
            q[i] = base[0, i] + s * v[i]
        right = _newton_system(arm, s, q, v, a, u, matrix)
        for i in range(n):
            right[i, 0] -= force[i]
        if not _eliminate(matrix, right, 1):
            return False
        change = 0.0
        for i in range(n):
            a[i] -= right[i, 0]
            v[i] -= s * right[i, 0]
            q[i] -= s * s * right[i, 0]
            change += abs(s * s * right[i, 0])
        if not change < np.inf:
            return False
        if change < _NEWTON_CHANGE:
            return True
    return False


@kernel
def _differentiate_stage(
    arm: Any,
    s: float,
    u: ndarray,
    columns: tuple[int, int],
    state: ndarray,
    a: ndarray,
    base: ndarray,
    slope: ndarray,
    slope_a: ndarray,
) -> bool:
    """Set the derivatives slope (2, n, k) and slope_a (n, k) of a stage by all inputs.

    Args:
        arm, s, u, state, a: The solved stage.
        columns: First column of the inputs in force, and the number of columns up to their end.
        base: (2, n, k), derivatives of the stage's base.
        slope, slope_a: Results.
    """
    n, (first, end) = arm.n, columns
    by_q, by_v, matrix = np.empty((3, n, n))
    planar_arm.derivatives(arm, state[0], state[1], a, u, by_q, by_v)
    planar_arm.inertia_forces(arm, state[0], state[1], matrix, np.empty(n))
    for i in range(n):
        for j in range(n):
            by_v[i, j] += s * by_q[i, j]
            matrix[i, j] += s * by_v[i, j]
    for i in range(n):
        for c in range(end):
            total = arm.inputs[i, c - first] if c >= first else 0.0
            for j in range(n):
                total -= by_q[i, j] * base[0, j, c] + by_v[i, j] * base[1, j, c]
            slope_a[i, c] = total
    if not _eliminate(matrix, slope_a, end):
        return False
    for i in range(n):
        for c in range(end):
            slope[1, i, c] = base[1, i, c] + s * slope_a[i, c]
            slope[0, i, c] = base[0, i, c] + s * slope[1, i, c]
    return True


@kernel
def _second_base(
    share: float, state: ndarray, a: ndarray, slope: ndarray, slope_a: ndarray, base: Any
) -> None:
    """Move base (2, n) and its derivatives, a pair, from the step's start on to stage two.

    The first stage is given by state, a, slope and slope_a. Loops over elements: slices would
    take seconds more to compile.
    """
    position, derivative = base
    for i in range(len(a)):
        position[0, i] += share * state[1, i]
        position[1, i] += share * a[i]
        for c in range(slope.shape[2]):
            derivative[0, i, c] += share * slope[1, i, c]
            derivative[1, i, c] += share * slope_a[i, c]


@kernel
def _advance(
    arm: Any,
    step: tuple[float, float],
    u: ndarray,
    force: ndarray,
    columns: tuple[int, int],
    guess: ndarray,
    state: ndarray,
    slope: ndarray,
) -> bool:
    """Move a state (2, n) and its derivatives slope (2, n, k) on by one step in place.

    Args:
        arm: The arm.
        step: Duration [s] and gamma.
        u: (n_inputs,) [N].
        force: (n,) further force on the curvatures.
        columns: As in `_differentiate_stage`.
        guess: (stages, n), guesses of the accelerations; those found after.
        state, slope: See above.
    """
    h, gamma = step
    base, base_slope = state.copy(), slope.copy()
    slope_a = np.zeros(slope.shape[1:])
    for stage in range(len(guess)):
        a = guess[stage]
        if not _solve_stage(arm, gamma * h, u, force, base, state, a):
            return False
        if slope.shape[2] > 0 and not _differentiate_stage(
            arm, gamma * h, u, columns, state, a, base_slope, slope, slope_a
        ):
            return False
        if stage + 1 < len(guess):
            _second_base((1 - gamma) * h, state, a, slope, slope_a, (base, base_slope))
    return True


@kernel
def _add_square(
    weight: float, error: float, row: ndarray, count: int, gradient: Any, hessian: Any
) -> None:
    """Add weight times the square of a term with a derivative row to gradient and Hessian."""
    for i in range(count):
        gradient[i] += 2 * weight * error * row[i]
        for j in range(i + 1):
            hessian[i, j] += 2 * weight * row[i] * row[j]


@kernel
def _add_inputs(
    k: int, horizon: Any, inputs: ndarray, before: ndarray, gradient: ndarray, hessian: ndarray
) -> float:
    """Cost of the inputs in step k and of their change at its start.

    Its derivatives are added to gradient and Hessian, unless these are empty.
    """
    block, earlier = horizon.block[k], horizon.block[k - 1] if k > 0 else -1
    m, effort, weight, cost = inputs.shape[1], horizon.effort[k], horizon.change[k], 0.0
    for j in range(m):
        u, change = inputs[block, j], 0.0
        if earlier != block:
            change = u - (inputs[earlier, j] if earlier >= 0 else before[j])
        cost += effort * u * u + weight * change * change
        if len(gradient) == 0:
            continue
        i, o = block * m + j, earlier * m + j
        gradient[i] += 2 * effort * u
        hessian[i, i] += 2 * effort
        if earlier == block:
            continue
        gradient[i] += 2 * weight * change
        hessian[i, i] += 2 * weight
        if earlier >= 0:
            gradient[o] -= 2 * weight * change
            hessian[o, o] += 2 * weight
            hessian[i, o] -= 2 * weight
    return cost


class _Tip(NamedTuple):
    """Error (2,) [m] of the tip, its Jacobian (2, n) and its derivatives (2, k) by the inputs."""

    error: ndarray
    jacobian: ndarray
    rows: ndarray


@kernel
def _locate(arm: Any, state: ndarray, slope: ndarray, end: int, target: ndarray, tip: _Tip) -> None:
    """Set the tip's error and its derivatives by the first `end` inputs."""
    planar_arm.tip(arm, state[0], tip.error, tip.jacobian)
    for x in range(2):
        tip.error[x] -= target[x]
        for c in range(end):
            tip.rows[x, c] = 0.0
            for i in range(arm.n):
                tip.rows[x, c] += tip.jacobian[x, i] * slope[0, i, c]


@kernel
def evaluate(
    horizon: Any,
    arm: Any,
    start: ndarray,
    force: ndarray,
    before: ndarray,
    reference: ndarray,
    inputs: ndarray,
    guess: ndarray,
    path: ndarray,
    gradient: ndarray,
    hessian: ndarray,
) -> float:
    """Cost [1] of inputs over the horizon, and its Gauss-Newton model.

    Args:
        horizon: Reference to a `Horizon` of p steps.
        arm: Reference to a `PlanarArm` of n pieces.
        start: (2, n), curvatures [1/m] and their rates.
        force: (n,) [N m2], disturbance on the curvatures, constant over the horizon.
        before: (n_inputs,) [N], inputs in force until now.
        reference: (p + 1, 2) [m], now and at the ends of the steps.
        inputs: (c, n_inputs) [N].
        guess: (p, stages, n) [1/(m s2)], guesses of the accelerations; those found after.
        path: (p, 2, n), states at the ends of the steps after.
        gradient: (c n_inputs,) [1/N] after; empty if only the cost is wanted.
        hessian: (c n_inputs, c n_inputs) [1/N2] after; empty like the gradient.

    Returns:
        The cost; infinite if Newton's iteration failed, the model is then worthless.
    """
    n, m, count = arm.n, inputs.shape[1], len(gradient)
    gradient[:], hessian[:] = 0, 0
    state, slope = start.copy(), np.zeros((2, n, count))
    tip = _Tip(np.empty(2), np.empty((2, n)), np.zeros((2, count)))
    _locate(arm, state, slope, 0, reference[0], tip)
    cost = 0.0
    for k in range(len(horizon.steps)):
        first = horizon.block[k] * m
        end = min(first + m, count)
        columns, step = (first, end), (horizon.steps[k], horizon.gamma)
        u = inputs[horizon.block[k]]
        if not _advance(arm, step, u, force, columns, guess[k], state, slope):
            return np.inf
        path[k] = state
        before_error, before_rows = tip.error.copy(), tip.rows.copy()
        _locate(arm, state, slope, end, reference[k + 1], tip)
        for x in range(2):
            error, rate = tip.error[x], (tip.error[x] - before_error[x]) / step[0]
            rate_row = (tip.rows[x] - before_rows[x]) / step[0]
            cost += horizon.error[k] * error * error + horizon.rate[k] * rate * rate
            _add_square(horizon.error[k], error, tip.rows[x], end, gradient, hessian)
            _add_square(horizon.rate[k], rate, rate_row, end, gradient, hessian)
        cost += _add_inputs(k, horizon, inputs, before, gradient, hessian)
    for i in range(count):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return cost
