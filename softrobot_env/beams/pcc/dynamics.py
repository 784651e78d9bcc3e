"""Kernels of the piecewise constant curvature model; data as in `pcc.PccData`.

Inertia sits in rigid bodies at sections of the rod. The recursions run over the pieces from the
clamp to the tip (motion) and back (forces).
"""

import numpy as np

from softrobot_env.compile.kernels import kernel

from ..actuation import channel_arm, channel_tangent, check_forces
from ..numerics.quaternions import (
    accumulate,
    add,
    cross,
    difference,
    dot3,
    row3,
    scaled,
    set_axes,
    store,
    vector,
)
from .constant_strain import (
    clamp,
    compose,
    motion,
    motion_bias,
    position,
    stumpff,
    to_axes,
    to_world,
    transmit,
    turn,
    turn_back,
)

#: What the work array (pieces, COLUMNS, 3) of the Newton-Euler recursion holds of a piece: its
#: rotation vector and two derivatives, c_0 to c_5 (two columns), force and moment on the body at
#: its end in that body's frame; and of the other bodies or points, in the frame of the start,
#: force, moment about the start and generalised force.
ROTATION, RATE, SECOND, STUMPFF = 0, 1, 2, 3
END_FORCE, END_MOMENT, FORCE, MOMENT, LOAD = 5, 6, 7, 8, 9
COLUMNS = 10


@kernel
def _set_rotations(model, q, out):
    """Set out (pieces, 3) to the pieces' rotation vectors l (-gamma, beta, tau) [rad].

    Linear in q, so also for rates and accelerations.
    """
    block, length = model.block, model.length
    for i in range(len(out)):
        j = i * block
        out[i, 0] = -length[i] * q[j + 1] if block > 1 else 0 * q[j]
        out[i, 1] = length[i] * q[j]
        out[i, 2] = length[i] * q[j + 2] if block > 2 else 0 * q[j]


@kernel
def _turns(model, q):
    """The same of a model, (pieces, 3)."""
    turns = np.empty((model.pieces, 3), q.dtype)
    _set_rotations(model, q, turns)
    return turns


@kernel
def _add_generalised(model, i, load, out):
    """Add a generalised force on the rotation vector of piece i to that on the coordinates."""
    block, length = model.block, model.length[i]
    k = i * block
    out[k] += length * load[1]
    if block > 1:
        out[k + 1] -= length * load[0]
    if block > 2:
        out[k + 2] += length * load[2]


# ---------------------------------------------------------------- equations of motion


@kernel
def internal_residual(model, q, v, a, out):
    """M a + k + elastic and damping forces less gravity (n,), by the Newton-Euler recursion."""
    work = np.zeros((model.pieces, COLUMNS, 3), out.dtype)
    _set_rotations(model, q, work[:, ROTATION])
    _set_rotations(model, v, work[:, RATE])
    _set_rotations(model, a, work[:, SECOND])
    _add_inertial_wrenches(model, work)
    for k in range(len(out)):
        i = k // model.block
        out[k] = _stiffness(model, k) * (q[k] + model.damping_time[i] * v[k])
    _gather(model, work, out)


@kernel
def _stiffness(model, k):
    """Stiffness against coordinate k."""
    i = k // model.block
    return model.twisting[i] if k % model.block == 2 else model.bending[i]


@kernel
def _add_inertial_wrenches(model, work):
    """Complete the work array with what moves the bodies, given the rotations."""
    length, first, bodies = model.length, model.first[0], model.bodies
    zero = 0 * work[0, 0, 0]
    omega = alpha = zero, zero, zero
    # Gravity acts like an upward acceleration of the clamp.
    rise = difference(omega, model.gravity)
    for i in range(len(work)):
        row, last = work[i], first[i + 1] - 1
        whole, rate, second = vector(row[ROTATION]), vector(row[RATE]), vector(row[SECOND])
        for k in range(first[i], last + 1):
            u = bodies[k, 0]
            phi = scaled(u, whole)
            c = stumpff(dot3(phi, phi))
            w, aw, r = _moved(
                u * length[i], c, phi, scaled(u, rate), scaled(u, second), omega, alpha, rise
            )
            w, aw, r = turn_back(c, phi, w), turn_back(c, phi, aw), turn_back(c, phi, r)
            force, moment = scaled(bodies[k, 1], r), _euler(bodies[k], w, aw)
            if k < last:
                _add_wrench(u, length[i], c, phi, force, moment, row)
            else:
                store(row[STUMPFF], c[:3])
                store(row[STUMPFF + 1], c[3:6])
                store(row[END_FORCE], force)
                store(row[END_MOMENT], moment)
                omega, alpha, rise = w, aw, r


