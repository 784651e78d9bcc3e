"""Kernels of the Cosserat rod's material points, loads and tendon channels."""

import numpy as np

from softrobot_env.beams.cosserat.dynamics import (
    add_moment,
    curvatures,
    first_vertex,
    pull_ends,
    section_at,
    sections,
    segment_vector,
    vertex_at,
    vertex_index,
)
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.beams.numerics.quaternions import (
    add,
    add_scaled,
    cross,
    dot3,
    dot4,
    quaternion_at,
    relative,
    rotate,
    rotate_back,
    row3,
    row4,
    scaled,
    times_vector,
    unit,
    weighting,
)


@kernel
def locate(model, q, out):
    """Set out (n_points, 3) [m] to the material points."""
    offset = model.actuation.point_offset
    for m in range(len(offset)):
        n, share = model.vertex[m], model.share[m]
        low, high = vertex_at(q, model.base, n), vertex_at(q, model.base, n + 1)
        for i in range(3):
            out[m, i] = (1 - share) * low[i] + share * high[i]
        out[m, 2] += model.shift[m]
        if offset[m, 0] != 0 or offset[m, 1] != 0:
            k, weight = model.section[m], model.weight[m]
            _add_director(out, m, 1 - weight, section_at(q, k), offset)
            _add_director(out, m, weight, section_at(q, k + 1), offset)


@kernel
def _add_director(out, m, weight, frame, offset):
    zero = frame[0] * 0
    add_scaled(out, m, weight, rotate(frame, (zero + offset[m, 0], zero + offset[m, 1], zero)))


