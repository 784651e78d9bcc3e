"""Elements of the absolute nodal coordinate formulation, thesis sec. 2.3.

A node has the vectors r, r_,1, r_,2 (, r_,3): position and position gradients, in this order and
with d = 2 or 3 components. With X1 along the element and X2 (, X3) in the section,

    r(X) = c(X1) + sum_k X_k r_,k(X1),    k = 2 (, 3),

c being the cubic Hermite interpolation of r and r_,1 and the gradients r_,k linear between the
nodes: the shape functions (2.55) and (2.57). The section's state G, see `ancf.section`, is thus
linear in the nodal vectors.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure

from ..actuation import Actuation
from ..numerics.quaternions import cross, dot3, row3, scaled
from .section import SectionLaw, apply_law, set_strain
from .shapes import AXES

#: Tuples, whose length is known where kernels are compiled. All of a robot's data have one type,
#: whatever its dimension, so that most is compiled once; the longest loops are given the dimension.
PLANE, SPACE = AXES[2], AXES[3]


@structure
class ElementPoints(NamedTuple):
    """Integration points along an element.

    Attributes:
        piece: [m], length of the element.
        position, weight: (k,) X1 / piece and weight [m].
        slope: (k, 4) [1/m, 1, 1/m, 1], derivatives of the Hermite functions.
    """

    piece: float
    position: ndarray
    weight: ndarray
    slope: ndarray


@structure
class AncfData(NamedTuple):
    """Data of a robot of equal elements; d components per vector, d + 1 vectors per node.

    Attributes:
        n, block, reach, scale, actuation: See `mechanics`.
        axes: (d,) world axes of the components; the same kernels serve d = 2 and 3.
        pieces: Number of elements.
        piece: [m], their length.
        clamp: (block,) coordinates of the clamped node, (0,) for a free rod.
        law: Of the sections.
        damping_time: [s].
        points: Where the stresses are integrated.
        mass_bending: (4, 4) [kg, kg m, ...], mass of one element for r and r_,1 at its ends.
        mass_director: (2, 2) [kg m2], for r_,2 (and equally r_,3).
        bending_factor: (m, 4), director_factor: (m, 2), see `_substitute`.
        gravity: (n,) [N, N m], generalised force of gravity.
        straight: (n,) coordinates of the straight rod.
        point_element, point_position: (n_points,) element and X1 / piece of `actuation.point_*`.
        point_shape: (n_points, 2, d + 1) shape functions of both nodes there.
        sampled, entered: (m,) channel, and one of the elements that it enters.
        channel_weight, channel_slope: (m, k) and (m, k, 4) in these, as in `ElementPoints`; a
            channel may end inside its last one.
    """

    n: int
    block: int
    reach: int
    scale: ndarray
    actuation: Actuation
    axes: ndarray
    pieces: int
    piece: float
    clamp: ndarray
    law: SectionLaw
    damping_time: float
    points: ElementPoints
    mass_bending: ndarray
    mass_director: ndarray
    bending_factor: ndarray
    director_factor: ndarray
    gravity: ndarray
    straight: ndarray
    point_element: ndarray
    point_position: ndarray
    point_shape: ndarray
    sampled: ndarray
    entered: ndarray
    channel_weight: ndarray
    channel_slope: ndarray


@kernel
def nodal_vectors(model, q, clamp_factor):
    """Vectors (pieces + 1, d + 1, d) of all nodes; those of the clamp times a factor."""
    d, fixed = len(model.axes), len(model.clamp)
    flat = np.empty((model.pieces + 1) * (d + 1) * d, q.dtype)
    for i in range(fixed):
        flat[i] = clamp_factor * model.clamp[i]
    for i in range(len(q)):
        flat[fixed + i] = q[i]
    return flat.reshape((model.pieces + 1, d + 1, d))


@kernel
def add_nodal_forces(model, f, out):
    """Add forces (pieces + 1, d + 1, d) to out (n,); the clamp bears those on its node."""
    fixed, flat = len(model.clamp), f.reshape(f.size)
    for i in range(len(out)):
        out[i] += flat[fixed + i]


@kernel
def set_section(points, d, x, e, p, out):
    """Set out (g, d) to G at integration point p of element e; x (pieces + 1, d + 1, d)."""
    h, position, length = points.slope, points.position[p], points.piece
    for b in range(d):
        out[0, b] = (
            h[p, 0] * x[e, 0, b]
            + h[p, 1] * x[e, 1, b]
            + h[p, 2] * x[e + 1, 0, b]
            + h[p, 3] * x[e + 1, 1, b]
        )
        for k in range(1, d):
            change = x[e + 1, k + 1, b] - x[e, k + 1, b]
            out[k, b] = change / length
            out[d - 1 + k, b] = x[e, k + 1, b] + position * change


@kernel
def add_section_forces(points, d, force, e, p, f):
    """Add forces (g, d) on G to those on the nodes f; the transpose of `set_section`."""
    h, position, length = points.slope, points.position[p], points.piece
    for b in range(d):
        f[e, 0, b] += h[p, 0] * force[0, b]
        f[e, 1, b] += h[p, 1] * force[0, b]
        f[e + 1, 0, b] += h[p, 2] * force[0, b]
        f[e + 1, 1, b] += h[p, 3] * force[0, b]
        for k in range(1, d):
            moved = force[k, b] / length + position * force[d - 1 + k, b]
            f[e, k + 1, b] += force[d - 1 + k, b] - moved
            f[e + 1, k + 1, b] += moved


@kernel
def advance(d, gradients, rates, damping_time):
    """Replace dG/dt (g, d) by G + 2 mu dG/dt."""
    for i in range(2 * d - 1):
        for b in range(d):
            rates[i, b] = gradients[i, b] + 2 * damping_time * rates[i, b]


@kernel
def section_force(d, resultants, gradients, weight, out):
    """Set out (g, d) to the forces weight sum_j N_ij G_j on G."""
    for i in range(2 * d - 1):
        for b in range(d):
            total = out.dtype.type(0)
            for j in range(2 * d - 1):
                total += resultants[i, j] * gradients[j, b]
            out[i, b] = weight * total


@kernel
def _add_stress_forces(model, axes, x, rate, f):
    """Add the forces of elasticity and damping, (2.63) and (2.65), to f; all as nodal vectors."""
    d, g = len(axes), 2 * len(axes) - 1
    gradients, advanced = np.empty((g, d), f.dtype), np.empty((g, d), f.dtype)
    force = np.empty((g, d), f.dtype)
    strain, resultants = np.empty((g, g), f.dtype), np.empty((g, g), f.dtype)
    for e in range(model.pieces):
        for p in range(len(model.points.weight)):
            set_section(model.points, d, x, e, p, gradients)
            set_section(model.points, d, rate, e, p, advanced)
            advance(d, gradients, advanced, model.damping_time)
            set_strain(d, gradients, advanced, strain)
            apply_law(model.law, d, strain, resultants)
            section_force(d, resultants, gradients, model.points.weight[p], force)
            add_section_forces(model.points, d, force, e, p, f)


@kernel
def _add_inertia(model, acceleration, f):
    """Add mass matrix (2.58) times accelerations to f; both as nodal vectors."""
    d = len(model.axes)
    for e in range(model.pieces):
        for i in range(4):
            for j in range(4):
                mass = model.mass_bending[i, j]
                for b in range(d):
                    f[e + i // 2, i % 2, b] += mass * acceleration[e + j // 2, j % 2, b]
        for i in range(2):
            for j in range(2):
                mass = model.mass_director[i, j]
                for k in range(2, d + 1):
                    for b in range(d):
                        f[e + i, k, b] += mass * acceleration[e + j, k, b]


@kernel
def internal_residual(model, q, v, a, out):
    """Set out (n,) to inertia, elastic and damping forces less gravity."""
    x, rate = nodal_vectors(model, q, 1.0), nodal_vectors(model, v, 0.0)
    f = np.zeros_like(x)
    if len(model.axes) == 2:
        _add_stress_forces(model, PLANE, x, rate, f)
    else:
        _add_stress_forces(model, SPACE, x, rate, f)
    _add_inertia(model, nodal_vectors(model, a, 0.0), f)
    for i in range(len(out)):
        out[i] = -model.gravity[i]
    add_nodal_forces(model, f, out)


@kernel
def _substitute(factor, block, first, vectors, d, x):
    """Solve for some vectors of each node in place, given Cholesky's factor of their mass.

    Args:
        factor: (m, w), element (i, i - k) of the lower factor at [i, k], for k = 0 its
            reciprocal. Row i belongs to node i // vectors.
        block: Coordinates per node.
        first: Number of a node's first coordinate involved.
        vectors: Number of its vectors involved.
        d: Components per vector; each is a right-hand side.
        x: (n,), replaced.
    """
    m, width = factor.shape
    for i in range(m):
        here = (i // vectors) * block + first + (i % vectors) * d
        for k in range(1, min(width, i + 1)):
            there = ((i - k) // vectors) * block + first + ((i - k) % vectors) * d
            for b in range(d):
                x[here + b] -= factor[i, k] * x[there + b]
        for b in range(d):
            x[here + b] *= factor[i, 0]
    for i in range(m - 1, -1, -1):
        here = (i // vectors) * block + first + (i % vectors) * d
        for k in range(1, min(width, m - i)):
            there = ((i + k) // vectors) * block + first + ((i + k) % vectors) * d
            for b in range(d):
                x[here + b] -= factor[i + k, k] * x[there + b]
        for b in range(d):
            x[here + b] *= factor[i, 0]


@kernel
def solve_mass(model, q, force, out):
    """Set out (n,) to M^-1 force; each component and gradient is a system of its own."""
    d = len(model.axes)
    for i in range(len(out)):
        out[i] = force[i]
    _substitute(model.bending_factor, model.block, 0, 2, d, out)
    for k in range(2, d + 1):
        _substitute(model.director_factor, model.block, k * d, 1, d, out)


@kernel
def project(model, q, v):
    """The coordinates are independent: nothing drifts."""


@kernel
def potential(model, q):
    """Energy [J]: the integral of E : N / 2, and that of gravity."""
    d, g = len(model.axes), 2 * len(model.axes) - 1
    x = nodal_vectors(model, q, 1.0)
    gradients = np.empty((g, d), q.dtype)
    strain, resultants = np.empty((g, g), q.dtype), np.empty((g, g), q.dtype)
    energy = q.dtype.type(0)
    for e in range(model.pieces):
        for p in range(len(model.points.weight)):
            set_section(model.points, d, x, e, p, gradients)
            set_strain(d, gradients, gradients, strain)
            apply_law(model.law, d, strain, resultants)
            for i in range(g):
                for j in range(g):
                    energy += 0.5 * model.points.weight[p] * strain[i, j] * resultants[i, j]
    for i in range(len(q)):
        energy -= model.gravity[i] * (q[i] - model.straight[i])
    return energy


@kernel
def momentum(model, q, v, out):
    """Set out (6,) to the momenta, sums over the masses M_ij between the nodal vectors x.

    The linear one is that of M_ij v_j, i being a position only, as their shape functions add up
    to 1; the angular one is that of x_i x M_ij v_j.
    """
    x, rate = nodal_vectors(model, q, 1.0), nodal_vectors(model, v, 0.0)
    f = np.zeros_like(x)
    _add_inertia(model, rate, f)
    r, p = np.zeros(3, out.dtype), np.zeros(3, out.dtype)
    out[:] = 0.0
    for node in range(model.pieces + 1):
        for k in range(len(model.axes) + 1):
            for b in range(len(model.axes)):
                r[model.axes[b]], p[model.axes[b]] = x[node, k, b], f[node, k, b]
            for i in range(3):
                out[3 + i] += r[(i + 1) % 3] * p[(i + 2) % 3] - r[(i + 2) % 3] * p[(i + 1) % 3]
                if k == 0:
                    out[i] += p[i]


# ---------------------------------------------------------------- tangent


@kernel
def add_internal_tangent(model, q, v, damping, mass, out):
    """Add to out K + damping D + mass M, the derivatives of `internal_residual` by q, v and a.

    Args:
        model: Data of an ANCF beam.
        q, v: (n,); the derivatives do not depend on the accelerations.
        damping, mass: Factors.
        out: (n, 3 k + 1), as `mechanics.iteration_matrix`.

    Returns:
        True.
    """
    if len(model.axes) == 2:
        _add_tangent(model, PLANE, q, v, damping, mass, out)
    else:
        _add_tangent(model, SPACE, q, v, damping, mass, out)
    return True


@kernel
def _add_tangent(model, axes, q, v, damping, mass, out):
    """As `add_internal_tangent`, given the model's axes as a tuple."""
    d = len(axes)
    x, rate = nodal_vectors(model, q, 1.0), nodal_vectors(model, v, 0.0)
    size = 2 * (d + 1) * d
    element = np.empty((size, size))
    factor = 0.5 + model.damping_time * damping
    gradients, advanced = np.empty((2 * d - 1, d)), np.empty((2 * d - 1, d))
    for e in range(model.pieces):
        element[:] = 0.0
        for p in range(len(model.points.weight)):
            set_section(model.points, d, x, e, p, gradients)
            set_section(model.points, d, rate, e, p, advanced)
            advance(d, gradients, advanced, model.damping_time)
            _add_point(model.points, model.law, axes, p, gradients, advanced, factor, element)
        _add_mass_matrix(model, mass, element)
        _assemble(model, element, e, out)


