"""Solutions of (M + diagonal) x = r for the mass matrix M of a tree of bodies, which is never made.

Cutting off a DOF leaves the bodies beyond it with an inertia of their own, the articulated one, so
that the time grows as the number of DOFs, not as its third power (R. Featherstone 1983). All is in
MuJoCo's frame of a tree, so nothing has to be transformed: axes are rows of `cdof`, rotation first,
and inertias those of `cinert`. A body with several DOFs counts as so many, all but the last without
mass.
"""

from typing import NamedTuple

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
        axes: (nv, 6) of the DOFs.
        moments: (nv, 6), of the axes, by the inertia of all that moves with them.
        inverse: (nv,), of what resists a DOF alone.
        inertias: (nbody, 21), articulated, the lower halves of matrices by rows.
        motion: (nbody groups, 6 SIDE), of groups of columns, forces from the tips on, then
            accelerations from the base on.
    """

    parents: ndarray
    first: ndarray
    count: ndarray
    axes: ndarray
    moments: ndarray
    inverse: ndarray
    inertias: ndarray
    motion: ndarray


@jit
def groups(columns):
    """How many groups columns make."""
    return -(-columns // SIDE)


@jit
def tree_size(chain, columns):
    """Number of doubles that `tree_on` cuts."""
    motion = groups(columns) * AXIS * SIDE
    return chain.v.size * (2 * AXIS + 1) + chain.header[NBODY] * (_HALF + motion)


@making
def tree_on(chain, room, columns):
    """A tree without inertia, cut from free memory, to solve for as many columns at once."""
    model, header, nv, bodies = chain.model, chain.header, chain.v.size, chain.header[NBODY]
    return Tree(
        ints(model, header[AT.body_parentid], bodies),
        ints(model, header[AT.body_dofadr], bodies),
        ints(model, header[AT.body_dofnum], bodies),
        mj.cut(room, nv, AXIS),
        mj.cut(room, nv, AXIS),
        mj.cut(room, 1, nv)[0],
        mj.cut(room, bodies, _HALF),
        mj.cut(room, bodies * groups(columns), AXIS * SIDE),
    )


@jit
def factorize(tree, axes, inertias, diagonal):
    """Prepare `solve`.

    Args:
        tree: The tree.
        axes, inertias: (6 nv,), (10 nbody,), of MuJoCo.
        diagonal: (nv,), what resists each DOF besides.
    """
    for b in range(1, tree.parents.size):
        _fill(tree.inertias[b], inertias, INERTIA * b)
    for b in range(tree.parents.size - 1, 0, -1):
        inertia = tree.inertias[b]
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            axis, moment = tree.axes[i], tree.moments[i]
            for r in range(AXIS):
                axis[r] = axes[AXIS * i + r]
            tree.inverse[i] = _cut_off(inertia, axis, moment, diagonal[i])
        if tree.parents[b]:
            beyond = tree.inertias[tree.parents[b]]
            for k in range(_HALF):
                beyond[k] += inertia[k]


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
def _fill(half, inertias, at):
    """The lower half (21,) of the matrix of an inertia, the ten numbers from a place on."""
    x, y, z, mass = inertias[at + 6], inertias[at + 7], inertias[at + 8], inertias[at + 9]
    for k in range(_HALF):
        half[k] = 0.0
    half[0], half[2], half[5] = inertias[at], inertias[at + 1], inertias[at + 2]
    half[1], half[3], half[4] = inertias[at + 3], inertias[at + 4], inertias[at + 5]
    half[7], half[8] = z, -y
    half[10], half[12] = -z, x
    half[15], half[16] = y, -x
    half[9], half[14], half[20] = mass, mass, mass


@jit
def solve(tree, x, count):
    """Let the first columns of x (nv, groups SIDE) be the solutions for them."""
    if count == 1:
        _solve_one(tree, x)
        return
    bodies, motion, number = tree.parents.size, tree.motion, groups(count)
    for k in range(bodies * number):
        for r in range(AXIS * SIDE):
            motion[k, r] = 0.0
    for b in range(bodies - 1, 0, -1):
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            ways = tree.axes[i], tree.moments[i], 1.0, tree.inverse[i]
            for g in range(number):
                most = min(SIDE, count - g * SIDE)
                _pass(x[i, g * SIDE :], motion[b * number + g], ways, most)
        for g in range(number if tree.parents[b] else 0):
            below, here = motion[tree.parents[b] * number + g], motion[b * number + g]
            for r in range(AXIS * SIDE):
                below[r] += here[r]
    for b in range(1, bodies):
        for g in range(number):
            below, here = motion[tree.parents[b] * number + g], motion[b * number + g]
            for r in range(AXIS * SIDE):
                here[r] = below[r]
        for i in range(tree.first[b], tree.first[b] + tree.count[b]):
            ways = tree.moments[i], tree.axes[i], tree.inverse[i], 1.0
            for g in range(number):
                most = min(SIDE, count - g * SIDE)
                _pass(x[i, g * SIDE :], motion[b * number + g], ways, most)


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
    for b in range(bodies):
        for r in range(AXIS):
            motion[b, r] = 0.0
    for b in range(bodies - 1, 0, -1):
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            x[i, 0] -= _product(tree.axes[i], motion[b])
            _add(motion[b], x[i, 0] * tree.inverse[i], tree.moments[i])
        if tree.parents[b]:
            _add(motion[tree.parents[b]], 1.0, motion[b])
    for b in range(1, bodies):
        for r in range(AXIS):
            motion[b, r] = motion[tree.parents[b], r]
        for i in range(tree.first[b], tree.first[b] + tree.count[b]):
            x[i, 0] = (x[i, 0] - _product(tree.moments[i], motion[b])) * tree.inverse[i]
            _add(motion[b], x[i, 0], tree.axes[i])


@jit
def _product(a, b):
    """Scalar product of the first six."""
    total = 0.0
    for r in range(AXIS):
        total += a[r] * b[r]
    return total


@jit
def _add(a, share, b):
    """Add a share of the first six to those of a."""
    for r in range(AXIS):
        a[r] += share * b[r]
