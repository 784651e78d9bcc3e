"""Solutions of (M + diagonal) x = r for the mass matrix M of a tree of bodies, which is never made.

Cutting off a DOF leaves the bodies beyond it with an inertia of their own, the articulated one, so
that the time grows as the number of DOFs, not as its third power (R. Featherstone 1983). All is in
MuJoCo's frame of a tree, so nothing has to be transformed: axes are rows of `cdof`, rotation first,
and inertias those of `cinert`. A body with several DOFs counts as so many, all but the last without
mass.

Bodies without a branch between them make a run. What is passed from body to body stays in one row
of memory along it, and is added up or copied where runs meet.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import mujoco_functions as mj
from .layout import AT, NBODY
from .mujoco_functions import ints

#: Numbers of an axis, of an inertia as MuJoCo has it, and of the lower half of its matrix.
AXIS, INERTIA, _HALF = 6, 10, 21

#: Columns of a group: they are solved for side by side, in one stroke of the processor.
SIDE = 8


class Tree(NamedTuple):
    """A chain's bodies, and what is left of its mass matrix.

    Attributes:
        parents, first, count: (nbody,), of a body its parent, first DOF and number of DOFs.
        run: (nbody,), see `runs`.
        axes: (nv, 6) of the DOFs.
        moments: (nv, 6), of the axes, by the inertia of all that moves with them.
        inverse: (nv,), of what resists a DOF alone.
        inertias: (runs, 21), articulated, the lower halves of matrices by rows.
        motion: (runs groups, 6 SIDE), of groups of columns, forces from the tips on, then
            accelerations from the base on.
    """

    parents: ndarray
    first: ndarray
    count: ndarray
    run: ndarray
    axes: ndarray
    moments: ndarray
    inverse: ndarray
    inertias: ndarray
    motion: ndarray


def runs(parents: ndarray) -> ndarray:
    """The run (nbody,) of each body by the parents (nbody,); of the world, how many there are."""
    children, count = np.bincount(parents[1:], minlength=len(parents)), 0
    out = np.zeros_like(parents)
    for body, parent in enumerate(parents[1:].tolist(), start=1):
        if parent and children[parent] == 1:
            out[body] = out[parent]
        else:
            out[body], count = count, count + 1
    out[0] = count
    return out


@jit
def groups(columns):
    """How many groups columns make."""
    return -(-columns // SIDE)


@jit
def tree_size(chain, columns):
    """Number of doubles that `tree_on` cuts."""
    motion = groups(columns) * AXIS * SIDE
    return chain.v.size * (2 * AXIS + 1) + chain.runs[0] * (_HALF + motion)


@making
def tree_on(chain, room, columns):
    """A tree without inertia, cut from free memory, to solve for as many columns at once."""
    model, header, nv, bodies = chain.model, chain.header, chain.v.size, chain.header[NBODY]
    rows = chain.runs[0]
    return Tree(
        ints(model, header[AT.body_parentid], bodies),
        ints(model, header[AT.body_dofadr], bodies),
        ints(model, header[AT.body_dofnum], bodies),
        chain.runs,
        mj.cut(room, nv, AXIS),
        mj.cut(room, nv, AXIS),
        mj.cut(room, 1, nv)[0],
        mj.cut(room, rows, _HALF),
        mj.cut(room, rows * groups(columns), AXIS * SIDE),
    )


@jit
def factorize(tree, axes, inertias, diagonal):
    """Prepare `solve`.

    Args:
        tree: The tree.
        axes, inertias: (6 nv,), (10 nbody,), of MuJoCo.
        diagonal: (nv,), what resists each DOF besides.
    """
    for r in range(tree.run[0]):
        for k in range(_HALF):
            tree.inertias[r, k] = 0.0
    for b in range(tree.parents.size - 1, 0, -1):
        inertia, beyond = tree.inertias[tree.run[b]], tree.parents[b]
        _load(inertia, inertias, INERTIA * b)
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            axis, moment = tree.axes[i], tree.moments[i]
            for r in range(AXIS):
                axis[r] = axes[AXIS * i + r]
            tree.inverse[i] = _cut_off(inertia, axis, moment, diagonal[i])
        if beyond and tree.run[beyond] != tree.run[b]:
            joined = tree.inertias[tree.run[beyond]]
            for k in range(_HALF):
                joined[k] += inertia[k]


@jit
def _cut_off(half, axis, moment, diagonal):
    """Take what gives way about an axis from an inertia; one over what resists there."""
    a, b, c, d, e, f = axis[0], axis[1], axis[2], axis[3], axis[4], axis[5]
    # Written out, which takes two thirds of the time of loops.
    moment[0] = half[0] * a + half[1] * b + half[3] * c + half[6] * d + half[10] * e + half[15] * f
    moment[1] = half[1] * a + half[2] * b + half[4] * c + half[7] * d + half[11] * e + half[16] * f
    moment[2] = half[3] * a + half[4] * b + half[5] * c + half[8] * d + half[12] * e + half[17] * f
    moment[3] = half[6] * a + half[7] * b + half[8] * c + half[9] * d + half[13] * e + half[18] * f
    moment[4] = (
        half[10] * a + half[11] * b + half[12] * c + half[13] * d + half[14] * e + half[19] * f
    )
    moment[5] = (
        half[15] * a + half[16] * b + half[17] * c + half[18] * d + half[19] * e + half[20] * f
    )
    inverse = 1 / (diagonal + _product(axis, moment))
    at = 0
    for r in range(AXIS):
        share = moment[r] * inverse
        for k in range(r + 1):
            half[at] -= share * moment[k]
            at += 1
    return inverse


@jit
def _load(half, inertias, at):
    """Add a body's inertia, ten numbers from a place on, to the lower half (21,) of a matrix."""
    x, y, z, mass = inertias[at + 6], inertias[at + 7], inertias[at + 8], inertias[at + 9]
    half[0] += inertias[at]
    half[1] += inertias[at + 3]
    half[2] += inertias[at + 1]
    half[3] += inertias[at + 4]
    half[4] += inertias[at + 5]
    half[5] += inertias[at + 2]
    half[7] += z
    half[8] -= y
    half[10] -= z
    half[12] += x
    half[15] += y
    half[16] -= x
    half[9] += mass
    half[14] += mass
    half[20] += mass


