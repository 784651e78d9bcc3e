"""Derivative of the internal forces of the ANCF beam, in the layout of `band`."""

import numpy as np

from softrobot_env.beams.ancf.elements import (
    PLANE,
    SPACE,
    add_section_forces,
    advance,
    nodal_vectors,
    section_force,
    set_section,
)
from softrobot_env.beams.ancf.section import apply_law, set_strain
from softrobot_env.beams.numerics.compilation import kernel


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
        _add_mass(model, mass, element)
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
def _add_mass(model, factor, element):
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
