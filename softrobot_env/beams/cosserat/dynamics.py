"""Kernels of the Cosserat rod on a staggered grid (thesis sec. 2.2, the audit's corrections).

The rod has N segments. Vertices x_0 .. x_N carry the mass, the segments between them the
orientations, quaternions p_1/2 .. p_N-1/2. A block of seven coordinates holds [x_n, p_n-1/2],
n = 1 .. N, places being relative to the first vertex of the straight rod. The clamp is x_0 = 0 and
a fixed section; without it x_0 follows the last block. In arrays of N + 1 sections, row 0 is the
clamp and row k + 1 segment k. The rod bends at the vertices, each for a cell of it.

With D the length over N there are two grids. In the thesis' the first vertex is the clamp; its
cell is the half segment beside it, and the half segment at the tip does not bend. Bending that
belongs to D / 4 then acts at 0, which makes the rod softer by an error of second order. In the
other the vertices are the middles of N equal pieces, each the cell of its vertex, and the tip: a
rigid stub of D / 2 leads to the first, and the last segment is half as long. A moment that is
linear within a piece then bends it exactly, and segment k turns with the section at (k + 1) D.
Pieces of different lengths have a D each, and segments reach from middle to middle.

A quaternion stands for the rotation of its direction: strains, velocities and forces do not
change when it is scaled, so a drift of its norm does no work. On unit quaternions all is as
printed in the thesis. A torque t in the section's frame is the generalised force 2 p t / |p|^2.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure

from ..actuation import Actuation, channel_arm, channel_tangent, check_forces
from ..numerics.quaternions import (
    add,
    add_scaled,
    cross,
    difference,
    dot3,
    dot4,
    mix,
    quaternion_at,
    quotient,
    relative,
    relative_rate,
    rotate,
    rotate_back,
    row3,
    row4,
    scaled,
    set_axes,
    store,
    stretched,
    times_vector,
    unit,
    vector_at,
    weighting,
)


@structure
class CosseratData(NamedTuple):
    """Data of the kernels; see `beams.mechanics` for the first five.

    Attributes:
        pieces: N.
        base: Index of x_0's first coordinate, -1 if clamped.
        spacing: D [m], of unequal pieces the mean.
        stub: [m], place of the first vertex.
        segments: (N,) [m], their lengths.
        cells: (N,) [m] of rod that bend at the vertices 0 to N - 1.
        vertex_mass: (N + 1,) [kg].
        inertia: (N, 3) [kg m2] of the segments.
        normal_inertia: [kg m2] that resists a change of a quaternion's norm; the value does not
            influence the motion.
        stretching: (N, 3) [N], shear (2) and tension stiffness C_gamma of the segments; the first
            stretches for the stub, too.
        bending: (N, 3) [N m2], bending (2) and torsion stiffness C_kappa at the vertices.
        stretch_damping, bend_damping: (N,) damping time [s] of the segments and at the vertices.
        gravity: (3,) [m/s2].
        weighting: 1 to 5, the xi of (2.23).
        conservative: Whether moments act as the gradient of the energy, else as printed.
        baumgarte: [1/s], decay rate of a quaternion's norm to 1, 0 for none.
        norm_stiffness: [N m] that holds the norm at 1 in statics, 0 in dynamics.
        vertex, share: (n_points,), a point's centre is (1 - share) x_vertex + share x_vertex+1.
        shift: (n_points,) [m] along z by which it lies beyond; on the stub that is all.
        section, weight: (n_points,), its directors are those of the segments `section` (-1: the
            clamp) and `section` + 1, with weights 1 - weight and weight; extrapolated ones do not
            hold for moments.
        first_sample: (N + 2,) first sample of the stub and of each segment.
        samples: (n_samples, 7) share of a sample beside the second vertex of its segment, shear and
            stretch there over those of the segment [1], not 1 where the rod's stiffness changes
            within a segment, and place in the cross-section [m] and slope [1] of the channel.
    """

    n: int
    block: int
    reach: int
    scale: ndarray
    actuation: Actuation
    pieces: int
    base: int
    spacing: float
    stub: float
    segments: ndarray
    cells: ndarray
    vertex_mass: ndarray
    inertia: ndarray
    normal_inertia: float
    stretching: ndarray
    bending: ndarray
    stretch_damping: ndarray
    bend_damping: ndarray
    gravity: ndarray
    weighting: int
    conservative: bool
    baumgarte: float
    norm_stiffness: float
    vertex: ndarray
    share: ndarray
    shift: ndarray
    section: ndarray
    weight: ndarray
    first_sample: ndarray
    samples: ndarray


# ---------------------------------------------------------------- coordinates


@kernel
def vertex_index(base, n):
    """Index of vertex n's first coordinate, negative for the clamp."""
    return base if n == 0 else 7 * (n - 1)