@kernel
def _add_wrench(u, length, c, phi, force, moment, row):
    """Add force and moment at the fraction u of a piece, in the section's frame, to its work."""
    load, force, moment = transmit(u * length, c, phi, force, moment)
    accumulate(row[FORCE], force)
    accumulate(row[MOMENT], moment)
    accumulate(row[LOAD], scaled(u, load))


@kernel
def _gather(model, work, out):
    """Add to out (n,) the generalised force of the forces and moments in the work array."""
    zero = 0 * work[0, 0, 0]
    force = moment = zero, zero, zero
    for i in range(len(work) - 1, -1, -1):
        row = work[i]
        c0, c1, c2 = vector(row[STUMPFF])
        c3, c4, c5 = vector(row[STUMPFF + 1])
        c = (c0, c1, c2, c3, c4, c5, zero, zero)
        force, moment = add(force, vector(row[END_FORCE])), add(moment, vector(row[END_MOMENT]))
        load, force, moment = transmit(model.length[i], c, vector(row[ROTATION]), force, moment)
        force, moment = add(force, vector(row[FORCE])), add(moment, vector(row[MOMENT]))
        _add_generalised(model, i, add(load, vector(row[LOAD])), out)


@kernel
def _moved(length, c, phi, rate, second, omega, alpha, rise):
    """Angular velocity, angular and linear acceleration of a section, given those of the start."""
    shift, spin = motion(length, c, phi, rate)
    push, turning = motion(length, c, phi, second)
    push_bias, turning_bias = motion_bias(length, c, phi, rate)
    p = position(length, c, phi)
    swirl = add(cross(omega, p), add(shift, shift))
    a = add(rise, add(cross(alpha, p), cross(omega, swirl)))
    return (
        add(omega, spin),
        add(add(alpha, cross(omega, spin)), add(turning, turning_bias)),
        add(a, add(push, push_bias)),
    )


@kernel
def _euler(body, omega, alpha):
    """Moment I alpha + omega x I omega [N m] that turns a body, in its principal axes."""
    x, y, z = body[2], body[3], body[4]
    return (
        x * alpha[0] + (z - y) * omega[1] * omega[2],
        y * alpha[1] + (x - z) * omega[2] * omega[0],
        z * alpha[2] + (y - x) * omega[0] * omega[1],
    )


# ---------------------------------------------------------------- mass matrix


@kernel
def project(model, q, v):
    """Do nothing: no coordinate is redundant."""


@kernel
def solve_mass(model, q, force, out):
    """Set out (n,) to M(q)^-1 force; overwrites the force."""
    m = np.empty((model.n, model.n), q.dtype)
    mass_and_momenta(model, q, m)
    _solve_definite(m, force, out)


@kernel
def _solve_definite(m, x, out):
    """Solve m out = x with m (n, n) = U^T D U, U unit upper triangular; overwrites m and x.

    Cholesky's decomposition without square roots (Golub and van Loan, sec. 4.1).
    """
    n = len(x)
    for k in range(n):
        inverse = 1.0 / m[k, k]
        for i in range(k + 1, n):
            ratio = m[k, i] * inverse
            x[i] -= ratio * x[k]
            for j in range(i, n):
                m[i, j] -= ratio * m[k, j]
        m[k, k] = inverse
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, n):
            total -= m[i, j] * out[j]
        out[i] = total * m[i, i]


#: Rows of an inertia (5, 3) about the origin: three of the moments of inertia, the first moment of
#: the mass, and the mass; of a piece's array, the body at its end comes before the others, then the
#: rotation vector.
CENTRE, MASS, OTHERS, TURN = 3, 4, 5, 10
#: Rows of a coordinate's motion per unit rate (rotation, velocity at the origin), the angular and
#: linear momentum of what it moves, and those of the bodies inside its own piece.
SPIN, VELOCITY, ANGULAR, LINEAR, OWN_ANGULAR, OWN_LINEAR = 0, 1, 2, 3, 4, 5