@kernel
def _add_point(points, law, axes, p, gradients, advanced, factor, element):
    """Add the derivatives at integration point p to the matrix of an element.

    With a change dq of q and one of damping dq of v, the strain E + mu dE/dt changes by
    (dG_i . K_j + K_i . dG_j) / 2, K = (1 + mu damping) G + mu dG/dt, and the force on G_i by
    sum_j N_ij dG_j + dN_ij G_j.

    Args:
        points, law: Of the model.
        axes: (d,), a tuple, see `AncfData`.
        p: Number.
        gradients, advanced: (g, d), G and G + 2 mu dG/dt.
        factor: 1 / 2 + mu damping, so that K = factor G + advanced / 2.
        element: (2 (d + 1) d, 2 (d + 1) d), [column, row] in the order of the coordinates.
    """
    d, g, weight = len(axes), 2 * len(axes) - 1, points.weight[p]
    strain, change = np.empty((g, g)), np.empty((g, g))
    resultants, force = np.empty((g, g)), np.empty((g, d))
    nodal = np.empty((2, d + 1, d))
    set_strain(d, gradients, advanced, strain)
    apply_law(law, d, strain, resultants)
    strain[:] = 0.0
    for j in range(g):
        for b in range(d):
            for i in range(g):
                strain[i, j] = 0.5 * (factor * gradients[i, b] + 0.5 * advanced[i, b])
                strain[j, i] = strain[i, j]
            strain[j, j] *= 2
            apply_law(law, d, strain, change)
            section_force(d, change, gradients, weight, force)
            for i in range(g):
                force[i, b] += weight * resultants[i, j]
            nodal[:] = 0.0
            add_section_forces(points, d, force, 0, p, nodal)
            _add_columns(points, d, j, b, p, nodal.reshape(2 * (d + 1) * d), element)
        for i in range(g):
            strain[i, j] = 0.0
            strain[j, i] = 0.0