@kernel
def vertex_at(q, base, n):
    """Vertex n (3,) [m] from coordinates q (n,), or its velocity from v."""
    j = vertex_index(base, n)
    if j < 0:
        zero = q[0] * 0
        return zero, zero, zero
    return vector_at(q, j)


@kernel
def section_at(q, k):
    """Unit quaternion of segment k, or of the clamp if k < 0."""
    if k < 0:
        zero = q[0] * 0
        return zero + 1, zero, zero, zero
    return unit(quaternion_at(q, 7 * k + 3))


@kernel
def sections(q, pieces):
    """Unit quaternions (N + 1, 4) of the clamp and the segments."""
    u = np.empty((pieces + 1, 4), q.dtype)
    for k in range(pieces + 1):
        u[k, 0], u[k, 1], u[k, 2], u[k, 3] = section_at(q, k - 1)
    return u


@kernel
def spins(q, v, pieces):
    """Angular velocities (N + 1, 3) [rad/s] of the clamp and the segments, in their frames."""
    w = np.zeros((pieces + 1, 3), q.dtype)
    for k in range(pieces):
        p = quaternion_at(q, 7 * k + 3)
        factor, x = 2 / dot4(p, p), quotient(p, quaternion_at(v, 7 * k + 3))
        store(w[k + 1], scaled(factor, x[1:]))
    return w


@kernel
def segment_vector(q, base, k, segments, frame):
    """R^T (x_k+1 - x_k) / length of segment k, gamma + e_z (2.29); or of the velocities."""
    low, high = vertex_at(q, base, k), vertex_at(q, base, k + 1)
    return rotate_back(frame, scaled(1 / segments[k], difference(high, low)))


@kernel
def first_vertex(base):
    """First vertex with a curvature: a free base has none."""
    return 0 if base < 0 else 1


@kernel
def curvatures(u, base, cells, kind):
    """Curvatures kappa_n (N + 1, 3) [1/m] (2.23) between sections u, zero at free ends."""
    kappa = np.zeros((len(u), 3), u.dtype)
    for n in range(first_vertex(base), len(u) - 1):
        w = relative(row4(u, n), row4(u, n + 1))
        factor = 2 / cells[n] * weighting(kind, w)[0]
        store(kappa[n], scaled(factor, w[1:]))
    return kappa


# ---------------------------------------------------------------- equations of motion


@kernel
def internal_residual(model, q, v, a, out):
    """Set out (n,) to inertial, elastic and damping forces less gravity, (2.36) and (2.37)."""
    u, w = sections(q, model.pieces), spins(q, v, model.pieces)
    torque = np.zeros_like(w)
    _set_inertia(model, a, out)
    _add_stretching(model, q, v, u, w, torque, out)
    _add_bending(model, u, w, torque)
    _set_rotation_rows(model, q, v, a, w, torque, out)


@kernel
def _set_inertia(model, a, out):
    """Set the vertices' rows of out (n,) to mass times acceleration less gravity."""
    mass, gravity, base = model.vertex_mass, model.gravity, model.base
    for n in range(1 if base < 0 else 0, len(mass)):
        j = vertex_index(base, n)
        for i in range(3):
            out[j + i] = mass[n] * (a[j + i] - gravity[i])


