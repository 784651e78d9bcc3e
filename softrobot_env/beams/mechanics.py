"""Equations of motion that all beam models share, and what a model provides for them.

A model is M(q) a + k(q, v) = f(q, v) + B(q) u: linear in the inputs u (control-affine, thesis
(2.96)), which are the tensions (or pulled-in lengths) of its tendons, then the amplitudes of its
loads. Its data are a NamedTuple of numbers and arrays with at least

    n: int, number of coordinates
    block, reach: int; coordinates come in blocks of equal size (one per piece or node), and the
        equations of a block involve the coordinates of at most `reach` blocks to either side
    scale: (n,) float, size of a large change of each coordinate
    actuation: `actuation.Actuation`

For its type of NamedTuple it implements the functions of the first part of this module in modules
that it registers with `implement`. Arrays may be real or complex: derivatives are taken along
imaginary steps. The second part is the same for all models.
"""

from functools import singledispatch
from types import ModuleType

import numpy as np

from softrobot_env.compile.kernels import implementation, kernel

from .actuation import add_path_forces, add_path_lengths, tendon_tensions
from .numerics.quaternions import dot3, row3, scaled, store, transformed

# ---------------------------------------------------------------- provided by a model


@singledispatch
def internal_residual(model, q, v, a, out):
    """Set out (n,) to M(q) a + k(q, v) plus elastic and damping forces, less gravity."""
    raise NotImplementedError


@singledispatch
def solve_mass(model, q, force, out):
    """Set out (n,) to M(q)^-1 force; may overwrite the force."""
    raise NotImplementedError


@singledispatch
def project(model, q, v):
    """Remove the drift of redundant coordinates from q and v (n,), in place."""
    raise NotImplementedError


@singledispatch
def locate(model, q, points, axes):
    """Set points (n_points, 3) [m] to the material points `actuation.point_*`.

    And axes (k, 3, 3) to the orientation, axes as columns, of the cross-sections of the first k.
    """
    raise NotImplementedError


@singledispatch
def add_wrenches(model, q, forces, moments, out):
    """Add to out (n,) the generalised force of forces and moments on those points.

    The transpose of the derivative of `locate`, and of the rotation of the cross-sections: both
    must agree exactly, so that the work of a tension is that of the change of its tendon's length.

    Args:
        model: Data of a model.
        q: (n,).
        forces: (n_points, 3) [N].
        moments: (k, 3) [N m], on the first k points.
        out: (n,).

    Raises:
        ValueError: There are not as many forces as points.
    """
    raise NotImplementedError


@singledispatch
def channel_tangents(model, q, out):
    """Set out (n_samples, 3) to the tangents of the channels by the arc length in the rod.

    At the samples `actuation.sample_*`, in any axes: their length is how much a channel is longer
    than the straight rod there.
    """
    raise NotImplementedError


@singledispatch
def add_channel_pulls(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_samples, 3) [N m] against the tangents.

    The negative transpose of the derivative of `channel_tangents`, in the same axes.
    """
    raise NotImplementedError


@singledispatch
def add_internal_tangent(model, q, v, damping, mass, out):
    """Add K + damping D + mass M of `internal_residual` to out (n, 3 k + 1); whether that is known.

    A model may leave this out: then differences are taken.
    """
    raise NotImplementedError


@singledispatch
def potential(model, q):
    """Elastic and gravitational energy [J]; gravity's is zero in the straight pose."""
    raise NotImplementedError


@singledispatch
def momentum(model, q, v, out):
    """Set out (6,) to linear [N s] and angular momentum about the origin [N m s]."""
    raise NotImplementedError


def implement(data_class: type, *modules: ModuleType) -> None:
    """Let the kernels of some modules be the functions above of the same names for data of a class.

    Args:
        data_class: A structure.
        *modules: Where its kernels are; those of other names are left out.
    """
    found = {"add_internal_tangent": _no_tangent}
    for module in modules:
        found |= {name: each for name, each in vars(module).items() if hasattr(each, "py_func")}
    for name, each in found.items():
        if hasattr(globals().get(name), "registry"):
            implementation(globals()[name], data_class)(each)