@kernel
def add_forces(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_points, 3) [N] on the points."""
    offset = model.actuation.point_offset
    for m in range(len(offset)):
        n, share, force = model.vertex[m], model.share[m], row3(forces, m)
        low, high = vertex_index(model.base, n), vertex_index(model.base, n + 1)
        for i in range(3):
            if low >= 0:
                out[low + i] += (1 - share) * force[i]
            out[high + i] += share * force[i]
        if offset[m, 0] != 0 or offset[m, 1] != 0:
            k, weight = model.section[m], model.weight[m]
            _add_lever(q, k, 1 - weight, force, offset, m, out)
            _add_lever(q, k + 1, weight, force, offset, m, out)


@kernel
def _add_lever(q, k, weight, force, offset, m, out):
    """Add to out (n,) the share of a force on offset m that turns segment k."""
    if k >= 0 and weight != 0:
        x, y, z = rotate_back(section_at(q, k), force)
        a, b = offset[m, 0], offset[m, 1]
        add_torque(q, k, weight, (b * z, -a * z, a * y - b * x), out)


@kernel
def add_torque(q, k, factor, torque, out):
    """Add to out (n,) factor times a torque [N m] on segment k, in its frame."""
    p = quaternion_at(q, 7 * k + 3)
    scale, row = 2 * factor / dot4(p, p), times_vector(p, torque)
    for i in range(4):
        out[7 * k + 3 + i] += scale * row[i]


@kernel
def load_axes(model, q, out):
    """Set out (n_loads, 3, 3) to the orientation of the loads' cross-sections.

    The normalised mean of the neighbouring quaternions, extrapolated beyond the last.
    """
    zero = q[0] * 0
    for m in range(len(out)):
        k, weight = model.section[m], model.weight[m]
        low, high = section_at(q, k), section_at(q, k + 1)
        if dot4(low, high).real < 0:
            high = (-high[0], -high[1], -high[2], -high[3])
        frame = unit(
            (
                (1 - weight) * low[0] + weight * high[0],
                (1 - weight) * low[1] + weight * high[1],
                (1 - weight) * low[2] + weight * high[2],
                (1 - weight) * low[3] + weight * high[3],
            )
        )
        e_x = rotate(frame, (zero + 1, zero, zero))
        e_y = rotate(frame, (zero, zero + 1, zero))
        e_z = cross(e_x, e_y)
        for i in range(3):
            out[m, i, 0], out[m, i, 1], out[m, i, 2] = e_x[i], e_y[i], e_z[i]


@kernel
def add_moments(model, q, moments, out):
    """Add to out (n,) the generalised force of moments (n_loads, 3) [N m] at the loads."""
    for m in range(len(moments)):
        k, weight, moment = model.section[m], model.moment_weight[m], row3(moments, m)
        if k >= 0 and weight != 1:
            add_torque(q, k, 1 - weight, rotate_back(section_at(q, k), moment), out)
        if weight != 0:
            add_torque(q, k + 1, weight, rotate_back(section_at(q, k + 1), moment), out)


# ---------------------------------------------------------------- channels


@kernel
def _channel_vector(t, kappa, k, sample):
    """Tangent of a channel in segment k, in its frame: t + r' + kappa x r, r = (x, y, 0).

    The rod's tangent t there is e_z and shares of the segment's shear and stretch.
    """
    size = sample[0] + sample[1]
    first, second = sample[0] / size, sample[1] / size
    x = first * kappa[k, 0] + second * kappa[k + 1, 0]
    y = first * kappa[k, 1] + second * kappa[k + 1, 1]
    z = first * kappa[k, 2] + second * kappa[k + 1, 2]
    a, b = sample[2], sample[3]
    shear, along = sample[6], 1 + sample[7] * (t[2] - 1)
    return (
        shear * t[0] + sample[4] - z * b,
        shear * t[1] + sample[5] + z * a,
        along + x * b - y * a,
    )


@kernel
def _lever(sample, x):
    """Place of a channel in its section times its tangent x: (x, y, 0) x tangent."""
    a, b = sample[2], sample[3]
    return b * x[2], -a * x[2], a * x[1] - b * x[0]


@kernel
def channel_lengths(model, q, out):
    """Set out (n_channels,) [m] to the lengths of the continuous channels.

    Rucker and Webster (IEEE Trans. Robotics 27, 2011): the tangent of a channel at r(s) = (x, y) is
    gamma + e_z + r' + kappa x r. gamma is that of the segment, kappa that of the nearer
    vertex; the half segment at the tip has none in the thesis' grid, where it cannot bend. The
    stub of the other grid bends with the first vertex.
    """
    base, first, samples = model.base, model.first_sample, model.samples
    u = sections(q, model.pieces)
    kappa = curvatures(u, base, model.cells, model.weighting)
    zero = q[0] * 0
    for c in range(len(out)):
        out[c] = zero
    for m in range(first[1]):
        x = _channel_vector((zero, zero, zero + 1), kappa, 0, samples[m])
        out[model.sampled[m]] += samples[m, 0] * np.sqrt(dot3(x, x))
    for k in range(model.pieces):
        t = segment_vector(q, base, k, model.segments, row4(u, k + 1))
        for m in range(first[k + 1], first[k + 2]):
            x = _channel_vector(t, kappa, k, samples[m])
            out[model.sampled[m]] += (samples[m, 0] + samples[m, 1]) * np.sqrt(dot3(x, x))


@kernel
def add_channel_forces(model, q, tension, out):
    """Add to out (n,) the generalised force of tensions (n_channels,) [N] in the channels."""
    base, first, samples = model.base, model.first_sample, model.samples
    u = sections(q, model.pieces)
    kappa = curvatures(u, base, model.cells, model.weighting)
    torque, moment = np.zeros_like(kappa), np.zeros_like(kappa)
    zero = q[0] * 0
    for m in range(first[1]):
        x = _channel_vector((zero, zero, zero + 1), kappa, 0, samples[m])
        pull = tension[model.sampled[m]] * samples[m, 0] / np.sqrt(dot3(x, x))
        add_scaled(moment, 0, pull, _lever(samples[m], x))
    for k in range(model.pieces):
        frame = row4(u, k + 1)
        t, force = segment_vector(q, base, k, model.segments, frame), (zero, zero, zero)
        for m in range(first[k + 1], first[k + 2]):
            low, high = samples[m, 0], samples[m, 1]
            x = _channel_vector(t, kappa, k, samples[m])
            pull = tension[model.sampled[m]] / np.sqrt(dot3(x, x))
            part = (low + high) / model.segments[k] * pull
            shear = part * samples[m, 6]
            force = add(force, (shear * x[0], shear * x[1], part * samples[m, 7] * x[2]))
            lever = _lever(samples[m], x)
            add_scaled(moment, k, low * pull, lever)
            add_scaled(moment, k + 1, high * pull, lever)
        pull_ends(base, k, frame, -1.0, force, out)
        add_scaled(torque, k + 1, model.segments[k], cross(t, force))
    for n in range(first_vertex(base), model.pieces):
        turn, scale = relative(row4(u, n), row4(u, n + 1)), 1 / model.cells[n]
        xi, slope = weighting(model.weighting, turn)
        add_moment(torque, n, turn, xi, slope, scaled(scale, row3(moment, n)))
    for k in range(model.pieces):
        add_torque(q, k, 1.0, row3(torque, k + 1), out)
