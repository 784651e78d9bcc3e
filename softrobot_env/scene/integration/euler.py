"""One linearly implicit Euler step of a chain, with friction of its tendons; compiled."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import articulated
from . import mujoco_functions as mj
from .articulated import Tree, tree_on, tree_size
from .layout import AT, NTENDON
from .motors import move, tension_after, turn
from .mujoco_functions import assign, ints, reals

#: Friction's impulses are found by as many sweeps, or until they move by no more than a share [1].
_SWEEPS, _STILL = 200, 1e-12

#: Motors are found in as many rounds at most, or until tensions agree to a share [1].
_ROUNDS, _AGREES = 30, 1e-10

_SMALLEST = 1e-300  # N


class System(NamedTuple):
    """What the change of velocities in an Euler step solves.

    Attributes:
        tree: Mass, springs and dampers of the joints.
        diagonal: (nv,), their springs and dampers.
        answers: (1 + nu, nv), change by all else, and by impulses of the springs of taut drives.
        couplings: (nu, nu), factors of what such impulses need for each other.
        impulses: (nu,), such impulses.
        yields, behind: (nu,) [N/m], [m/s], stiffness of these springs with their motors, and rates
            of the tendons at which they had no impulse.
        rates, expected: (nu,) [m/s], [N], where the motors were looked at, and tensions there.
    """

    tree: Tree
    diagonal: ndarray
    answers: ndarray
    couplings: ndarray
    impulses: ndarray
    yields: ndarray
    behind: ndarray
    rates: ndarray
    expected: ndarray


@jit
def system_size(chain):
    """Number of doubles that `system_on` cuts."""
    nv, nu = chain.v.size, chain.ctrl.size
    return tree_size(chain, _rows(chain)) + nv + (1 + nu) * (nv + nu) + 4 * nu


@making
def system_on(chain, room):
    """Arrays for `euler_step`, cut from free memory."""
    nv, nu = chain.v.size, chain.ctrl.size
    own = mj.cut(room, 5, nu)
    return System(
        tree_on(chain, room, _rows(chain)),
        mj.cut(room, 1, nv)[0],
        mj.cut(room, 1 + nu, nv),
        mj.cut(room, nu, nu),
        own[0],
        own[1],
        own[2],
        own[3],
        own[4],
    )


@jit
def _rows(chain):
    """Most rows that are solved for at once."""
    return max(1 + chain.ctrl.size, chain.header[NTENDON])


@jit
def euler_step(chain, forces, h, system, change):
    """The change (nv,) of the chain's velocities, by horns that stay.

    See `extrapolation` for the equation. A drive's spring acts by an impulse h^2 k times how fast
    its tendon would be at the step's end, which is found for all together.
    """
    springs, answers = int(forces.counts[0]), system.answers
    _fill_joints(chain, forces, h, system.diagonal, answers[0])
    for s in range(springs):
        assign(answers[1 + s], forces.pulls[s])
    articulated.factorize(system.tree, forces.axes, forces.inertias, system.diagonal)
    articulated.solve(system.tree, answers, 1 + springs)
    for s in range(springs):
        system.yields[s], system.behind[s] = forces.stiffness[s], 0.0
    _act(chain.v, forces, h, system, change)


@jit
def _act(v, forces, h, system, change):
    """Let springs of drives, and friction, act on what all else changes (nv,)."""
    springs = int(forces.counts[0])
    assign(change, system.answers[0])
    if springs:
        _couple_drives(forces, h, system)
        for s in range(springs):
            rate = _dot(forces.pulls[s], v) + _dot(forces.pulls[s], change)
            system.impulses[s] = rate - system.behind[s]
        _pull(system, springs, change)
    if forces.counts[1]:
        _rub(v, forces, h, system, change)


@jit
def turn_motors(v, forces, h, system, motors, change):
    """Let motors move on by an Euler step, and so correct what `euler_step` has found.

    By Newton's method on the rates of the tendons at the end, from those with horns that stay. By
    pieces all is linear, so that it ends when no motor changes between sticking, its limits and
    in between.
    """
    springs, rates, expected = int(forces.counts[0]), system.rates, system.expected
    for s in range(springs):
        rates[s] = _dot(forces.pulls[s], v) + _dot(forces.pulls[s], change)
    for _ in range(_ROUNDS):
        for s in range(springs):
            d, tension = int(forces.drives[s]), forces.tension[int(forces.drives[s])]
            pull = (tension, forces.stiffness[s], rates[s])
            turning, system.yields[s] = turn(motors, d, h, pull)
            expected[s] = tension_after(motors, d, h, pull, turning)
            system.behind[s] = rates[s] + (expected[s] - tension) / (h * system.yields[s])
        _act(v, forces, h, system, change)
        off = 0.0
        for s in range(springs):
            d, tension = int(forces.drives[s]), forces.tension[int(forces.drives[s])]
            rate = _dot(forces.pulls[s], v) + _dot(forces.pulls[s], change)
            pull = (tension, forces.stiffness[s], rate)
            found = tension_after(motors, d, h, pull, turn(motors, d, h, pull)[0])
            linear = expected[s] - h * system.yields[s] * (rate - rates[s])
            off = max(off, abs(found - linear) / (abs(found) + abs(tension) + _SMALLEST))
            rates[s] = rate
        if off < _AGREES:
            break
    taut = 0
    for d in range(motors.turned.size):
        pull = (forces.tension[d], 0.0, 0.0)
        if taut < springs and int(forces.drives[taut]) == d:
            pull = (forces.tension[d], forces.stiffness[taut], rates[taut])
            taut += 1
        move(motors, d, h, turn(motors, d, h, pull)[0])


@jit
def _fill_joints(chain, forces, h, diagonal, change):
    """What resists each DOF beside the mass, and right-hand side."""
    model, header, nv = chain.model, chain.header, chain.v.size
    joints = ints(model, header[AT.dof_jntid], nv)
    armature = reals(model, header[AT.dof_armature], nv)
    damping = reals(model, header[AT.dof_damping], nv)
    stiffness = reals(model, header[AT.jnt_stiffness], joints[nv - 1] + 1)
    for i in range(nv):
        k = stiffness[joints[i]]
        diagonal[i] = armature[i] + h * (damping[i] + h * k)
        change[i] = h * (forces.force[i] - h * k * chain.v[i])


@jit
def _couple_drives(forces, h, system):
    """Factors of the couplings of taut drives' springs."""
    springs = int(forces.counts[0])
    for s in range(springs):
        for k in range(s + 1):
            system.couplings[s, k] = _dot(forces.pulls[k], system.answers[1 + s])
        system.couplings[s, s] += 1 / (h * h * system.yields[s])
    _factorize(system.couplings, springs)