@kernel
def _no_tangent(model, q, v, damping, mass, out):
    """That of a model which leaves it out."""
    return False


# ---------------------------------------------------------------- the same for all models


@kernel
def tendon_lengths(model, q, out):
    """Set out (n_tendons,) [m] to the tendons' lengths inside the robot."""
    points = np.empty((len(model.actuation.point_station), 3), q.dtype)
    tangents = np.empty((len(model.actuation.sampled), 3), q.dtype)
    locate(model, q, points, np.empty((0, 3, 3), q.dtype))
    channel_tangents(model, q, tangents)
    _set_lengths(model.actuation, points, tangents, out)


@kernel
def _set_lengths(actuation, points, tangents, out):
    """As `tendon_lengths`, given the points and the tangents of the channels."""
    out[:] = 0.0
    add_path_lengths(actuation, points, out)
    for m in range(len(tangents)):
        x = row3(tangents, m)
        out[actuation.sampled[m]] += actuation.sample_size[m] * np.sqrt(dot3(x, x))


@kernel
def add_applied(model, q, u, out):
    """Add B(q) u to out (n,): the generalised force of loads and tendons."""
    actuation = model.actuation
    n_points, n_tendons = len(actuation.point_station), len(actuation.straight)
    n_loads = len(actuation.load_follows)
    points = np.empty((n_points, 3), q.dtype)
    forces = np.zeros((n_points, 3), q.dtype)
    moments = np.zeros((n_loads if actuation.moments else 0, 3), q.dtype)
    axes = np.empty((n_loads if actuation.followers else 0, 3, 3), q.dtype)
    if n_points > n_loads or actuation.followers:
        locate(model, q, points, axes)
    _set_loads(actuation, axes, u[n_tendons:], forces, moments)
    if n_tendons > 0:
        _add_tendons(model, q, u[:n_tendons], points, forces, out)
    if n_points > 0:
        add_wrenches(model, q, forces, moments, out)


@kernel
def _set_loads(actuation, axes, amplitude, forces, moments):
    """Set the loads' forces, and their moments if any has one."""
    for k in range(len(amplitude)):
        force = scaled(amplitude[k], row3(actuation.load_force, k))
        moment = scaled(amplitude[k], row3(actuation.load_moment, k))
        if actuation.load_follows[k]:
            force, moment = transformed(axes[k], force), transformed(axes[k], moment)
        store(forces[k], force)
        if len(moments) > 0:
            store(moments[k], moment)


@kernel
def _add_tendons(model, q, u, points, forces, out):
    """Add the pull of the tendons: on guides to forces (n_points, 3), in channels to out (n,)."""
    actuation, n_tendons = model.actuation, len(u)
    tangents = np.empty((len(actuation.sampled), 3), q.dtype)
    lengths, tension = np.zeros(n_tendons, q.dtype), np.empty(n_tendons, q.dtype)
    if len(tangents) > 0:
        channel_tangents(model, q, tangents)
    if actuation.by_length:
        _set_lengths(actuation, points, tangents, lengths)
    tendon_tensions(actuation, u, lengths, tension)
    add_path_forces(actuation, points, tension, forces)
    for m in range(len(tangents)):
        x = row3(tangents, m)
        pull = tension[actuation.sampled[m]] * actuation.sample_size[m] / np.sqrt(dot3(x, x))
        store(tangents[m], scaled(pull, x))
    if len(tangents) > 0:
        add_channel_pulls(model, q, tangents, out)


@kernel
def residual(model, q, v, a, u, out):
    """Set out (n,) to M(q) a + k(q, v) - f(q, v) - B(q) u, zero on every motion."""
    internal_residual(model, q, v, a, out)
    if len(u) > 0:
        applied = np.zeros(len(out), out.dtype)
        add_applied(model, q, u, applied)
        for i in range(len(out)):
            out[i] -= applied[i]