@kernel
def _add_columns(points, d, j, b, p, force, element):
    """Add the force (2 (d + 1) d,) per component b of G_j to the columns that move it."""
    block = (d + 1) * d
    if j == 0:
        for i in range(4):
            _add_column(points.slope[p, i], force, element[(i // 2) * block + (i % 2) * d + b])
    elif j < d:
        near = (j + 1) * d + b
        _add_column(-1 / points.piece, force, element[near])
        _add_column(1 / points.piece, force, element[block + near])
    else:
        near = (j - d + 2) * d + b
        _add_column(1 - points.position[p], force, element[near])
        _add_column(points.position[p], force, element[block + near])


@kernel
def _add_column(factor, force, column):
    """Add factor times force (k,) to column (k,)."""
    for i in range(len(force)):
        column[i] += factor * force[i]


@kernel
def _add_mass_matrix(model, factor, element):
    """Add factor times the mass matrix of an element to its matrix."""
    d = len(model.axes)
    block = (d + 1) * d
    for b in range(d):
        for i in range(4):
            row = (i // 2) * block + (i % 2) * d + b
            for j in range(4):
                column = (j // 2) * block + (j % 2) * d + b
                element[column, row] += factor * model.mass_bending[i, j]
        for k in range(2, d + 1):
            for i in range(2):
                for j in range(2):
                    value = factor * model.mass_director[i, j]
                    element[j * block + k * d + b, i * block + k * d + b] += value


@kernel
def _assemble(model, element, e, out):
    """Add the matrix of element e to the band, without rows and columns of the clamp."""
    first, width = e * model.block - len(model.clamp), (out.shape[1] - 1) // 3
    for j in range(max(0, -first), len(element)):
        for i in range(max(0, -first), len(element)):
            out[first + i, j - i + width] += element[j, i]


# ---------------------------------------------------------------- points, loads and channels


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
def add_wrenches(model, q, forces, moments, out):
    """Add to out (n,) the generalised force (2.59) of forces (n_points, 3) and of moments.

    A section's angular velocity w is that of least squares of r_,k' - w x r_,k over the
    gradients in the section: A w = sum_k r_,k x r_,k', A = sum_k |r_,k|^2 1 - r_,k r_,k^T. The
    power M . w is then that of the forces (A^-1 M) x r_,k on the gradients.
    """
    d = len(model.axes)
    x = nodal_vectors(model, q, 1.0)
    f = np.zeros_like(x)
    directors = np.empty((2, 3), q.dtype)
    for k in range(len(model.point_element)):
        e, position = model.point_element[k], model.point_position[k]
        for node in range(2):
            for i in range(d + 1):
                for b in range(d):
                    f[e + node, i, b] += model.point_shape[k, node, i] * forces[k, model.axes[b]]
        if k < len(moments):
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
def _set_slope(model, x, m, p, out):
    """Set out (d,) to dr / dX1 of the channel and at integration point p of row m."""
    d, e = len(model.axes), model.entered[m]
    offset = model.actuation.channel_offset[model.sampled[m]]
    for b in range(d):
        slope = out.dtype.type(0)
        for i in range(4):
            slope += model.channel_slope[m, p, i] * x[e + i // 2, i % 2, b]
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
    out[:] = 0.0
    for m in range(len(model.sampled)):
        for p in range(model.channel_weight.shape[1]):
            _set_slope(model, x, m, p, slope)
            out[model.sampled[m]] += model.channel_weight[m, p] * _length(slope)


@kernel
def add_channel_forces(model, q, tension, out):
    """Add to out (n,) minus the gradient of tension (n_channels,) [N] times channel length."""
    d = len(model.axes)
    x = nodal_vectors(model, q, 1.0)
    f, slope = np.zeros_like(x), np.zeros(d, q.dtype)
    for m in range(len(model.sampled)):
        e, offset = model.entered[m], model.actuation.channel_offset[model.sampled[m]]
        for p in range(model.channel_weight.shape[1]):
            _set_slope(model, x, m, p, slope)
            pull = tension[model.sampled[m]] * model.channel_weight[m, p] / _length(slope)
            for b in range(d):
                force = pull * slope[b]
                for i in range(4):
                    f[e + i // 2, i % 2, b] -= model.channel_slope[m, p, i] * force
                for k in range(d - 1):
                    f[e, k + 2, b] += offset[k] / model.piece * force
                    f[e + 1, k + 2, b] -= offset[k] / model.piece * force
    add_nodal_forces(model, f, out)