@jit
def solve(tree, x, count):
    """Let the first columns of x (nv, groups SIDE) be the solutions for them."""
    if count == 1:
        _solve_one(tree, x)
        return
    bodies, motion, number = tree.parents.size, tree.motion, groups(count)
    for k in range(tree.run[0] * number):
        for r in range(AXIS * SIDE):
            motion[k, r] = 0.0
    for b in range(bodies - 1, 0, -1):
        own, beyond = tree.run[b], tree.parents[b]
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            ways = tree.axes[i], tree.moments[i], 1.0, tree.inverse[i]
            for g in range(number):
                most = min(SIDE, count - g * SIDE)
                _pass(x[i, g * SIDE :], motion[own * number + g], ways, most)
        if beyond and tree.run[beyond] != own:
            for g in range(number):
                joined, here = motion[tree.run[beyond] * number + g], motion[own * number + g]
                for r in range(AXIS * SIDE):
                    joined[r] += here[r]
    for b in range(1, bodies):
        own, before = tree.run[b], tree.parents[b]
        for g in range(number if tree.run[before] != own else 0):
            here = motion[own * number + g]
            for r in range(AXIS * SIDE):
                here[r] = motion[tree.run[before] * number + g, r] if before else 0.0
        for i in range(tree.first[b], tree.first[b] + tree.count[b]):
            ways = tree.moments[i], tree.axes[i], tree.inverse[i], 1.0
            for g in range(number):
                most = min(SIDE, count - g * SIDE)
                _pass(x[i, g * SIDE :], motion[own * number + g], ways, most)


@jit
def _pass(x, motion, ways, count):
    """Cross a DOF with a group: what comes along one way changes x, and that comes on by another.

    Args:
        x: The columns at the DOF.
        motion: (6 SIDE,), on the body.
        ways: Vectors (6,) of what counts of the motion and of what x adds to it, factors of both.
        count: Columns.
    """
    seen, added, scale, share = ways
    a, b, c, d, e, f = seen[0], seen[1], seen[2], seen[3], seen[4], seen[5]
    g, h, i, j, k, m = added[0], added[1], added[2], added[3], added[4], added[5]
    for n in range(count):
        turned = a * motion[n] + b * motion[n + SIDE] + c * motion[n + 2 * SIDE]
        moved = d * motion[n + 3 * SIDE] + e * motion[n + 4 * SIDE] + f * motion[n + 5 * SIDE]
        y = scale * (x[n] - (turned + moved))
        x[n] = y
        y *= share
        motion[n] += y * g
        motion[n + SIDE] += y * h
        motion[n + 2 * SIDE] += y * i
        motion[n + 3 * SIDE] += y * j
        motion[n + 4 * SIDE] += y * k
        motion[n + 5 * SIDE] += y * m


@jit
def _solve_one(tree, x):
    """As `solve`, for the first column alone."""
    bodies, motion = tree.parents.size, tree.motion
    for k in range(tree.run[0]):
        for r in range(AXIS):
            motion[k, r] = 0.0
    for b in range(bodies - 1, 0, -1):
        own, beyond = motion[tree.run[b]], tree.parents[b]
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            x[i, 0] -= _product(tree.axes[i], own)
            _add(own, x[i, 0] * tree.inverse[i], tree.moments[i])
        if beyond and tree.run[beyond] != tree.run[b]:
            _add(motion[tree.run[beyond]], 1.0, own)
    for b in range(1, bodies):
        own, before = motion[tree.run[b]], tree.parents[b]
        if tree.run[before] != tree.run[b]:
            for r in range(AXIS):
                own[r] = motion[tree.run[before], r] if before else 0.0
        for i in range(tree.first[b], tree.first[b] + tree.count[b]):
            x[i, 0] = (x[i, 0] - _product(tree.moments[i], own)) * tree.inverse[i]
            _add(own, x[i, 0], tree.axes[i])


@jit
def _product(a, b):
    """Scalar product of the first six."""
    # Not one after the other, as each would wait for the one before.
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]) + (a[4] * b[4] + a[5] * b[5])


@jit
def _add(a, share, b):
    """Add a share of the first six to those of a."""
    for r in range(AXIS):
        a[r] += share * b[r]