@jit
def _pull(system, springs, change):
    """Let springs of drives act on a change (nv,), by the rates of their tendons in `impulses`."""
    _solve(system.couplings, system.impulses, springs)
    for s in range(springs):
        for i in range(change.size):
            change[i] -= system.impulses[s] * system.answers[1 + s, i]


# ---------------------------------------------------------------- friction


@making
def _rub(v, forces, h, system, change):
    """Let tendons stick, or slide against their friction, at the end of an Euler step.

    Coulomb's law on the velocity at its end, by projected Gauss-Seidel sweeps over the impulses.
    """
    count, arms, springs = int(forces.counts[1]), forces.arms, int(forces.counts[0])
    answers = np.empty((count, v.size))
    for k in range(count):
        assign(answers[k], arms[k])
    articulated.solve(system.tree, answers, count)
    for k in range(count):
        for s in range(springs):
            system.impulses[s] = _dot(forces.pulls[s], answers[k])
        _pull(system, springs, answers[k])
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
def _factorize(matrix, n):
    """Factors L' D L of (n, n), of which the lower half is given, in its place, from the last row.

    L has ones on its diagonal, where the inverse of D is kept.
    """
    for i in range(n - 1, -1, -1):
        inverse = 1 / matrix[i, i]
        for j in range(i):
            share = matrix[i, j] * inverse
            for k in range(j + 1):
                matrix[j, k] -= share * matrix[i, k]
        for k in range(i):
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
