"""Forces on the piecewise constant curvature model, in kernels; data as in `pcc.PccData`."""

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.beams.numerics.quaternions import add, cross, dot3, scaled, store, vector
from softrobot_env.beams.pcc.constant_strain import (
    compose,
    position,
    stumpff,
    to_axes,
    to_world,
    turn,
)
from softrobot_env.beams.pcc.dynamics import (
    COLUMNS,
    END_FORCE,
    ROTATION,
    STUMPFF,
    add_generalised,
    add_wrench,
    clamp,
    gather,
    set_rotations,
)


@kernel
def locate(model, q, out):
    """Set out (n_points, 3) [m] to the material points of the actuation."""
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    _locate(model.length, model.first[1], model.points, turns, out)


@kernel
def _locate(length, first, points, turns, out):
    axes, x = clamp(0 * turns[0, 0, 0])
    for i in range(len(turns)):
        whole = vector(turns[i, 0])
        for m in range(first[i], first[i + 1]):
            k = int(points[m, 3])
            u = points[m, 0]
            phi = scaled(u, whole)
            c = stumpff(dot3(phi, phi))
            local = add(position(u * length[i], c, phi), _arm(c, phi, points[m]))
            store(out[k], add(x, to_world(axes, local)))
        c = stumpff(dot3(whole, whole))
        x = add(x, to_world(axes, position(length[i], c, whole)))
        axes = compose(axes, c, whole)


@kernel
def _arm(c, phi, point):
    """Place of a point [m] relative to its section's centre, in the frame of the piece's start."""
    zero = 0 * c[0]
    return turn(c, phi, (zero + point[1], zero + point[2], zero))


@kernel
def load_axes(model, q, out):
    """Set out (n_loads, 3, 3) to the axes, as columns, of the cross-sections of the loads."""
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    _load_axes(model.first[1], model.points, turns, out)


@kernel
def _load_axes(first, points, turns, out):
    axes, _ = clamp(0 * turns[0, 0, 0])
    for i in range(len(turns)):
        whole = vector(turns[i, 0])
        for m in range(first[i], first[i + 1]):
            k = int(points[m, 3])
            if k < len(out):
                phi = scaled(points[m, 0], whole)
                ex, ey, ez = compose(axes, stumpff(dot3(phi, phi)), phi)
                for d in range(3):
                    out[k, d, 0], out[k, d, 1], out[k, d, 2] = ex[d], ey[d], ez[d]
        axes = compose(axes, stumpff(dot3(whole, whole)), whole)


@kernel
def add_forces(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_points, 3) [N] on the points."""
    _add_wrenches(model, q, forces, 0, out)


@kernel
def add_moments(model, q, moments, out):
    """Add to out (n,) the generalised force of moments (n_loads, 3) [N m] at the loads."""
    _add_wrenches(model, q, moments, 1, out)


@kernel
def _add_wrenches(model, q, vectors, kind, out):
    """Add the generalised force of forces (kind 0) or moments (1) (k, 3) on the first k points."""
    wrenches = np.zeros((len(vectors), 2, 3), out.dtype)
    for k in range(len(vectors)):
        store(wrenches[k, kind], vector(vectors[k]))
    work = np.empty((model.pieces, COLUMNS, 3), out.dtype)
    set_rotations(model.block, model.length, q, work[:, ROTATION])
    _collect(model.length, model.first[1], model.points, wrenches, work)
    gather(model.block, model.length, work, out)


@kernel
def _collect(length, first, points, wrenches, work):
    """Fill work for `gather`, given the rotation vectors in its first columns."""
    zero = 0 * work[0, 0, 0]
    axes, _ = clamp(zero)
    for i in range(len(work)):
        row = work[i]
        whole = vector(row[ROTATION])
        c = stumpff(dot3(whole, whole))
        store(row[STUMPFF], c[:3])
        store(row[STUMPFF + 1], c[3:6])
        for d in range(END_FORCE, COLUMNS):
            store(row[d], (zero, zero, zero))
        for m in range(first[i], first[i + 1]):
            k = int(points[m, 3])
            if k < len(wrenches):
                u = points[m, 0]
                phi = scaled(u, whole)
                part = stumpff(dot3(phi, phi))
                there = compose(axes, part, phi)
                arm = (zero + points[m, 1], zero + points[m, 2], zero)
                force = to_axes(there, vector(wrenches[k, 0]))
                moment = add(cross(arm, force), to_axes(there, vector(wrenches[k, 1])))
                add_wrench(u, length[i], part, phi, force, moment, row)
        axes = compose(axes, c, whole)


# ---------------------------------------------------------------- continuous channels


@kernel
def channel_lengths(model, q, out):
    """Set out (n_channels,) [m] to the lengths of the continuous channels."""
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    for k in range(len(out)):
        out[k] = 0 * q[0]
    first, samples = model.first_sample, model.samples
    for i in range(len(turns)):
        strain = scaled(1 / model.length[i], vector(turns[i, 0]))
        for m in range(first[i], first[i + 1]):
            x = _channel_tangent(strain, samples[m])
            out[model.sampled[m]] += samples[m, 0] * np.sqrt(dot3(x, x))


@kernel
def add_channel_forces(model, q, tension, out):
    """Add to out (n,) the generalised force of tensions (n_channels,) [N] in the channels.

    The negative gradient of tension times channel length.
    """
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    first, samples = model.first_sample, model.samples
    for i in range(len(turns)):
        strain = scaled(1 / model.length[i], vector(turns[i, 0]))
        zero = 0 * q[0]
        load = (zero, zero, zero)
        for m in range(first[i], first[i + 1]):
            x = _channel_tangent(strain, samples[m])
            pull = tension[model.sampled[m]] * samples[m, 0] / np.sqrt(dot3(x, x))
            load = add(load, scaled(-pull, _lever(samples[m], x)))
        load = scaled(1 / model.length[i], load)
        add_generalised(model.block, model.length, i, load, out)


@kernel
def _channel_tangent(strain, sample):
    """Tangent e_z + r' + kappa x r of a channel at r = (x, y) in a piece of strain kappa."""
    x, y = sample[1], sample[2]
    return (
        sample[3] - strain[2] * y,
        sample[4] + strain[2] * x,
        1 + strain[0] * y - strain[1] * x,
    )


@kernel
def _lever(sample, tangent):
    """Place of a channel in its section times its tangent: (x, y, 0) x tangent."""
    x, y = sample[1], sample[2]
    return y * tangent[2], -x * tangent[2], x * tangent[1] - y * tangent[0]
