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
            local = add(position(u * length, c, phi), _arm(c, phi, points[m]))
            store(out[k], add(x, to_world(axes, local)))
        c = stumpff(dot3(whole, whole))
        x = add(x, to_world(axes, position(length, c, whole)))
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
                add_wrench(u, length, part, phi, force, moment, row)
        axes = compose(axes, c, whole)


# ---------------------------------------------------------------- continuous channels


@kernel
def channel_lengths(model, q, out):
    """Set out (n_channels,) [m] to the lengths of the continuous channels."""
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    channels = model.channels
    for k in range(len(out)):
        total, left = 0 * q[0], channels[k, 0]
        for i in range(len(turns)):
            part = min(max(left - i, 0.0), 1.0)
            stretch, twist = _channel_strain(model.length, vector(turns[i, 0]), channels[k])
            total += part * np.sqrt(stretch * stretch + twist * twist)
        out[k] = total


@kernel
def add_channel_forces(model, q, tension, out):
    """Add to out (n,) the generalised force of tensions (n_channels,) [N] in the channels.

    The negative gradient of tension times channel length.
    """
    turns = np.empty((model.pieces, 1, 3), q.dtype)
    set_rotations(model.block, model.length, q, turns[:, 0])
    channels = model.channels
    for k in range(len(tension)):
        x, y, zero = channels[k, 1], channels[k, 2], 0 * q[0]
        for i in range(len(turns)):
            part = min(max(channels[k, 0] - i, 0.0), 1.0)
            stretch, twist = _channel_strain(model.length, vector(turns[i, 0]), channels[k])
            pull = tension[k] * part / np.sqrt(stretch * stretch + twist * twist)
            along, around = pull * stretch, pull * twist * np.sqrt(x * x + y * y)
            load = (zero - y * along, zero + x * along, zero - around)
            add_generalised(model.block, model.length, i, load, out)


@kernel
def _channel_strain(length, phi, channel):
    """Axial and circumferential part of a piece's channel [m], at the place of the section.

    A channel at the place r of the section has the tangent e_z + kappa x r.
    """
    x, y = channel[1], channel[2]
    return length + phi[0] * y - phi[1] * x, phi[2] * np.sqrt(x * x + y * y)