@kernel
def _add_stretching(model, q, v, u, w, torque, out):
    """Add shear and tension forces c (gamma + mu dgamma/dt) to torque and out."""
    c, mu, base, segments = model.stretching, model.stretch_damping, model.base, model.segments
    for k in range(len(u) - 1):
        frame = row4(u, k + 1)
        t = segment_vector(q, base, k, segments, frame)
        rate = segment_vector(v, base, k, segments, frame)
        strain, rate = (t[0], t[1], t[2] - 1), difference(rate, cross(row3(w, k + 1), t))
        force = stretched(c[k], mix(1.0, strain, mu[k], rate))
        pull_ends(base, k, frame, 1.0, force, out)
        add_scaled(torque, k + 1, segments[k], cross(t, force))


@kernel
def pull_ends(base, k, frame, factor, force, out):
    """Pull the ends of segment k together with factor force, a force in its frame.

    Added to the residual out (n,), where forces count negative.
    """
    pull = rotate(frame, force)
    low, high = vertex_index(base, k), vertex_index(base, k + 1)
    for i in range(3):
        out[high + i] += factor * pull[i]
        if low >= 0:
            out[low + i] -= factor * pull[i]


@kernel
def _add_bending(model, u, w, torque):
    """Add moments c (kappa + mu dkappa/dt) to torque (N + 1, 3) [N m]."""
    c, mu, base, cells = model.bending, model.bend_damping, model.base, model.cells
    for n in range(first_vertex(base), len(u) - 1):
        turn = relative(row4(u, n), row4(u, n + 1))
        rate = relative_rate(turn, row3(w, n), row3(w, n + 1))
        xi, slope = weighting(model.weighting, turn)
        factor = 2 / cells[n]
        still, moving = factor * (xi + mu[n] * slope * rate[0]), factor * mu[n] * xi
        moment = stretched(c[n], mix(still, turn[1:], moving, rate[1:]))
        if not model.conservative:
            xi, slope = xi * 0 + 1, xi * 0
        add_moment(torque, n, turn, xi, slope, moment)


@kernel
def add_moment(torque, n, turn, xi, slope, moment):
    """Add the torques on both sides of vertex n that a moment of cell n does work by.

    Their work is -moment . l_n dkappa. With the rotations d_a and d_b of the sections, in their
    frames, and the relative unit quaternion (c, s) this is
    l_n dkappa = xi (c (d_b - d_a) + s x (d_a + d_b)) - slope s (s . (d_b - d_a)).
    xi = 1 and slope = 0 give the torques of (2.37).

    Args:
        torque: (N + 1, 3) [N m].
        n: Vertex.
        turn: The relative quaternion.
        xi, slope: The weighting and its derivative by c.
        moment: Vector [N m].
    """
    s = turn[1:]
    twist, along = cross(s, moment), slope * dot3(s, moment)
    for i in range(3):
        even, odd = xi * twist[i], xi * turn[0] * moment[i] - along * s[i]
        torque[n, i] += even + odd
        torque[n + 1, i] += even - odd


@kernel
def _set_rotation_rows(model, q, v, a, w, torque, out):
    """Set the rows of the quaternions: Euler's equations, and the norm's constraint.

    The latter on acceleration level, p . a = -|v|^2 as in (2.43), with Baumgarte's terms.
    """
    z, inertia = model.baumgarte, model.inertia
    for k in range(len(w) - 1):
        j = 7 * k + 3
        p, dp, ddp = quaternion_at(q, j), quaternion_at(v, j), quaternion_at(a, j)
        w_k, turned = row3(w, k + 1), quotient(p, ddp)
        square, radial = dot4(p, p), dot4(p, dp)
        factor = 2 / square
        spinning = stretched(inertia[k], w_k)
        gyroscopic = cross(w_k, spinning)
        drag = factor * radial
        rising = mix(factor, stretched(inertia[k], turned[1:]), -drag, spinning)
        missing = add(rising, difference(gyroscopic, row3(torque, k + 1)))
        excess = 0.5 * (square - 1)
        normal = model.norm_stiffness * excess + model.normal_inertia * (
            dot4(p, ddp) + dot4(dp, dp) + 2 * z * radial + z * z * excess
        )
        row = times_vector(p, missing)
        for i in range(4):
            out[j + i] = factor * row[i] + normal * p[i]


