"""Linear models of a beam about a state, by complex-step differentiation."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel

from ..mechanics import (
    add_applied,
    add_differences,
    add_internal_tangent,
    applied_forces_turn,
    locate,
)
from .quaternions import row3

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
def stiffness_band(model, q, u, out):
    """Set out (n, 3 k + 1), laid out for `band`, to the stiffness at rest under inputs u."""
    still, zero = np.zeros(model.n), np.zeros(model.n, np.complex128)
    out[:] = 0.0
    known = add_internal_tangent(model, q, still, 0.0, 0.0, out)
    if not known or applied_forces_turn(model):
        motion = q.astype(np.complex128), zero, zero, u.astype(np.complex128)
        add_differences(model, motion, (1.0, 0.0, 0.0), known, _STEP * 1j, out)


@kernel
def residual_derivatives(model, q, v, a, u, out):
    """Set out (3, n, 3 k + 1), laid out for `band`, to its derivatives by q, v and a."""
    out[:] = 0.0
    q1, v1, a1 = q.astype(np.complex128), v.astype(np.complex128), a.astype(np.complex128)
    motion = q1, v1, a1, u.astype(np.complex128)
    one = np.eye(3)
    for k in range(3):
        add_differences(model, motion, row3(one, k), False, _STEP * 1j, out[k])


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
    none = np.empty((0, 3, 3), np.complex128)
    for j in range(len(q)):
        q1[j] += _STEP * 1j
        locate(model, q1, points, none)
        _store(points.ravel(), j, out)
        q1[j] = q[j]