@kernel
def mass_and_momenta(model, q, out):
    """Set out (n, n) to M(q); motion and momentum (n, 6, 3) per unit rate of each coordinate.

    A piece moves all bodies beyond it as one, whose inertia is accumulated from the tip
    (composite rigid bodies; Featherstone, Rigid Body Dynamics Algorithms, ch. 6). Motions,
    momenta and inertias refer to the origin of the world.
    """
    block = model.block
    moves, inertia = np.zeros((model.n, 6, 3), q.dtype), np.zeros((model.pieces, 11, 3), q.dtype)
    _set_rotations(model, q, inertia[:, TURN])
    out[:] = 0.0
    _set_moves(model, moves, inertia, out)
    for i in range(len(inertia) - 1, -1, -1):
        start = i * block
        for j in range(start, start + block):
            column = moves[j]
            _set_momentum(inertia[i], column)
            for k in range(start, j + 1):
                out[k, j] += _pairing(moves[k], column)
                out[j, k] = out[k, j]
            accumulate(column[ANGULAR], vector(column[OWN_ANGULAR]))
            accumulate(column[LINEAR], vector(column[OWN_LINEAR]))
            for k in range(start):
                out[k, j] = _pairing(moves[k], column)
                out[j, k] = out[k, j]
        if i > 0:
            for d in range(OTHERS):
                accumulate(inertia[i - 1, d], vector(inertia[i, d]))
                accumulate(inertia[i - 1, d], vector(inertia[i, OTHERS + d]))
    return moves


@kernel
def _set_moves(model, moves, inertia, out):
    """Forward pass: motions, inertias, and the share in out of bodies inside their own piece."""
    block, length, first, bodies = model.block, model.length, model.first[0], model.bodies
    axes, x = clamp(0 * inertia[0, TURN, 0])
    for i in range(len(inertia)):
        row, last, start = inertia[i], first[i + 1] - 1, i * block
        own = moves[start : start + block]
        whole = vector(row[TURN])
        for k in range(first[i], last + 1):
            u = bodies[k, 0]
            phi = scaled(u, whole)
            c = stumpff(dot3(phi, phi))
            here = add(x, to_world(axes, position(u * length[i], c, phi)))
            there = compose(axes, c, phi)
            _set_inertia(bodies[k], there, here, row)
            for d in range(block):
                _set_move(u * length[i], c, phi, d, axes, here, own[d])
            if k < last:
                for d in range(OTHERS):
                    accumulate(row[OTHERS + d], vector(row[d]))
                _add_inside(row, own, start, out)
            else:
                axes, x = there, here


@kernel
def _add_inside(inertia, own, start, out):
    """Add the share of a body inside a piece, given the motions of the piece's coordinates."""
    for d in range(len(own)):
        _set_momentum(inertia, own[d])
        accumulate(own[d, OWN_ANGULAR], vector(own[d, ANGULAR]))
        accumulate(own[d, OWN_LINEAR], vector(own[d, LINEAR]))
        for k in range(d + 1):
            out[start + k, start + d] += _pairing(own[k], own[d])


@kernel
def _set_move(length, c, phi, d, axes, x, row):
    """Set the motion of a section at x that coordinate d of its piece causes at unit rate."""
    zero = 0 * phi[0]
    rate = (zero - length * (d == 1), zero + length * (d == 0), zero + length * (d == 2))
    shift, spin = motion(length, c, phi, rate)
    shift, spin = to_world(axes, shift), to_world(axes, spin)
    store(row[SPIN], spin)
    store(row[VELOCITY], add(shift, cross(x, spin)))


@kernel
def _set_inertia(body, axes, x, out):
    """Set the first rows of out to the inertia of a body at x about the origin."""
    ex, ey, ez = axes
    centre, size = scaled(body[1], x), body[1] * dot3(x, x)
    for i in range(3):
        for j in range(3):
            turning = body[2] * ex[i] * ex[j] + body[3] * ey[i] * ey[j] + body[4] * ez[i] * ez[j]
            out[i, j] = turning - centre[i] * x[j]
        out[i, i] += size
    store(out[CENTRE], centre)
    out[MASS, 0] = body[1]


@kernel
def _set_momentum(inertia, row):
    """Set the momentum of an inertia (5, 3) in a coordinate's motion."""
    spin, v, centre = vector(row[SPIN]), vector(row[VELOCITY]), vector(inertia[CENTRE])
    turning = cross(centre, v)
    for i in range(3):
        row[ANGULAR, i] = turning[i] + dot3(vector(inertia[i]), spin)
    store(row[LINEAR], add(scaled(inertia[MASS, 0], v), cross(spin, centre)))


@kernel
def _pairing(move, column):
    """Scalar product of a motion and the momentum of another coordinate."""
    angular = dot3(vector(move[SPIN]), vector(column[ANGULAR]))
    return angular + dot3(vector(move[VELOCITY]), vector(column[LINEAR]))


# ---------------------------------------------------------------- energy and momentum