@kernel
def solve_mass(model, q, force, out):
    """Set out (n,) to M(q)^-1 force; (2.44) with the audit's factor 1/4."""
    for n in range(1 if model.base < 0 else 0, model.pieces + 1):
        j = vertex_index(model.base, n)
        for i in range(3):
            out[j + i] = force[j + i] / model.vertex_mass[n]
    for k in range(model.pieces):
        j, body = 7 * k + 3, model.inertia[k]
        p, f = quaternion_at(q, j), quaternion_at(force, j)
        square, x = dot4(p, p), quotient(p, f)
        turn = (0.25 * x[1] / body[0], 0.25 * x[2] / body[1], 0.25 * x[3] / body[2])
        row = times_vector(p, turn)
        radial = x[0] / (model.normal_inertia * square * square)
        for i in range(4):
            out[j + i] = row[i] + radial * p[i]


@kernel
def project(model, q, v):
    """Normalise the quaternions and remove the velocity of their norm, in place.

    (2.47), and (2.48) with the normalised quaternion (audit). The velocity is divided by the norm
    as well: rotation and angular velocity then stay what they were.
    """
    for k in range(model.pieces):
        j = 7 * k + 3
        p, dp = quaternion_at(q, j), quaternion_at(v, j)
        square = dot4(p, p)
        scale, radial = 1 / np.sqrt(square), dot4(p, dp) / square
        for i in range(4):
            q[j + i] = scale * p[i]
            v[j + i] = scale * (dp[i] - radial * p[i])


@kernel
def displace(model, q, change, out):
    """Set out (n,) to q after a change (n,), with strains and rotations that change by it exactly.

    The sum q + change would stretch a slender rod that bends, and its stiffness against that is
    larger than the one against bending by (L / r)^2.
    """
    base, segments = model.base, model.segments
    x = vertex_at(q, base, 0)
    if base >= 0:
        x = add(x, vertex_at(change, base, 0))
        out[base], out[base + 1], out[base + 2] = x
    for k in range(model.pieces):
        j = 7 * k
        u, dp = section_at(q, k), quaternion_at(change, j + 3)
        norm = np.sqrt(dot4(quaternion_at(q, j + 3), quaternion_at(q, j + 3)))
        turn = scaled(1 / norm, quotient(u, dp)[1:])  # half the rotation vector
        t = segment_vector(q, base, k, segments, u)
        dt = segment_vector(change, base, k, segments, u)
        strain = difference(add(t, dt), scaled(2.0, cross(turn, t)))
        angle = np.sqrt(dot3(turn, turn))
        part = np.sin(angle) / angle if angle > 0 else 1.0
        row = times_vector(u, scaled(part, turn))
        for i in range(4):
            out[j + 3 + i] = np.cos(angle) * u[i] + row[i]
        x = add(x, scaled(segments[k], rotate(unit(quaternion_at(out, j + 3)), strain)))
        out[j], out[j + 1], out[j + 2] = x


# ---------------------------------------------------------------- energy and momentum


