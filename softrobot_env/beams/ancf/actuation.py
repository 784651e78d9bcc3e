"""Points, sections and channels of the ANCF beam; see `ancf.elements` for the notation."""

import numpy as np

from softrobot_env.beams.ancf.elements import add_nodal_forces, nodal_vectors
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.beams.numerics.quaternions import cross, dot3, row3, scaled


@kernel
def locate(model, q, out):
    """Set out (n_points, 3) [m] to r(X) at `actuation.point_*`.

    A planar model leaves points beside its plane where they are in the straight pose.
    """
    d = len(model.axes)
    x = nodal_vectors(model, q, 1.0)
    for k in range(len(model.point_element)):
        e = model.point_element[k]
        out[k, 1] = model.actuation.point_offset[k, 1]
        for b in range(d):
            total = q.dtype.type(0)
            for node in range(2):
                for i in range(d + 1):
                    total += model.point_shape[k, node, i] * x[e + node, i, b]
            out[k, model.axes[b]] = total


@kernel
def add_forces(model, q, forces, out):
    """Add to out (n,) the generalised force (2.59) of forces (n_points, 3) on those points."""
    d = len(model.axes)
    f = np.zeros((model.pieces + 1, d + 1, d), out.dtype)
    for k in range(len(model.point_element)):
        e = model.point_element[k]
        for node in range(2):
            for i in range(d + 1):
                for b in range(d):
                    f[e + node, i, b] += model.point_shape[k, node, i] * forces[k, model.axes[b]]
    add_nodal_forces(model, f, out)


@kernel
def _set_directors(model, x, k, out):
    """Set out (2, 3) to r_,2 and r_,3 at point k; in a planar model r_,3 is normal to the plane."""
    e, position = model.point_element[k], model.point_position[k]
    out[:] = 0.0
    out[1, 1] += 1
    for i in range(len(model.axes) - 1):
        for b in range(len(model.axes)):
            start, end = x[e, i + 2, b], x[e + 1, i + 2, b]
            out[i, model.axes[b]] = start + position * (end - start)


@kernel
def load_axes(model, q, out):
    """Set out (n_loads, 3, 3): columns along r_,2, across it in the section, and normal to both."""
    x = nodal_vectors(model, q, 1.0)
    directors = np.empty((2, 3), q.dtype)
    for k in range(len(out)):
        _set_directors(model, x, k, directors)
        along = row3(directors, 0)
        normal = cross(along, row3(directors, 1))
        e_x = scaled(1 / np.sqrt(dot3(along, along)), along)
        e_z = scaled(1 / np.sqrt(dot3(normal, normal)), normal)
        e_y = cross(e_z, e_x)
        for i in range(3):
            out[k, i, 0], out[k, i, 1], out[k, i, 2] = e_x[i], e_y[i], e_z[i]


@kernel
def add_moments(model, q, moments, out):
    """Add to out (n,) the generalised force of moments (n_loads, 3) [N m] at the loads.

    The section's angular velocity w is that of least squares of r_,k' - w x r_,k over the
    gradients in the section: A w = sum_k r_,k x r_,k', A = sum_k |r_,k|^2 1 - r_,k r_,k^T. The
    power M . w is then that of the forces (A^-1 M) x r_,k on the gradients.
    """
    d = len(model.axes)
    x = nodal_vectors(model, q, 1.0)
    f = np.zeros((model.pieces + 1, d + 1, d), out.dtype)
    directors = np.empty((2, 3), q.dtype)
    for k in range(len(moments)):
        e, position = model.point_element[k], model.point_position[k]
        _set_directors(model, x, k, directors)
        spin = _spin(directors, row3(moments, k))
        for i in range(d - 1):
            force = cross(spin, row3(directors, i))
            for b in range(d):
                f[e, i + 2, b] += (1 - position) * force[model.axes[b]]
                f[e + 1, i + 2, b] += position * force[model.axes[b]]
    add_nodal_forces(model, f, out)


@kernel
def _spin(directors, moment):
    """A^-1 M for directors (2, 3), by Cramer's rule; A is symmetric."""
    a = np.zeros((3, 3), directors.dtype)
    for k in range(2):
        r = row3(directors, k)
        for i in range(3):
            a[i, i] += dot3(r, r)
            for j in range(3):
                a[i, j] -= r[i] * r[j]
    x, y, z = row3(a, 0), row3(a, 1), row3(a, 2)
    p, q, r = cross(y, z), cross(z, x), cross(x, y)
    determinant = dot3(x, p)
    return scaled(1 / determinant, (dot3(p, moment), dot3(q, moment), dot3(r, moment)))


@kernel
def _set_slope(model, x, c, e, p, out):
    """Set out (d,) to dr / dX1 of channel c at its integration point p in element e."""
    d, offset = len(model.axes), model.actuation.channel_offset[c]
    last = 1 if e == model.channel_pieces[c] - 1 else 0
    for b in range(d):
        slope = out.dtype.type(0)
        for i in range(4):
            slope += model.channel_slope[c, last, p, i] * x[e + i // 2, i % 2, b]
        for k in range(d - 1):
            slope += offset[k] / model.piece * (x[e + 1, k + 2, b] - x[e, k + 2, b])
        out[b] = slope


@kernel
def _length(a):
    """Length of a (d,); analytic, hence right for complex steps."""
    total = a.dtype.type(0)
    for b in range(len(a)):
        total += a[b] * a[b]
    return np.sqrt(total)


@kernel
def channel_lengths(model, q, out):
    """Set out (n_channels,) [m] to the integrals of |dr / dX1| along the channels."""
    x = nodal_vectors(model, q, 1.0)
    slope = np.zeros(len(model.axes), q.dtype)
    for c in range(len(out)):
        out[c] = 0.0
        for e in range(model.channel_pieces[c]):
            last = 1 if e == model.channel_pieces[c] - 1 else 0
            for p in range(model.channel_weight.shape[2]):
                _set_slope(model, x, c, e, p, slope)
                out[c] += model.channel_weight[c, last, p] * _length(slope)


@kernel
def add_channel_forces(model, q, tension, out):
    """Add to out (n,) minus the gradient of tension (n_channels,) [N] times channel length."""
    d = len(model.axes)
    x = nodal_vectors(model, q, 1.0)
    f = np.zeros((model.pieces + 1, d + 1, d), out.dtype)
    slope = np.zeros(d, q.dtype)
    for c in range(len(tension)):
        offset = model.actuation.channel_offset[c]
        for e in range(model.channel_pieces[c]):
            last = 1 if e == model.channel_pieces[c] - 1 else 0
            for p in range(model.channel_weight.shape[2]):
                _set_slope(model, x, c, e, p, slope)
                pull = tension[c] * model.channel_weight[c, last, p] / _length(slope)
                for b in range(d):
                    force = pull * slope[b]
                    for i in range(4):
                        shape = model.channel_slope[c, last, p, i]
                        f[e + i // 2, i % 2, b] -= shape * force
                    for k in range(d - 1):
                        f[e, k + 2, b] += offset[k] / model.piece * force
                        f[e + 1, k + 2, b] -= offset[k] / model.piece * force
    add_nodal_forces(model, f, out)
