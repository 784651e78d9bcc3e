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

from softrobot_env.beams.actuation import Actuation
from softrobot_env.beams.ancf.section import SectionLaw, apply_law, set_strain
from softrobot_env.beams.ancf.shapes import AXES
from softrobot_env.beams.numerics.compilation import kernel, structure

#: Tuples, whose length is known where kernels are compiled. All of a robot's data have one type,
#: whatever its dimension, so that most is compiled once; the longest loops are told the dimension.
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
    position: np.ndarray
    weight: np.ndarray
    slope: np.ndarray


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
        channel_pieces: (n_channels,) number of elements that a channel enters.
        channel_weight, channel_slope: (n_channels, 2, k) and (n_channels, 2, k, 4), as in
            `ElementPoints`; the second row is for the last of these elements, where the
            channel may end inside.
    """

    n: int
    block: int
    reach: int
    scale: np.ndarray
    actuation: Actuation
    axes: np.ndarray
    pieces: int
    piece: float
    clamp: np.ndarray
    law: SectionLaw
    damping_time: float
    points: ElementPoints
    mass_bending: np.ndarray
    mass_director: np.ndarray
    bending_factor: np.ndarray
    director_factor: np.ndarray
    gravity: np.ndarray
    straight: np.ndarray
    point_element: np.ndarray
    point_position: np.ndarray
    point_shape: np.ndarray
    channel_pieces: np.ndarray
    channel_weight: np.ndarray
    channel_slope: np.ndarray


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