@kernel
def potential(model, q):
    """Elastic and gravitational energy [J]; gravity's is zero in the straight pose."""
    base, segments, u = model.base, model.segments, sections(q, model.pieces)
    kappa = curvatures(u, base, model.cells, model.weighting)
    total, place = q[0] * 0, 0.0
    for n in range(model.pieces + 1):
        x = vertex_at(q, base, n)
        fall = dot3(x, model.gravity) - place * model.gravity[2]
        total -= model.vertex_mass[n] * fall
        if n < model.pieces:
            place += segments[n]
            for i in range(3):
                total += 0.5 * model.cells[n] * model.bending[n, i] * kappa[n, i] * kappa[n, i]
    for k in range(model.pieces):
        t, c = segment_vector(q, base, k, segments, row4(u, k + 1)), model.stretching[k]
        squares = c[0] * t[0] * t[0] + c[1] * t[1] * t[1] + c[2] * (t[2] - 1) * (t[2] - 1)
        total += 0.5 * segments[k] * squares
    return total


@kernel
def momentum(model, q, v, out):
    """Set out (6,) to linear [N s] and angular momentum about the origin [N m s]."""
    out[:] = 0
    for n in range(model.pieces + 1):
        mass, dx = model.vertex_mass[n], vertex_at(v, model.base, n)
        x, y, z = vertex_at(q, model.base, n)
        turning = cross((x, y, z + model.stub), dx)
        for i in range(3):
            out[i] += mass * dx[i]
            out[i + 3] += mass * turning[i]
    w, inertia = spins(q, v, model.pieces), model.inertia
    for k in range(model.pieces):
        turning = rotate(section_at(q, k), stretched(inertia[k], row3(w, k + 1)))
        for i in range(3):
            out[i + 3] += turning[i]


# ---------------------------------------------------------------- points and loads


@kernel
def locate(model, q, points, axes):
    """Set the material points (n_points, 3) [m], and the axes (k, 3, 3) of the first sections.

    Axes are those of the normalised mean of the neighbouring quaternions, extrapolated beyond the
    last.
    """
    offset = model.actuation.point_offset
    for m in range(len(offset)):
        n, share = model.vertex[m], model.share[m]
        low, high = vertex_at(q, model.base, n), vertex_at(q, model.base, n + 1)
        store(points[m], mix(1 - share, low, share, high))
        points[m, 2] += model.shift[m]
        if offset[m, 0] != 0 or offset[m, 1] != 0 or m < len(axes):
            k, weight = model.section[m], model.weight[m]
            first, second = section_at(q, k), section_at(q, k + 1)
            _add_director(points, m, 1 - weight, first, offset)
            _add_director(points, m, weight, second, offset)
            if m < len(axes):
                _set_mean_axes(axes[m], weight, first, second)


@kernel
def _add_director(out, m, weight, frame, offset):
    zero = frame[0] * 0
    add_scaled(out, m, weight, rotate(frame, (zero + offset[m, 0], zero + offset[m, 1], zero)))


@kernel
def _set_mean_axes(out, weight, first, second):
    zero = first[0] * 0
    b = -weight if dot4(first, second).real < 0 else weight
    x, y, z = mix(1 - weight, first[1:], b, second[1:])
    frame = unit(((1 - weight) * first[0] + b * second[0], x, y, z))
    e_x, e_y = rotate(frame, (zero + 1, zero, zero)), rotate(frame, (zero, zero + 1, zero))
    set_axes(out, e_x, e_y, cross(e_x, e_y))


@kernel
def add_wrenches(model, q, forces, moments, out):
    """Add to out (n,) the generalised force of forces (n_points, 3) and moments on the points."""
    check_forces(model.actuation, forces)
    offset = model.actuation.point_offset
    for m in range(len(offset)):
        n, share, force = model.vertex[m], model.share[m], row3(forces, m)
        low, high = vertex_index(model.base, n), vertex_index(model.base, n + 1)
        for i in range(3):
            if low >= 0:
                out[low + i] += (1 - share) * force[i]
            out[high + i] += share * force[i]
        k = model.section[m]
        if offset[m, 0] != 0 or offset[m, 1] != 0:
            weight = model.weight[m]
            _add_arm(q, k, 1 - weight, force, offset, m, out)
            _add_arm(q, k + 1, weight, force, offset, m, out)
        if m < len(moments):
            weight, moment = min(max(model.weight[m], 0.0), 1.0), row3(moments, m)
            _add_torque(q, k, 1 - weight, moment, out)
            _add_torque(q, k + 1, weight, moment, out)