@kernel
def acceleration(model, q, v, u, out):
    """Set out (n,) to the acceleration in state (q, v) under inputs u."""
    zero = np.zeros(len(q), q.dtype)
    force = np.empty(len(q), q.dtype)
    residual(model, q, v, zero, u, force)
    for i in range(len(q)):
        force[i] = -force[i]
    solve_mass(model, q, force, out)


@kernel
def kinetic_energy(model, q, v):
    """Kinetic energy [J]: v M(q) v / 2."""
    zero = np.zeros_like(q)
    with_v, without = np.empty_like(q), np.empty_like(q)
    internal_residual(model, q, zero, v, with_v)
    internal_residual(model, q, zero, zero, without)
    return 0.5 * np.dot(v, with_v - without)


@kernel
def bandwidth(model):
    """Number of diagonals to either side of the main one that the iteration matrix fills."""
    return min(model.n - 1, (model.reach + 1) * model.block - 1)


#: Relative size of a difference step; the residual's rounding error is then about 1e-9 of it.
_STEP = 1e-7


@kernel
def iteration_matrix(model, q, v, a, u, damping, mass, out):
    """Set out to K + damping D + mass M, the derivatives of the residual by q, v and a.

    Args:
        model: Data of a model.
        q, v, a: (n,).
        u: (n_inputs,).
        damping, mass: Factors.
        out: (n, 3 k + 1) with k = bandwidth(model): row i holds column j at j - i + k; the last
            k columns are room for `band.factor` and set to zero.
    """
    out[:] = 0.0
    known = add_internal_tangent(model, q, v, damping, mass, out)
    if not known or applied_forces_turn(model):
        add_differences(model, (q, v, a, u), (1.0, damping, mass), known, _STEP, out)


@kernel
def applied_forces_turn(model):
    """Whether loads or tendons depend on the coordinates, beyond dead forces on points."""
    actuation = model.actuation
    return actuation.moments or actuation.followers or len(actuation.straight) > 0


@kernel
def add_differences(model, motion, factors, applied_only, step, out):
    """Add the derivative of the residual by a change of q, v and a (n,) together.

    Columns whose rows do not overlap share one, so the cost does not grow with n where the
    coupling is local.

    Args:
        model: Data of a model.
        motion: q, v, a (n,) and u; of complex numbers for an imaginary step.
        factors: What each of q, v and a moves by.
        applied_only: Whether only of that part of it which loads and tendons cause.
        step: Of the difference, of a coordinate's scale. An imaginary one whose square vanishes
            beside one is exact to rounding.
        out: As in `iteration_matrix`.
    """
    (q, v, a, u), (by_q, by_v, by_a) = motion, factors
    n, width = model.n, bandwidth(model)
    block, reach = model.block, model.reach
    group = min(n, (2 * reach + 1) * block)
    base, moved = np.zeros_like(q), np.empty_like(q)
    if step.real != 0:  # an imaginary change is seen without
        _differentiated(model, q, v, a, u, applied_only, base)
    q1, v1, a1 = q.copy(), v.copy(), a.copy()
    for first in range(group):
        for j in range(first, n, group):
            change = (q[j] + step * model.scale[j]) - q[j]  # what is added, after rounding
            q1[j] = q[j] + by_q * change
            v1[j] = v[j] + by_v * change
            a1[j] = a[j] + by_a * change
        _differentiated(model, q1, v1, a1, u, applied_only, moved)
        for j in range(first, n, group):
            change = (q[j] + step * model.scale[j]) - q[j]
            home = j // block
            for i in range(max(0, (home - reach) * block), min(n, (home + reach + 1) * block)):
                out[i, j - i + width] += ((moved[i] - base[i]) / change).real
            q1[j], v1[j], a1[j] = q[j], v[j], a[j]


@kernel
def _differentiated(model, q, v, a, u, applied_only, out):
    """Set out (n,) to the residual, or to that part of it which loads and tendons cause."""
    if applied_only:
        out[:] = 0.0
        add_applied(model, q, u, out)
        for i in range(len(out)):
            out[i] = -out[i]
    else:
        residual(model, q, v, a, u, out)
