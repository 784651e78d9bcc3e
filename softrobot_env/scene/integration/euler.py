"""One linearly implicit Euler step of a chain, with friction of its tendons; compiled."""

import numpy as np

from softrobot_env.compile.native import jit, making

from .layout import AT
from .mujoco_functions import assign, ints, reals

#: Friction's impulses are found by as many sweeps, or until they move by no more than a share [1].
_SWEEPS, _STILL = 200, 1e-12


@jit
def euler_step(chain, forces, h, matrix, change):
    """The change (nv,) of the chain's velocities; matrix (nv, nv) holds the factor of its system.

    See `extrapolation` for the equation.
    """
    _fill_joints(chain, forces, h, matrix, change)
    _add_drives(chain, forces, h, matrix, change)
    _factorize(matrix, ints(chain.model, chain.header[AT.dof_parentid], chain.v.size))
    _solve(matrix, change, chain.v.size)
    if forces.counts[1]:
        _rub(chain.v, forces, h, matrix, change)


@jit
def _fill_joints(chain, forces, h, matrix, change):
    """Matrix (lower half) and right-hand side with the springs and dampers of the joints."""
    model, header, nv, mass = chain.model, chain.header, chain.v.size, forces.mass
    nonzero, start = ints(model, header[AT.M_rownnz], nv), ints(model, header[AT.M_rowadr], nv)
    columns = ints(model, header[AT.M_colind], mass.size)
    joints = ints(model, header[AT.dof_jntid], nv)
    damping = reals(model, header[AT.dof_damping], nv)
    stiffness = reals(model, header[AT.jnt_stiffness], joints[nv - 1] + 1)
    for i in range(nv):
        for j in range(i + 1):
            matrix[i, j] = 0.0
        for at in range(start[i], start[i] + nonzero[i]):
            matrix[i, columns[at]] = mass[at]
        k = stiffness[joints[i]]
        matrix[i, i] += h * (damping[i] + h * k)
        change[i] = h * (forces.force[i] - h * k * chain.v[i])


@jit
def _add_drives(chain, forces, h, matrix, change):
    """Add the springs of taut drives."""
    nv, v, pulls = chain.v.size, chain.v, forces.pulls
    for s in range(int(forces.counts[0])):
        rate = 0.0
        for i in range(nv):
            rate += pulls[s, i] * v[i]
        for i in range(nv):
            if pulls[s, i] == 0:
                continue
            weight = h * h * forces.stiffness[s] * pulls[s, i]
            change[i] -= weight * rate
            for j in range(i + 1):
                matrix[i, j] += weight * pulls[s, j]


# ---------------------------------------------------------------- friction


@making
def _rub(v, forces, h, factor, change):
    """Let tendons stick, or slide against their friction, at the end of an Euler step.

    Coulomb's law on the velocity at its end, by projected Gauss-Seidel sweeps over the impulses.
    """
    count, arms = int(forces.counts[1]), forces.arms
    answers = np.empty((count, v.size))
    for k in range(count):
        assign(answers[k], arms[k])
        _solve(factor, answers[k], v.size)
    rates, couplings = np.empty(count), np.empty((count, count))
    for j in range(count):
        rates[j] = _dot(arms[j], v) + _dot(arms[j], change)
        for k in range(count):
            couplings[j, k] = _dot(arms[j], answers[k])
    impulses = _impulses(couplings, rates, forces.friction, h)
    for k in range(count):
        forces.grip[k] = impulses[k] / h
        for i in range(v.size):
            change[i] -= impulses[k] * answers[k, i]


@making
def _impulses(couplings, rates, friction, h):
    """Impulses (k,), within those of a friction, that stop or slow the rates (k,).

    The rates are changed: an impulse at k slows that at j by couplings[j, k].
    """
    impulses = np.empty(rates.size)
    for k in range(rates.size):
        impulses[k] = 0.0
    for _ in range(_SWEEPS):
        moved = 0.0
        for k in range(rates.size):
            if couplings[k, k] <= 0:
                continue
            wanted = impulses[k] + rates[k] / couplings[k, k]
            most = h * friction[k]
            wanted = min(max(wanted, -most), most)
            step = wanted - impulses[k]
            impulses[k] = wanted
            moved = max(moved, abs(step) / most)
            for j in range(rates.size):
                rates[j] -= step * couplings[j, k]
        if moved < _STILL:
            break
    return impulses


# ---------------------------------------------------------------- linear algebra


@jit
def _dot(a, b):
    """Scalar product of (n,) and (n,)."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@jit
def _factorize(matrix, parents):
    """Factors L' D L of (n, n), of which the lower half is given, in its place, from the last row.

    L has ones on its diagonal, where the inverse of D is kept. Each row changes those before it as
    a whole, which takes half the time of scalar products of rows. Nothing couples the DOFs of two
    robots, each of which begins where there is no parent (n,).
    """
    start = parents.size
    for i in range(parents.size - 1, -1, -1):
        if i < start:
            start = i
            while parents[start] >= 0:
                start -= 1
        inverse = 1 / matrix[i, i]
        for j in range(start, i):
            share = matrix[i, j] * inverse
            for k in range(start, j + 1):
                matrix[j, k] -= share * matrix[i, k]
        for k in range(start, i):
            matrix[i, k] *= inverse
        matrix[i, i] = inverse


@jit
def _solve(factor, x, n):
    """x (n,) becomes the solution, by the factors of `_factorize`."""
    for i in range(n - 1, -1, -1):
        for k in range(i):
            x[k] -= factor[i, k] * x[i]
    for i in range(n):
        rest = x[i] * factor[i, i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest
