"""The DAE of the servo constraints for a rig in several pieces, solved step by step, in kernels.

(5.30) to (5.33) with the audit's corrections: with the coordinates q, rates v and the reduced input
F_red as unknowns,

    q' = v,    M v' + k = f + B F_red,    C v = z_des' - gain (z(q) - z_des).

The last term, Baumgarte's, keeps the output from drifting away from z_des.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams import mechanics
from softrobot_env.beams.pcc.model import PccData
from softrobot_env.compile.kernels import kernel, structure

_STEP = 1e-30  # imaginary: its square vanishes beside one
_ITERATIONS = 20
_RENEWAL = 5  # iterations with one Newton matrix
_CONVERGED = 1e-11  # change of the bending angle [rad], or of its rate relative to its size


@structure
class FlexibleRig(NamedTuple):
    """Data of the kernels.

    Attributes:
        model: Data of the beam model.
        probe: Data of a model whose point is the centre of the end section.
        height: [m] of the output above the end section.
        inputs: B (n, 2) [m2], force on the coordinates per reduced input; constant, as tendons in
            channels have constant moment arms.
    """

    model: PccData
    probe: PccData
    height: float
    inputs: ndarray


@kernel
def place_output(rig: FlexibleRig, q: ndarray, out: ndarray) -> None:
    """Set out (2,) [m] to the place of the output beside the axis; real or complex."""
    end, axes = np.empty((1, 3), q.dtype), np.empty((1, 3, 3), q.dtype)
    mechanics.locate(rig.probe, q, end, axes)
    out[0] = end[0, 0] + rig.height * axes[0, 0, 2]
    out[1] = end[0, 1] + rig.height * axes[0, 1, 2]


@kernel
def output_matrix(rig: FlexibleRig, q: ndarray, out: ndarray) -> None:
    """Set out (2, n) to the derivative of the output."""
    moved, z = q.astype(np.complex128), np.empty(2, np.complex128)
    for j in range(len(q)):
        moved[j] += _STEP * 1j
        place_output(rig, moved, z)
        out[0, j], out[1, j] = z[0].imag / _STEP, z[1].imag / _STEP
        moved[j] = q[j]


@kernel
def _residual(
    rig: FlexibleRig, q: ndarray, v: ndarray, a: ndarray, reduced: ndarray, out: ndarray
) -> None:
    """Set out (n,) to the force missing from balance."""
    mechanics.internal_residual(rig.model, q, v, a, out)
    for i in range(len(q)):
        out[i] -= rig.inputs[i, 0] * reduced[0] + rig.inputs[i, 1] * reduced[1]


@kernel
def _newton_matrix(
    rig: FlexibleRig,
    q: ndarray,
    v: ndarray,
    a: ndarray,
    by_q: float,
    by_v: float,
    by_a: float,
    constraint: float,
    out: ndarray,
) -> None:
    """Set out (n + 2, n + 2): derivatives of balance and constraint by a coordinate and F_red.

    The coordinate moves q, v and a by `by_q`, `by_v` and `by_a` per unit, and the constraint by
    `constraint` times that of the output.
    """
    n = len(q)
    q1, v1, a1 = q.astype(np.complex128), v.astype(np.complex128), a.astype(np.complex128)
    force, outputs = np.empty(n, np.complex128), np.empty((2, n))
    for j in range(n):
        q1[j] += _STEP * 1j * by_q
        v1[j] += _STEP * 1j * by_v
        a1[j] += _STEP * 1j * by_a
        mechanics.internal_residual(rig.model, q1, v1, a1, force)
        for i in range(n):
            out[i, j] = force[i].imag / _STEP
        q1[j], v1[j], a1[j] = q[j], v[j], a[j]
    output_matrix(rig, q, outputs)
    out[n:, n:] = 0.0
    for j in range(n):
        for i in range(2):
            out[j, n + i] = -rig.inputs[j, i]
            out[n + i, j] = constraint * outputs[i, j]


@kernel
def _inverse(matrix: ndarray) -> ndarray:
    """Inverse of a matrix; NaN, which no test of a size lets pass, if there is none."""
    if np.all(np.isfinite(matrix)):
        try:
            return np.linalg.inv(matrix)
        except Exception:  # singular; numba knows no other class
            pass
    return np.full_like(matrix, np.nan).T


@kernel
def hold(rig: FlexibleRig, z: ndarray, q: ndarray, reduced: ndarray) -> bool:
    """Replace q (n,) and reduced (2,) by those that hold the output at z (2,); whether found."""
    n, length = len(q), rig.model.length.sum()
    zero, missing = np.zeros(n), np.empty(n + 2)
    matrix, place = np.empty((n + 2, n + 2)), np.empty(2)
    for _ in range(_ITERATIONS):
        _residual(rig, q, zero, zero, reduced, missing[:n])
        place_output(rig, q, place)
        missing[n:] = place - z
        _newton_matrix(rig, q, zero, zero, 1.0, 0.0, 0.0, 1.0, matrix)
        change = _inverse(matrix) @ missing
        q -= change[:n]
        reduced -= change[n:]
        size = length * np.max(np.abs(change[:n]))
        if not size < np.pi:
            return False
        if size < _CONVERGED:
            return True
    return False


@kernel
def _solve_step(
    rig: FlexibleRig,
    share: float,
    gain: float,
    base_q: ndarray,
    base_v: ndarray,
    z: ndarray,
    dz: ndarray,
    q: ndarray,
    v: ndarray,
    reduced: ndarray,
) -> bool:
    """Solve the DAE with q = base_q + share q' and v = base_v + share v'; whether that worked.

    Args:
        rig: The rig.
        share: [s], the step times the method's coefficient.
        gain: [1/s].
        base_q, base_v: (n,), what the past contributes.
        z, dz: (2,) [m, m/s] wanted.
        q: (n,), set.
        v, reduced: (n,) and (2,), start of Newton's iteration, replaced by the solution.
    """
    n, length = len(q), rig.model.length.sum()
    missing, place = np.empty(n + 2), np.empty(2, np.complex128)
    matrix = np.empty((n + 2, n + 2))
    inverse = matrix.T  # as `inv` stores it, column by column
    for iteration in range(_ITERATIONS):
        q[:] = base_q + share * v
        rate = (v - base_v) / share
        _residual(rig, q, v, rate, reduced, missing[:n])
        place_output(rig, q + _STEP * 1j * v, place)
        for i in range(2):
            slip = place[i].imag / _STEP - dz[i]
            missing[n + i] = slip + gain * (place[i].real - z[i])
        if iteration % _RENEWAL == 0:
            _newton_matrix(rig, q, v, rate, share, 1.0, 1 / share, 1 + gain * share, matrix)
            inverse = _inverse(matrix)
        change = inverse @ missing
        v -= change[:n]
        reduced -= change[n:]
        size = length * np.max(np.abs(change[:n]))
        if not share * size < np.pi:
            return False
        if size < _CONVERGED * (1 + length * np.max(np.abs(v))):
            q[:] = base_q + share * v
            return True
    return False


@kernel
def advance(
    rig: FlexibleRig,
    h: float,
    gain: float,
    first: bool,
    z: ndarray,
    dz: ndarray,
    q: ndarray,
    v: ndarray,
    reduced: ndarray,
) -> bool:
    """One step of the two-step BDF method, the first by the implicit Euler method.

    Args:
        rig: The rig.
        h: Step [s].
        gain: [1/s].
        first: Whether there is one state before only.
        z, dz: (2,) [m, m/s], wanted at the end.
        q, v: (3, n); the last two rows, or the last, are the states before, and all move up.
        reduced: (2,) [N], replaced.

    Returns:
        Whether Newton's iteration converged.
    """
    for i in range(2):
        q[i], v[i] = q[i + 1], v[i + 1]
    if first:
        return _solve_step(rig, h, gain, q[1].copy(), v[1].copy(), z, dz, q[2], v[2], reduced)
    base_q, base_v = (4 * q[1] - q[0]) / 3, (4 * v[1] - v[0]) / 3
    return _solve_step(rig, 2 * h / 3, gain, base_q, base_v, z, dz, q[2], v[2], reduced)
