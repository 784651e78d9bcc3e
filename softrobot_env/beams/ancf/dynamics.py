"""Elements of the absolute nodal coordinate formulation, thesis sec. 2.3.

A node has the vectors r, r_,1, r_,2 (, r_,3): position and position gradients, in this order and
with d = 2 or 3 components. With X1 along the element and X2 (, X3) in the section,

    r(X) = c(X1) + sum_k X_k r_,k(X1),    k = 2 (, 3),

c being the cubic Hermite interpolation of r and r_,1 and the gradients r_,k linear between the
nodes: the shape functions (2.55) and (2.57). All that is known of an element is thus linear in the
vectors of its two nodes, by factors (rows, slots) of 2 (d + 1) slots: points, tangents of channels,
momenta; and the section's state G, see `ancf.section`. x (slots, d) are the vectors of all nodes.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure

from ..actuation import Actuation, check_forces
from ..numerics.quaternions import add, add_scaled, cross, dot3, mix, row3, scaled, set_axes, store
from .section import SectionLaw, set_resultants, set_strain
from .shapes import AXES

#: Tuples, whose length is known where kernels are compiled. All of a robot's data have one type,
#: whatever its dimension, so that most is compiled once; kernels of the longest loops take a tuple
#: for `axes`. A number d in its place is known only where a compiler chooses to inline them.
PLANE, SPACE = AXES[2], AXES[3]


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
        position, weight: (k,) X1 / piece and weight [m] of points along an element, where stresses
            are integrated.
        slope: (k, 4) [1/m, 1, 1/m, 1], derivatives of the Hermite functions there.
        mass: (slots, slots) [kg, kg m, ...] of an element.
        mass_factor: (m, w) Cholesky's factor of the mass between all m slots that move; (i, i - k)
            at [i, k], for k = 0 its reciprocal.
        gravity: (n,) [N, N m], generalised force of gravity.
        straight: (n,) coordinates of the straight rod.
        element: (n_points,) that the points `actuation.point_*` are in.
        points: (n_points, d, slots) factors of these, and of r_,2 (, r_,3) there.
        entered: (n_samples,) element that a sample of a channel is in.
        tangents: (n_samples, slots) factors of the tangents of channels.
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
    position: ndarray
    weight: ndarray
    slope: ndarray
    mass: ndarray
    mass_factor: ndarray
    gravity: ndarray
    straight: ndarray
    element: ndarray
    points: ndarray
    entered: ndarray
    tangents: ndarray


@kernel
def nodal_vectors(model, q, clamp_factor):
    """Vectors (slots, d) of all nodes; those of the clamp times a factor."""
    d, fixed = len(model.axes), len(model.clamp)
    flat = np.empty((model.pieces + 1) * (d + 1) * d, q.dtype)
    for i in range(fixed):
        flat[i] = clamp_factor * model.clamp[i]
    for i in range(len(q)):
        flat[fixed + i] = q[i]
    return flat.reshape(((model.pieces + 1) * (d + 1), d))


@kernel
def add_nodal_forces(model, f, out):
    """Add forces (slots, d) to out (n,); the clamp bears those on its node."""
    fixed, flat = len(model.clamp), f.reshape(f.size)
    for i in range(len(out)):
        out[i] += flat[fixed + i]


@kernel
def integration_point(model, p):
    """What a section at integration point p needs: its `slope`, `position`, and the `piece`.

    Read within the loops they would be read from memory again after every store.
    """
    return model.slope[p], model.position[p], model.piece


@kernel
def set_section(axes, point, x, first, out):
    """Set out (g, d) to G at an `integration_point` of the element with slots from the first."""
    (h, position, length), d = point, len(axes)
    last = first + d + 1
    for b in range(d):
        near, far = h[0] * x[first, b], h[2] * x[last, b]
        out[0, b] = near + h[1] * x[first + 1, b] + far + h[3] * x[last + 1, b]
        for k in range(1, d):
            change = x[last + k + 1, b] - x[first + k + 1, b]
            out[k, b] = change / length
            out[d - 1 + k, b] = x[first + k + 1, b] + position * change


@kernel
def add_section_forces(axes, point, force, first, f):
    """Add forces (g, d) on G to those on the slots f; the transpose of `set_section`."""
    (h, position, length), d = point, len(axes)
    last = first + d + 1
    for b in range(d):
        f[first, b] += h[0] * force[0, b]
        f[first + 1, b] += h[1] * force[0, b]
        f[last, b] += h[2] * force[0, b]
        f[last + 1, b] += h[3] * force[0, b]
        for k in range(1, d):
            moved = force[k, b] / length + position * force[d - 1 + k, b]
            f[first + k + 1, b] += force[d - 1 + k, b] - moved
            f[last + k + 1, b] += moved


@kernel
def _ahead(model, x, rate):
    """Vectors x + 2 mu dx/dt, whose strain with x is E + mu dE/dt."""
    out = np.empty_like(x)
    for i in range(len(x)):
        for b in range(x.shape[1]):
            out[i, b] = x[i, b] + 2 * model.damping_time * rate[i, b]
    return out


@kernel
def section_force(axes, resultants, gradients, weight, out):
    """Set out (g, d) to the forces weight sum_j N_ij G_j on G."""
    d = len(axes)
    for i in range(2 * d - 1):
        for b in range(d):
            total = out.dtype.type(0)
            for j in range(2 * d - 1):
                total += resultants[i, j] * gradients[j, b]
            out[i, b] = weight * total


@kernel
def _add_stress_forces(model, axes, x, rate, f):
    """Add the forces of elasticity and damping, (2.63) and (2.65), to f."""
    d, g, ahead = len(axes), 2 * len(axes) - 1, _ahead(model, x, rate)
    gradients, advanced = np.empty((g, d), f.dtype), np.empty((g, d), f.dtype)
    force = np.empty((g, d), f.dtype)
    strain, resultants = np.empty((g, g), f.dtype), np.empty((g, g), f.dtype)
    for e in range(model.pieces):
        first = e * (d + 1)
        for p in range(len(model.weight)):
            point = integration_point(model, p)
            set_section(axes, point, x, first, gradients)
            set_section(axes, point, ahead, first, advanced)
            set_strain(axes, gradients, advanced, strain)
            set_resultants(model.law, axes, strain, resultants)
            section_force(axes, resultants, gradients, model.weight[p], force)
            add_section_forces(axes, point, force, first, f)


@kernel
def _add_inertia(model, axes, acceleration, f):
    """Add mass matrix (2.58) times accelerations to f."""
    d, mass, block = len(axes), model.mass, len(axes) + 1
    for e in range(model.pieces):
        for near in range(2):
            for far in range(2):
                row, column = (e + near) * block, (e + far) * block
                for i in range(2):
                    for j in range(2):
                        value = mass[near * block + i, far * block + j]
                        for b in range(d):
                            f[row + i, b] += value * acceleration[column + j, b]
                for k in range(2, block):
                    value = mass[near * block + k, far * block + k]
                    for b in range(d):
                        f[row + k, b] += value * acceleration[column + k, b]


@kernel
def internal_residual(model, q, v, a, out):
    """Set out (n,) to inertia, elastic and damping forces less gravity."""
    x, rate = nodal_vectors(model, q, 1.0), nodal_vectors(model, v, 0.0)
    acceleration, f = nodal_vectors(model, a, 0.0), np.zeros_like(x)
    if len(model.axes) == 2:
        _add_stress_forces(model, PLANE, x, rate, f)
        _add_inertia(model, PLANE, acceleration, f)
    else:
        _add_stress_forces(model, SPACE, x, rate, f)
        _add_inertia(model, SPACE, acceleration, f)
    for i in range(len(out)):
        out[i] = -model.gravity[i]
    add_nodal_forces(model, f, out)


@kernel
def solve_mass(model, q, force, out):
    """Set out (n,) to M^-1 force; each component is a right-hand side of its own."""
    d, factor = len(model.axes), model.mass_factor
    slots, width = factor.shape
    for i in range(len(out)):
        out[i] = force[i]
    for i in range(slots):
        for k in range(1, min(width, i + 1)):
            for b in range(d):
                out[i * d + b] -= factor[i, k] * out[(i - k) * d + b]
        for b in range(d):
            out[i * d + b] *= factor[i, 0]
    for i in range(slots - 1, -1, -1):
        for k in range(1, min(width, slots - i)):
            for b in range(d):
                out[i * d + b] -= factor[i + k, k] * out[(i + k) * d + b]
        for b in range(d):
            out[i * d + b] *= factor[i, 0]


@kernel
def project(model, q, v):
    """The coordinates are independent: nothing drifts."""


@kernel
def potential(model, q):
    """Energy [J]: the integral of E : N / 2, and that of gravity."""
    d, g = len(model.axes), 2 * len(model.axes) - 1
    x, gradients = nodal_vectors(model, q, 1.0), np.empty((g, d), q.dtype)
    strain, resultants = np.empty((g, g), q.dtype), np.empty((g, g), q.dtype)
    energy = q.dtype.type(0)
    for e in range(model.pieces):
        for p in range(len(model.weight)):
            set_section(model.axes, integration_point(model, p), x, e * (d + 1), gradients)
            set_strain(model.axes, gradients, gradients, strain)
            set_resultants(model.law, model.axes, strain, resultants)
            for i in range(g):
                for j in range(g):
                    energy += 0.5 * model.weight[p] * strain[i, j] * resultants[i, j]
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
    _add_inertia(model, model.axes, rate, f)
    r, p = np.zeros(3, out.dtype), np.zeros(3, out.dtype)
    out[:] = 0.0
    for slot in range(len(x)):
        for b in range(len(model.axes)):
            r[model.axes[b]], p[model.axes[b]] = x[slot, b], f[slot, b]
        turning = cross(r, p)
        for i in range(3):
            out[3 + i] += turning[i]
            if slot % (len(model.axes) + 1) == 0:
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
    d, g, size = len(axes), 2 * len(axes) - 1, len(model.mass)
    x = nodal_vectors(model, q, 1.0)
    ahead = _ahead(model, x, nodal_vectors(model, v, 0.0))
    element = np.empty((size * d, size * d))
    factor = 0.5 + model.damping_time * damping
    gradients, advanced = np.empty((g, d)), np.empty((g, d))
    for e in range(model.pieces):
        element[:] = 0.0
        for p in range(len(model.weight)):
            point = integration_point(model, p)
            set_section(axes, point, x, e * (d + 1), gradients)
            set_section(axes, point, ahead, e * (d + 1), advanced)
            _add_point(model, axes, p, gradients, advanced, factor, element)
        for i in range(size):
            for j in range(size):
                for b in range(d):
                    element[j * d + b, i * d + b] += mass * model.mass[i, j]
        _assemble(model, element, e, out)


@kernel
def _add_point(model, axes, p, gradients, advanced, factor, element):
    """Add the derivatives at integration point p to the matrix of an element.

    With a change dq of q and one of damping dq of v, the strain E + mu dE/dt changes by
    (dG_i . K_j + K_i . dG_j) / 2, K = (1 + mu damping) G + mu dG/dt, and the force on G_i by
    sum_j N_ij dG_j + dN_ij G_j.

    Args:
        model: The model.
        axes: (d,), a tuple, see `AncfData`.
        p: Number.
        gradients, advanced: (g, d), G and G + 2 mu dG/dt.
        factor: 1 / 2 + mu damping, so that K = factor G + advanced / 2.
        element: (2 (d + 1) d, 2 (d + 1) d), [column, row] in the order of the coordinates.
    """
    d, g, size = len(axes), 2 * len(axes) - 1, 2 * (len(axes) + 1)
    strain, change = np.empty((g, g)), np.empty((g, g))
    resultants, force = np.empty((g, g)), np.empty((g, d))
    nodal = np.empty((size, d))
    point = integration_point(model, p)
    set_strain(axes, gradients, advanced, strain)
    set_resultants(model.law, axes, strain, resultants)
    strain[:] = 0.0
    for j in range(g):
        for b in range(d):
            for i in range(g):
                strain[i, j] = 0.5 * (factor * gradients[i, b] + 0.5 * advanced[i, b])
                strain[j, i] = strain[i, j]
            strain[j, j] *= 2
            set_resultants(model.law, axes, strain, change)
            section_force(axes, change, gradients, model.weight[p], force)
            for i in range(g):
                force[i, b] += model.weight[p] * resultants[i, j]
            nodal[:] = 0.0
            add_section_forces(axes, point, force, 0, nodal)
            _add_columns(model, d, j, b, p, nodal.reshape(size * d), element)
        for i in range(g):
            strain[i, j] = 0.0
            strain[j, i] = 0.0


@kernel
def _add_columns(model, d, j, b, p, force, element):
    """Add the force (2 (d + 1) d,) per component b of G_j to the columns that move it."""
    block = (d + 1) * d
    if j == 0:
        for i in range(4):
            _add_column(model.slope[p, i], force, element[(i // 2) * block + (i % 2) * d + b])
    elif j < d:
        near = (j + 1) * d + b
        _add_column(-1 / model.piece, force, element[near])
        _add_column(1 / model.piece, force, element[block + near])
    else:
        near = (j - d + 2) * d + b
        _add_column(1 - model.position[p], force, element[near])
        _add_column(model.position[p], force, element[block + near])


@kernel
def _add_column(factor, force, column):
    """Add factor times force (k,) to column (k,)."""
    for i in range(len(force)):
        column[i] += factor * force[i]


@kernel
def _assemble(model, element, e, out):
    """Add the matrix of element e to the band, without rows and columns of the clamp."""
    first, width = e * model.block - len(model.clamp), (out.shape[1] - 1) // 3
    for j in range(max(0, -first), len(element)):
        for i in range(max(0, -first), len(element)):
            out[first + i, j - i + width] += element[j, i]


# ---------------------------------------------------------------- points, loads and channels


@kernel
def world_vectors(model, q):
    """Vectors (slots, 3) of all nodes, along all axes of the world."""
    x = nodal_vectors(model, q, 1.0)
    if len(model.axes) == 3:
        return x
    out = np.zeros((len(x), 3), q.dtype)
    for slot in range(len(x)):
        out[slot, 0], out[slot, 2] = x[slot, 0], x[slot, 1]
    return out


@kernel
def add_world_forces(model, f, out):
    """Add forces (slots, 3) along the axes of the world to out (n,); what is across is borne."""
    d, fixed = len(model.axes), len(model.clamp)
    first = fixed // d
    for slot in range(first, len(f)):
        for b in range(d):
            out[(slot - first) * d + b] += f[slot, model.axes[b]]


@kernel
def vector_of(factors, x, first):
    """The vector of an element with slots from the first, by factors (slots,); x (.., 3) of all."""
    total = scaled(factors[0], row3(x, first))
    for k in range(1, len(factors)):
        total = add(total, scaled(factors[k], row3(x, first + k)))
    return total


@kernel
def add_force(factors, force, first, f):
    """Add a force on such a vector to those on the slots f (.., 3); the transpose."""
    for k in range(len(factors)):
        add_scaled(f, first + k, factors[k], force)


@kernel
def locate(model, q, points, axes):
    """Set the material points (n_points, 3) [m], and the axes (k, 3, 3) of the first sections.

    These are along r_,2, across it in the section, and normal to both. A planar model leaves points
    beside its plane where they are in the straight pose.
    """
    x, block = world_vectors(model, q), len(model.axes) + 1
    factors, element, offset = model.points, model.element, model.actuation.point_offset
    for k in range(len(points)):
        store(points[k], vector_of(factors[k, 0], x, element[k] * block))
        if block == 3:
            points[k, 1] = offset[k, 1]
    for k in range(len(axes)):
        along, across = _directors(model, x, k)
        normal = cross(along, across)
        e_x = scaled(1 / np.sqrt(dot3(along, along)), along)
        e_z = scaled(1 / np.sqrt(dot3(normal, normal)), normal)
        set_axes(axes[k], e_x, cross(e_z, e_x), e_z)


@kernel
def _directors(model, x, k):
    """Vectors r_,2 and r_,3 at point k; in a planar model r_,3 is normal to the plane."""
    factors, first = model.points[k], model.element[k] * (len(model.axes) + 1)
    zero = x.dtype.type(0)
    across = (zero, zero + 1, zero)
    if len(factors) > 2:
        across = vector_of(factors[2], x, first)
    return vector_of(factors[1], x, first), across


@kernel
def add_wrenches(model, q, forces, moments, out):
    """Add to out (n,) the generalised force (2.59) of forces (n_points, 3) and of moments.

    A section's angular velocity w is that of least squares of r_,k' - w x r_,k over the
    gradients in the section: A w = sum_k r_,k x r_,k', A = sum_k |r_,k|^2 1 - r_,k r_,k^T. The
    power M . w is then that of the forces (A^-1 M) x r_,k on the gradients.
    """
    check_forces(model.actuation, forces)
    x, block = world_vectors(model, q), len(model.axes) + 1
    f, factors, element = np.zeros_like(x), model.points, model.element
    for k in range(len(forces)):
        add_force(factors[k, 0], row3(forces, k), element[k] * block, f)
    for k in range(len(moments)):
        first, (along, across) = element[k] * block, _directors(model, x, k)
        spin = _spin(along, across, row3(moments, k))
        add_force(factors[k, 1], cross(spin, along), first, f)
        if block > 3:
            add_force(factors[k, 2], cross(spin, across), first, f)
    add_world_forces(model, f, out)


@kernel
def _spin(along, across, moment):
    """A^-1 M for directors r_,2 and r_,3, by Woodbury's identity."""
    a, b, c = dot3(along, along), dot3(along, across), dot3(across, across)
    p, q = dot3(along, moment), dot3(across, moment)
    determinant = a * c - b * b
    within = mix((a * p + b * q) / determinant, along, (b * p + c * q) / determinant, across)
    return scaled(1 / (a + c), add(moment, within))


@kernel
def channel_tangents(model, q, out):
    """Set out (n_samples, 3) to dr / dX1 of the channels."""
    x, block = world_vectors(model, q), len(model.axes) + 1
    factors, entered = model.tangents, model.entered
    for m in range(len(out)):
        store(out[m], vector_of(factors[m], x, entered[m] * block))


@kernel
def add_channel_pulls(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_samples, 3) against the tangents."""
    block, factors, entered = len(model.axes) + 1, model.tangents, model.entered
    f = np.zeros(((model.pieces + 1) * block, 3), q.dtype)
    for m in range(len(forces)):
        add_force(factors[m], row3(forces, m), entered[m] * block, f)
    add_world_forces(model, -f, out)