@kernel
def _add_torque(q, k, weight, moment, out):
    """Add to out (n,) the share of a moment [N m], in the world, that turns segment k."""
    if k >= 0 and weight != 0:
        _turn_segment(q, k, weight, rotate_back(section_at(q, k), moment), out)


@kernel
def _add_arm(q, k, weight, force, offset, m, out):
    """Add to out (n,) the share of a force on offset m that turns segment k."""
    if k >= 0 and weight != 0:
        x, y, z = rotate_back(section_at(q, k), force)
        a, b = offset[m, 0], offset[m, 1]
        _turn_segment(q, k, weight, (b * z, -a * z, a * y - b * x), out)


@kernel
def _turn_segment(q, k, factor, torque, out):
    """Add to out (n,) factor times a torque [N m] on segment k, in its frame."""
    p = quaternion_at(q, 7 * k + 3)
    scale, row = 2 * factor / dot4(p, p), times_vector(p, torque)
    for i in range(4):
        out[7 * k + 3 + i] += scale * row[i]


# ---------------------------------------------------------------- channels


@kernel
def channel_tangents(model, q, out):
    """Set out (n_samples, 3) to the tangents of the channels, in the segments' frames.

    With the strain of the segment and the curvature of the nearer vertex; the half segment at the
    tip has none in the thesis' grid, where it cannot bend. The stub of the other grid bends with
    the first vertex.
    """
    base, first = model.base, model.first_sample
    u = sections(q, model.pieces)
    kappa = curvatures(u, base, model.cells, model.weighting)
    for k in range(-1, model.pieces):
        t = (q[0] * 0, q[0] * 0, q[0] * 0 + 1)  # in the stub
        if k >= 0:
            t = segment_vector(q, base, k, model.segments, row4(u, k + 1))
        low, high = row3(kappa, max(k, 0)), row3(kappa, max(k, 0) + 1)
        for m in range(first[k + 1], first[k + 2]):
            sample = model.samples[m]
            along = (sample[1] * t[0], sample[1] * t[1], 1 + sample[2] * (t[2] - 1))
            bending = mix(1 - sample[0], low, sample[0], high)
            store(out[m], channel_tangent(along, bending, sample[3:]))


@kernel
def add_channel_pulls(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_samples, 3) against the tangents."""
    base, first = model.base, model.first_sample
    u = sections(q, model.pieces)
    torque, moment = np.zeros((len(u), 3), q.dtype), np.zeros((len(u), 3), q.dtype)
    for k in range(-1, model.pieces):
        pull = (q[0] * 0, q[0] * 0, q[0] * 0)
        for m in range(first[k + 1], first[k + 2]):
            sample, force = model.samples[m], row3(forces, m)
            stretching = stretched((sample[1], sample[1], sample[2]), force)
            pull = add(pull, stretching)
            arm = channel_arm(sample[3:], force)
            add_scaled(moment, max(k, 0), 1 - sample[0], arm)
            add_scaled(moment, max(k, 0) + 1, sample[0], arm)
        if k >= 0:
            frame, length = row4(u, k + 1), model.segments[k]
            t = segment_vector(q, base, k, model.segments, frame)
            pull_ends(base, k, frame, -1 / length, pull, out)
            add_scaled(torque, k + 1, 1.0, cross(t, pull))
    for n in range(first_vertex(base), model.pieces):
        turn, scale = relative(row4(u, n), row4(u, n + 1)), 1 / model.cells[n]
        xi, slope = weighting(model.weighting, turn)
        add_moment(torque, n, turn, xi, slope, scaled(scale, row3(moment, n)))
    for k in range(model.pieces):
        _turn_segment(q, k, 1.0, row3(torque, k + 1), out)
