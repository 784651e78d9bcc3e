"""Linear models of a beam about a state, by complex-step differentiation."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel

from ..mechanics import (
    add_applied,
    add_internal_tangent,
    applied_forces_turn,
    bandwidth,
    differentiated,
    locate,
)

#: Imaginary step: its square vanishes beside one, so the derivatives are exact to rounding.
_STEP = 1e-30


@dataclass(frozen=True)
class StateSpace:
    """x. = A x + B u, y = C x about a state; x holds m coordinates, then their m velocities.

    Attributes:
        a: (2 m, 2 m).
        b: (2 m, n_inputs).
        c: (3, 2 m) [m per unit], tip position.
        mass, damping, stiffness: (m, m), the same as M d2x + D dx + K x = 0.
    """

    a: ndarray
    b: ndarray
    c: ndarray
    mass: ndarray
    damping: ndarray
    stiffness: ndarray

    def poles(self) -> ndarray:
        """Eigenvalues (2 m,) [1/s] of A, slowest first."""
        values = np.linalg.eigvals(self.a)
        return values[np.argsort(np.abs(values))]

    def frequencies(self) -> ndarray:
        """Undamped frequencies (m,) [Hz], increasing; nan where the stiffness is negative."""
        squares = np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness)).real
        squares = np.sort(squares)
        return np.sqrt(np.where(squares < 0, np.nan, squares)) / (2 * np.pi)


@kernel
def _store(vector, j, out):
    """Set column j of out (n, k) to the derivative that the imaginary part holds."""
    for i in range(len(vector)):
        out[i, j] = vector[i].imag / _STEP


@kernel
def _add_derivative(model, q, v, a, u, x, applied_only, out):
    """Add to out (n, 3 k + 1), laid out for `band`, the derivative of the residual by x.

    Columns whose rows do not overlap share one step, so the cost does not grow with n where the
    coupling is local.

    Args:
        model: Data of a model.
        q, v, a, u: Complex, without imaginary parts.
        x: One of q, v and a.
        applied_only: Whether only the part of it that loads and tendons cause.
        out: With k = bandwidth(model).
    """
    n, width = model.n, bandwidth(model)
    block, reach = model.block, model.reach
    group = min(n, (2 * reach + 1) * block)
    moved = np.empty(n, np.complex128)
    for first in range(group):
        for j in range(first, n, group):
            x[j] += _STEP * 1j
        differentiated(model, q, v, a, u, applied_only, moved)
        for j in range(first, n, group):
            home = j // block
            for i in range(max(0, (home - reach) * block), min(n, (home + reach + 1) * block)):
                out[i, j - i + width] += moved[i].imag / _STEP
            x[j] = x[j].real


@kernel
def stiffness_band(model, q, u, out):
    """Set out (n, 3 k + 1), laid out for `band`, to the stiffness at rest under inputs u."""
    still, zero = np.zeros(model.n), np.zeros(model.n, np.complex128)
    q1, u1 = q.astype(np.complex128), u.astype(np.complex128)
    out[:] = 0.0
    known = add_internal_tangent(model, q, still, 0.0, 0.0, out)
    if not known or applied_forces_turn(model):
        _add_derivative(model, q1, zero, zero, u1, q1, known, out)


@kernel
def residual_derivatives(model, q, v, a, u, by_q, by_v, by_a):
    """Set (n, n) derivatives of the residual by q, v and a."""
    n, width = model.n, bandwidth(model)
    rows = np.empty((n, 3 * width + 1))
    q1, v1, a1 = q.astype(np.complex128), v.astype(np.complex128), a.astype(np.complex128)
    u1 = u.astype(np.complex128)
    for x, by_x in ((q1, by_q), (v1, by_v), (a1, by_a)):
        rows[:] = 0.0
        _add_derivative(model, q1, v1, a1, u1, x, False, rows)
        by_x[:] = 0.0
        for i in range(n):
            for j in range(max(0, i - width), min(n, i + width + 1)):
                by_x[i, j] = rows[i, j - i + width]


@kernel
def input_derivatives(model, q, u, out):
    """Set out (n, n_inputs) to the derivative of the applied force by the inputs at u."""
    q1, u1 = q.astype(np.complex128), u.astype(np.complex128)
    force = np.empty(model.n, np.complex128)
    for j in range(len(u)):
        u1[j] += _STEP * 1j
        force[:] = 0
        add_applied(model, q1, u1, force)
        _store(force, j, out)
        u1[j] = u[j]


@kernel
def point_derivatives(model, q, out):
    """Set out (3 n_points, n) to the derivative of the material points by the coordinates."""
    points = np.empty((len(model.actuation.point_station), 3), np.complex128)
    q1 = q.astype(np.complex128)
    for j in range(len(q)):
        q1[j] += _STEP * 1j
        locate(model, q1, points)
        _store(points.ravel(), j, out)
        q1[j] = q[j]
