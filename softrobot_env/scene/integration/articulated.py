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


class Tree(NamedTuple):
    """A chain's bodies, and what is left of its mass matrix.

    Attributes:
        parents, first, count: (nbody,), of a body its parent, first DOF and number of DOFs.
        axes: (nv, 6) of the DOFs.
        moments: (nv, 6), of the axes, by the inertia of all that moves with them.
        inverse: (nv,), of what resists a DOF alone.
        inertias: (nbody, 21), articulated, the lower halves of matrices by rows.
        motion: (nbody rows, 6), forces from the tips on, then accelerations from the base on.
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
def tree_size(chain, rows):
    """Number of doubles that `tree_on` cuts."""
    return chain.v.size * (2 * AXIS + 1) + chain.header[NBODY] * (_HALF + rows * AXIS)


@making
def tree_on(chain, room, rows):
    """A tree without inertia, cut from free memory, to solve for as many rows at once."""
    model, header, nv, bodies = chain.model, chain.header, chain.v.size, chain.header[NBODY]
    return Tree(
        ints(model, header[AT.body_parentid], bodies),
        ints(model, header[AT.body_dofadr], bodies),
        ints(model, header[AT.body_dofnum], bodies),
        mj.cut(room, nv, AXIS),
        mj.cut(room, nv, AXIS),
        mj.cut(room, 1, nv)[0],
        mj.cut(room, bodies, _HALF),
        mj.cut(room, bodies * rows, AXIS),
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
    """Let the first rows of x (rows, nv) be the solutions for them.

    All at once: one alone waits for its own sums at every body.
    """
    bodies, motion = tree.parents.size, tree.motion
    for k in range(bodies * count):
        for r in range(AXIS):
            motion[k, r] = 0.0
    for b in range(bodies - 1, 0, -1):
        for i in range(tree.first[b] + tree.count[b] - 1, tree.first[b] - 1, -1):
            for k in range(count):
                force = motion[b * count + k]
                x[k, i] -= _product(tree.axes[i], force)
                _add(force, x[k, i] * tree.inverse[i], tree.moments[i])
        if tree.parents[b]:
            for k in range(count):
                _add(motion[tree.parents[b] * count + k], 1.0, motion[b * count + k])
    for b in range(1, bodies):
        for k in range(count):
            mj.assign(motion[b * count + k], motion[tree.parents[b] * count + k])
        for i in range(tree.first[b], tree.first[b] + tree.count[b]):
            for k in range(count):
                acceleration = motion[b * count + k]
                x[k, i] = (x[k, i] - _product(tree.moments[i], acceleration)) * tree.inverse[i]
                _add(acceleration, x[k, i], tree.axes[i])


@jit
def _product(a, b):
    """Scalar product of (6,) and (6,)."""
    total = 0.0
    for r in range(AXIS):
        total += a[r] * b[r]
    return total


@jit
def _add(a, share, b):
    """Add a share of (6,) to (6,)."""
    for r in range(AXIS):
        a[r] += share * b[r]