@kernel
def potential(model, q):
    """Elastic and gravitational energy [J]; gravity's is zero in the straight pose."""
    length, gravity, first, bodies = model.length, model.gravity, model.first[0], model.bodies
    turns, energy = _turns(model, q), 0 * q[0]
    for k in range(len(q)):
        energy += 0.5 * _stiffness(model, k) * q[k] * q[k]
    axes, x = clamp(0 * q[0])
    here, there, start = x, axes, 0.0
    for i in range(len(turns)):
        for k in range(first[i], first[i + 1]):
            u = bodies[k, 0]
            phi = scaled(u, vector(turns[i]))
            c = stumpff(dot3(phi, phi))
            here = add(x, to_world(axes, position(u * length[i], c, phi)))
            there = compose(axes, c, phi)
            height = gravity[0] * here[0] + gravity[1] * here[1]
            height += gravity[2] * (here[2] - start - u * length[i])
            energy -= bodies[k, 1] * height
        axes, x, start = there, here, start + length[i]
    return energy


@kernel
def momentum(model, q, v, out):
    """Set out (6,) to linear [N s] and angular momentum about the origin [N m s]."""
    moves = mass_and_momenta(model, q, np.empty((model.n, model.n), q.dtype))
    out[:] = 0
    for j in range(model.n):
        accumulate(out[:3], scaled(v[j], vector(moves[j, LINEAR])))
        accumulate(out[3:], scaled(v[j], vector(moves[j, ANGULAR])))


# ---------------------------------------------------------------- points and loads


@kernel
def locate(model, q, points, axes):
    """Set the material points (n_points, 3) [m], and the axes (k, 3, 3) of the first sections."""
    length, first, places, turns = model.length, model.first[1], model.points, _turns(model, q)
    zero = 0 * q[0]
    frame, x = clamp(zero)
    for i in range(len(turns)):
        whole = vector(turns[i])
        for m in range(first[i], first[i + 1]):
            u, k = places[m, 0], int(places[m, 3])
            phi = scaled(u, whole)
            c = stumpff(dot3(phi, phi))
            local = position(u * length[i], c, phi)
            if places[m, 1] != 0 or places[m, 2] != 0:
                offset = zero + places[m, 1], zero + places[m, 2], zero
                local = add(local, turn(c, phi, offset))
            store(points[k], add(x, to_world(frame, local)))
            if k < len(axes):
                set_axes(axes[k], *compose(frame, c, phi))
        c = stumpff(dot3(whole, whole))
        x = add(x, to_world(frame, position(length[i], c, whole)))
        frame = compose(frame, c, whole)


@kernel
def add_wrenches(model, q, forces, moments, out):
    """Add to out (n,) the generalised force of forces (n_points, 3) and moments on the points."""
    check_forces(model.actuation, forces)
    length, first, points = model.length, model.first[1], model.points
    work = np.zeros((model.pieces, COLUMNS, 3), out.dtype)
    _set_rotations(model, q, work[:, ROTATION])
    zero = 0 * work[0, 0, 0]
    axes, _ = clamp(zero)
    for i in range(len(work)):
        row = work[i]
        whole = vector(row[ROTATION])
        c = stumpff(dot3(whole, whole))
        store(row[STUMPFF], c[:3])
        store(row[STUMPFF + 1], c[3:6])
        for m in range(first[i], first[i + 1]):
            k = int(points[m, 3])
            u = points[m, 0]
            phi = scaled(u, whole)
            part = stumpff(dot3(phi, phi))
            there = compose(axes, part, phi)
            force = to_axes(there, vector(forces[k]))
            moment = cross((zero + points[m, 1], zero + points[m, 2], zero), force)
            if k < len(moments):
                moment = add(moment, to_axes(there, vector(moments[k])))
            _add_wrench(u, length[i], part, phi, force, moment, row)
        axes = compose(axes, c, whole)
    _gather(model, work, out)


# ---------------------------------------------------------------- continuous channels


@kernel
def channel_tangents(model, q, out):
    """Set out (n_samples, 3) to the tangents of the channels, in the sections' frames."""
    first, turns = model.first_sample, _turns(model, q)
    (_, _, along), _ = clamp(0 * q[0])
    for i in range(len(turns)):
        strain = scaled(1 / model.length[i], vector(turns[i]))
        for m in range(first[i], first[i + 1]):
            store(out[m], channel_tangent(along, strain, model.places[m]))


@kernel
def add_channel_pulls(model, q, forces, out):
    """Add to out (n,) the generalised force of forces (n_samples, 3) against the tangents."""
    first = model.first_sample
    _, none = clamp(0 * q[0])
    for i in range(model.pieces):
        load = none
        for m in range(first[i], first[i + 1]):
            load = difference(load, channel_arm(model.places[m], row3(forces, m)))
        _add_generalised(model, i, scaled(1 / model.length[i], load), out)
