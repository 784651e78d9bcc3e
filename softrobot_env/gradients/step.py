"""One linearly implicit Euler step of a chain, as `scene.integration.euler` takes it, and back.

With the moment arms C of springs of drives and of friction that sticks, their impulses s and what
they give way by, E, the change w of the velocities v in a step h solves

    A w + C' s = h (f - h K v),    C (v + w) = E s.

The adjoint solves the same symmetric system for what is wanted of the step's end; then derivatives
by all else are those of a work, that of the unbalanced forces along the adjoint a. Most of it is h
times the power of the bodies' inertia, of a twist of every body by a.
"""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit
from softrobot_env.scene.integration import articulated
from softrobot_env.scene.integration.articulated import Tree
from softrobot_env.scene.integration.linear_algebra import dot

from . import chain
from . import model as m
from .chain import ACCELERATION, ADJOINT, BY_ADJOINT, BY_END, BY_LENGTHS, BY_RATE, END, VELOCITY

#: As `scene.integration.friction`: what sticks gives way by this share, and what is rounding.
_GIVE, _SLOW, _WEAK, _GUESSES = 1e-9, 1e-9, 1e-7, 60


class Step(NamedTuple):
    """An Euler step from a posture.

    Attributes:
        tree: Factors of the mass matrix with springs and dampers.
        diagonal: (nv,), those.
        answers: (1 + columns, nv), change by forces and by the impulses of the columns.
        coupling, factor: (columns, columns), rates by impulses, and factors of the system.
        active, give, impulse: (columns,), whether one is unknown, what it gives way by, and it.
        slide: (columns,), whether what rubs slides, by the sign of the length's rate, or sticks.
        change: (nv,), of velocities.
    """

    tree: Tree
    diagonal: ndarray
    answers: ndarray
    coupling: ndarray
    factor: ndarray
    active: ndarray
    give: ndarray
    impulse: ndarray
    slide: ndarray
    change: ndarray


class Back(NamedTuple):
    """Derivatives of something.

    Attributes:
        q, v: (nv,), by the state.
        controls: (nu,).
        adjoint: (1, nv), what the last step's system was solved for.
        end: (nv,), velocities at its end.
        holding: (columns,), the adjoint of its impulses.
        values: By the numbers of the chain.
    """

    q: ndarray
    v: ndarray
    controls: ndarray
    adjoint: ndarray
    end: ndarray
    holding: ndarray
    values: m.Values


@jit
def euler(plan, values, at, step, h):
    """Find the change of the velocities in a step [s] from a posture."""
    for i in range(at.v.size):
        own = values.joint[i]
        step.diagonal[i] = own[m.ARMATURE] + h * (own[m.DAMP] + h * own[m.STIFF])
        step.answers[0, i] = h * (at.force[i] - h * own[m.STIFF] * at.v[i])
    columns = at.columns.shape[0]
    for c in range(columns):
        for i in range(at.v.size):
            step.answers[1 + c, i] = at.columns[c, i]
    articulated.factorize(step.tree, at.axes, at.inertias, step.diagonal)
    for c in range(1 + columns):
        articulated.solve(step.tree, step.answers[c : c + 1].T, 1)
    for i in range(at.v.size):
        step.change[i] = step.answers[0, i]
    if columns:
        _hold(plan, values, at, step, h)


@jit
def _hold(plan, values, at, step, h):
    """Find impulses, and let them act."""
    columns, wound = at.columns.shape[0], plan.wound.size
    for c in range(columns):
        for d in range(columns):
            step.coupling[c, d] = dot(at.columns[c], step.answers[1 + d])
        if c < wound:
            step.active[c] = 1.0 if at.law[plan.wound[c]].real == 0 else 0.0
            step.give[c] = -1 / (h * h * values.drive[plan.wound[c], m.BY_LENGTH])
        else:
            step.give[c] = _GIVE * step.coupling[c, c]
    for _ in range(_GUESSES):
        _impulses(plan, values, at, step, h)
        if wound == columns or not _mended(plan, values, at, step, h):
            break
    for c in range(columns):
        for i in range(at.v.size):
            step.change[i] -= step.impulse[c] * step.answers[1 + c, i]


@jit
def _impulses(plan, values, at, step, h):
    """Impulses by the guess of what slides."""
    columns, wound = at.columns.shape[0], plan.wound.size
    for c in range(columns):
        step.impulse[c] = 0.0
        if c >= wound:
            friction = values.tendon[plan.rubs[c - wound], m.FRICTION]
            step.active[c] = 1.0 if step.slide[c].real == 0 else 0.0
            step.impulse[c] = h * step.slide[c] * friction
    found = step.factor[columns]
    for c in range(columns):
        found[c] = 0.0
        for d in range(c + 1):
            both = step.active[c].real != 0 and step.active[d].real != 0
            step.factor[c, d] = step.coupling[c, d] if both else 0.0
        if step.active[c].real == 0:
            step.factor[c, c] = 1.0
            continue
        step.factor[c, c] += step.give[c]
        found[c] = dot(at.columns[c], at.v) + dot(at.columns[c], step.answers[0])
        for d in range(columns):
            found[c] -= step.coupling[c, d] * step.impulse[d]
    _factorize(step.factor, columns)
    _substitute(step.factor, found, columns)
    for c in range(columns):
        step.impulse[c] += found[c]


@jit
def _factorize(matrix, n):
    """Factors L' D L of (n, n), of which the lower half is given, in its place, from the last row.

    L has ones on its diagonal, where the inverse of D is kept.
    """
    for i in range(n - 1, -1, -1):
        inverse = 1 / matrix[i, i]
        for j in range(i):
            share = matrix[i, j] * inverse
            for k in range(j + 1):
                matrix[j, k] -= share * matrix[i, k]
        for k in range(i):
            matrix[i, k] *= inverse
        matrix[i, i] = inverse


@jit
def _substitute(factor, x, n):
    """x (n,) becomes the solution, by the factors of `_factorize`."""
    for i in range(n - 1, -1, -1):
        for k in range(i):
            x[k] -= factor[i, k] * x[i]
    for i in range(n):
        rest = x[i] * factor[i, i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest


@jit
def _mended(plan, values, at, step, h):
    """Whether the guess of what slides was wrong, which it no more is of some."""
    columns, wound, wrong = at.columns.shape[0], plan.wound.size, False
    largest, fastest, rates = 0.0, 0.0, step.factor[columns]
    for c in range(columns):
        rates[c] = dot(at.columns[c], at.v) + dot(at.columns[c], step.answers[0])
        for d in range(columns):
            rates[c] -= step.coupling[c, d] * step.impulse[d]
        if c >= wound:
            largest = max(largest, abs(step.impulse[c].real))
            fastest = max(fastest, abs(rates[c].real))
    for c in range(wound, columns):
        side, impulse = step.slide[c].real, step.impulse[c].real
        most = h * values.tendon[plan.rubs[c - wound], m.FRICTION].real
        if side == 0:
            if abs(impulse) > most + _WEAK * largest:
                step.slide[c], wrong = (1.0 if impulse > 0 else -1.0), True
        elif side * rates[c].real < -_SLOW * fastest:
            step.slide[c], wrong = 0.0, True
    return wrong


# ---------------------------------------------------------------- and back


@jit
def pull_back(plan, values, at, step, h, controls, room, back):
    """Derivatives by what a step [s] begins with, in place of those by what it ends with.

    Those by controls and the chain's numbers are added up.
    """
    adjoint, columns = back.adjoint[0], at.columns.shape[0]
    for i in range(at.v.size):
        back.v[i] += h * back.q[i]
        adjoint[i] = -back.v[i]
        back.end[i] = at.v[i] + step.change[i]
    articulated.solve(step.tree, back.adjoint.T, 1)
    for c in range(columns):
        back.holding[c] = dot(at.columns[c], adjoint) if step.active[c].real != 0 else 0.0
    _substitute(step.factor, back.holding, columns)
    for c in range(columns):
        for i in range(at.v.size):
            adjoint[i] -= back.holding[c] * step.answers[1 + c, i]
    _work(plan, values, at, step.change, h, room, back)
    _work_of_joints(values, at, step.change, h, back)
    work_of_forces(plan, values, at, h, controls, room, back)
    for c in range(columns):
        _work_of_column(plan, values, at, step, c, h, room, back)
    sweep(plan, values, at, step.change, 1 / h, room, back)


@jit
def pull_back_rest(plan, values, at, step, controls, room, back):
    """Derivatives of the work of what acts at rest along turns (nv,), the adjoint of `back`."""
    for i in range(at.v.size):
        step.change[i] = back.end[i] = back.q[i] = 0.0
        back.adjoint[0, i] *= -1
    _work(plan, values, at, step.change, 1.0, room, back)
    _work_of_joints(values, at, step.change, 1.0, back)
    work_of_forces(plan, values, at, 1.0, controls, room, back)
    sweep(plan, values, at, step.change, 1.0, room, back)


@jit
def _work(plan, values, at, change, h, room, back):
    """Fields, and the derivatives by them of the work of the bodies' inertia."""
    fields, adjoint = room.fields, back.adjoint[0]
    chain.move_bodies(plan, at, at.v, fields[VELOCITY])
    chain.accelerate_bodies(plan, values, at, change, 1 / h, fields)
    chain.move_bodies(plan, at, adjoint, fields[ADJOINT])
    chain.move_bodies(plan, at, back.end, fields[END])
    chain.rate_tendons(plan, values, at, adjoint, fields[ADJOINT], room.rates[0], room.scratch[0])
    chain.rate_tendons(plan, values, at, back.end, fields[END], room.rates[1], room.scratch[0])
    forget(room)
    momentum, across = room.scratch[0], room.scratch[1]
    for b in range(1, plan.parents.size):
        if not plan.massive[b]:
            continue
        velocity, given, along = (
            fields[VELOCITY, b],
            fields[ACCELERATION, b],
            fields[ADJOINT, b],
        )
        for k in range(6):
            momentum[k] = across[k] = 0.0
        inertia = at.inertia[b]
        chain.add_momentum(momentum, h, inertia, velocity)
        chain.add_motion(across, 1.0, along, velocity)
        chain.add_momentum(room.back[ADJOINT, b], h, inertia, given)
        chain.add_wrench(room.back[ADJOINT, b], 1.0, velocity, momentum)
        chain.add_momentum(room.back[ACCELERATION, b], h, inertia, along)
        chain.add_momentum(room.back[VELOCITY, b], h, inertia, across)
        chain.add_wrench(room.back[VELOCITY, b], -1.0, along, momentum)
        _work_by_inertia(at, b, h, (along, given), back.values.inertia[b])
        _work_by_inertia(at, b, h, (across, velocity), back.values.inertia[b])


@jit
def forget(room):
    """Let all derivatives by fields, wrenches and seeds be zero."""
    for f in range(room.back.shape[0]):
        chain.clear(room.back[f])
    chain.clear(room.wrench)
    chain.clear(room.seeds)


@jit
def _work_by_inertia(at, b, h, twists, out):
    """Add h times the derivatives of x . I y, of two twists, by an inertia in its body."""
    frame = at.frame[b]
    (x, y), place = twists, at.place[b]
    a0, a1, a2, b0, b1, b2 = _seen(frame, place, x)
    c0, c1, c2, d0, d1, d2 = _seen(frame, place, y)
    out[0] += h * a0 * c0
    out[1] += h * a1 * c1
    out[2] += h * a2 * c2
    out[3] += h * (a0 * c1 + a1 * c0)
    out[4] += h * (a0 * c2 + a2 * c0)
    out[5] += h * (a1 * c2 + a2 * c1)
    out[6] += h * (d1 * a2 - d2 * a1 + b1 * c2 - b2 * c1)
    out[7] += h * (d2 * a0 - d0 * a2 + b2 * c0 - b0 * c2)
    out[8] += h * (d0 * a1 - d1 * a0 + b0 * c1 - b1 * c0)
    out[9] += h * (b0 * d0 + b1 * d1 + b2 * d2)


@jit
def _seen(frame, place, twist):
    """A twist about a body's origin, along its axes."""
    x, y, z = twist[0], twist[1], twist[2]
    u = twist[3] + y * place[2] - z * place[1]
    v = twist[4] + z * place[0] - x * place[2]
    w = twist[5] + x * place[1] - y * place[0]
    return (
        frame[0] * x + frame[3] * y + frame[6] * z,
        frame[1] * x + frame[4] * y + frame[7] * z,
        frame[2] * x + frame[5] * y + frame[8] * z,
        frame[0] * u + frame[3] * v + frame[6] * w,
        frame[1] * u + frame[4] * v + frame[7] * w,
        frame[2] * u + frame[5] * v + frame[8] * w,
    )


@jit
def _resist_back(own, out, along, way, rate):
    """Derivatives of a share of what resists, see `Values.joint`; that by the way is returned."""
    slope = along * (own[m.STIFF] + way * (2 * own[m.SQUARE] + 3 * way * own[m.CUBE]))
    out[m.REST] -= slope
    out[m.STIFF] += along * way
    out[m.SQUARE] += along * way * way
    out[m.CUBE] += along * way * way * way
    out[m.DAMP] += along * rate
    return slope


@jit
def _work_of_joints(values, at, change, h, back):
    """Derivatives of the work of springs, dampers and armature."""
    for i in range(at.v.size):
        own, out, along = values.joint[i], back.values.joint[i], h * back.adjoint[0, i]
        end = at.v[i] + change[i]
        back.q[i] += _resist_back(own, out, along, at.q[i] - own[m.REST], end)
        back.v[i] += along * (own[m.DAMP] + h * own[m.STIFF])
        out[m.STIFF] += along * h * end
        out[m.ARMATURE] += along * change[i] / h


@jit
def work_of_forces(plan, values, at, h, controls, room, back):
    """Derivatives of the work of tendons and loads; those by lengths and rates are seeds."""
    for t in range(at.length.size):
        own, along = values.tendon[t], h * room.rates[0, t]
        way, out = at.length[t] - own[m.REST], back.values.tendon[t]
        room.seeds[BY_LENGTHS, t] += _resist_back(own, out, along, way, at.rate[t])
        room.seeds[BY_RATE, t] += along * own[m.DAMP]
        room.seeds[BY_ADJOINT, t] += h * at.pull[t]
    for d in range(plan.tendon.size):
        t = plan.tendon[d]
        if t < 0:
            _work_of_load(plan, values, at, d, h, controls, room, back)
            continue
        weight = -h * plan.gear[d] * room.rates[0, t]
        room.seeds[BY_LENGTHS, t] += drive_back(plan, values, at, d, weight, controls, back)


@jit
def drive_back(plan, values, at, d, weight, controls, back):
    """Derivatives of a weight times the force of a drive; that by its tendon's length."""
    out, control = back.values.drive[d], chain.within(controls[d], plan.control[:, d])
    if at.law[d].real != 0:
        out[m.LEAST if at.law[d].real < 0 else m.MOST] += weight
        return 0.0 * weight
    if control.real == controls[d].real:
        back.controls[d] += weight * values.drive[d, m.GAIN]
    out[m.GAIN] += weight * control
    out[m.CONSTANT] += weight
    t = plan.tendon[d]
    if t < 0:
        return 0.0 * weight
    out[m.BY_LENGTH] += weight * plan.gear[d] * at.length[t]
    return weight * plan.gear[d] * values.drive[d, m.BY_LENGTH]


@jit
def _work_of_load(plan, values, at, d, h, controls, room, back):
    site = -1 - plan.tendon[d]
    load, point, speed = room.scratch[0], room.scratch[1], room.scratch[2]
    body = chain.find_point(plan, values, at, site, point)
    along, own, moved = (
        room.fields[ADJOINT, body],
        room.back[ADJOINT, body],
        room.wrench[body],
    )
    chain.direct_load(plan, at, d, site, load)
    chain.find_velocity(speed, along, point)
    power = chain.product(load, along, 3) + chain.product(load[3:], speed, 3)
    amount = chain.drive_force(plan, values, at, controls, d)
    drive_back(plan, values, at, d, -h * power, controls, back)
    for k in range(6):
        load[k] *= -h * amount
        own[k] += load[k]
    chain.add_cross(own, 0, 1.0, point, load[3:])
    if plan.gear[d] <= 0:
        chain.add_cross(moved, 0, 1.0, speed, load[3:])
        chain.add_cross(moved, 0, 1.0, along, load)
    for k in range(3):
        speed[k] = 0.0
    chain.add_cross(speed, 0, 1.0, load[3:], along)
    chain.add_back(back.values.site[site], at.frame[body], speed)


@jit
def _work_of_column(plan, values, at, step, c, h, room, back):
    """Derivatives of the work of an impulse, and of what it answers to."""
    wound = plan.wound.size
    if c < wound:
        d = plan.wound[c]
        t, share = plan.tendon[d], plan.gear[d]
        given = back.holding[c] * step.impulse[c] / (h * values.drive[d, m.BY_LENGTH]) ** 2
        back.values.drive[d, m.BY_LENGTH] -= given
    else:
        t, share = plan.rubs[c - wound], 1.0
        if step.active[c].real == 0:
            back.values.tendon[t, m.FRICTION] += h * step.slide[c] * room.rates[0, t]
    room.seeds[BY_ADJOINT, t] += share * step.impulse[c]
    room.seeds[BY_END, t] += share * back.holding[c]


@jit
def _field(seed):
    """The field of a row of seeds."""
    return ADJOINT if seed == BY_ADJOINT else END if seed == BY_END else VELOCITY


@jit
def _spread(plan, values, at, room, back):
    """From seeds, derivatives by lengths and rates of tendons, to those by joints and bodies."""
    for t in range(at.length.size):
        by_length, by_rate = room.seeds[BY_LENGTHS, t], room.seeds[BY_RATE, t]
        along, end = room.seeds[BY_ADJOINT, t], room.seeds[BY_END, t]
        for k in range(plan.begin[t], plan.begin[t + 1]):
            i = plan.parts[k, 0]
            if plan.parts[k, 1] >= 0:
                _spread_span(plan, values, at, t, k, room, back)
                continue
            back.q[i] += values.arm[k] * by_length
            back.v[i] += values.arm[k] * (by_rate + end)
            back.values.arm[k] += at.q[i] * by_length + at.v[i] * by_rate
            back.values.arm[k] += back.adjoint[0, i] * along + back.end[i] * end


@jit
def _spread_span(plan, values, at, t, k, room, back):
    span, seeds = at.span[k], room.seeds
    point, moved, speed, apart = room.scratch[0], room.scratch[1], room.scratch[2], room.scratch[3]
    for r in range(3):
        apart[r] = 0.0
    for side in range(2):
        body = chain.find_point(plan, values, at, plan.parts[k, side], point)
        for f in range(BY_LENGTHS):
            chain.find_velocity(speed, room.fields[_field(f), body], point)
            for r in range(3):
                apart[r] += (2 * side - 1) * seeds[f, t] * speed[r]
    along = chain.product(apart, span, 3)
    for r in range(3):
        apart[r] = (apart[r] - along * span[r]) / span[3] + seeds[BY_LENGTHS, t] * span[r]
    for side in range(2):
        sign = 2.0 * side - 1
        body = chain.find_point(plan, values, at, plan.parts[k, side], point)
        own = room.wrench[body]
        chain.add_cross(own, 0, sign, point, apart)
        for r in range(3):
            own[3 + r] += sign * apart[r]
            moved[r] = sign * apart[r]
        for f in range(BY_LENGTHS):
            seed = sign * seeds[f, t]
            if seed == 0:
                continue
            twist, by_field = room.fields[_field(f), body], room.back[_field(f), body]
            chain.find_velocity(speed, twist, point)
            chain.add_cross(own, 0, seed, speed, span)
            chain.add_cross(by_field, 0, seed, point, span)
            chain.add_cross(moved, 0, seed, span, twist)
            for r in range(3):
                by_field[3 + r] += seed * span[r]
        chain.add_back(back.values.site[plan.parts[k, side]], at.frame[body], moved)


@jit
def sweep(plan, values, at, change, share, room, back):
    """From derivatives by fields and seeds to those by all else, from the tips to the base.

    Accelerations were shares of changes (nv,). The fields are lost.
    """
    _spread(plan, values, at, room, back)
    by, total = room.back, room.scratch[0]
    for b in range(plan.parents.size - 1, 0, -1):
        parent = plan.parents[b]
        for i in range(plan.first[b] + plan.count[b] - 1, plan.first[b] - 1, -1):
            _pass_joint(at, i, b, change[i] * share, room, back)
        _pass_on(b, room, total)
        chain.add_back(back.values.place[b], at.frame[parent], total[3:])
        if plan.turned[b]:
            chain.add_cross(total, 0, -1.0, at.place[b], total[3:])
            _turn_back(
                back.values.turn[b], values.turn[b], at.frame[parent], total, room.scratch[1]
            )
        for f in range(by.shape[0]):
            for k in range(6):
                by[f, parent, k] += by[f, b, k]
        for k in range(6):
            room.wrench[parent, k] += room.wrench[b, k]
    for k in range(3):
        back.values.gravity[0, k] -= by[ACCELERATION, 0, 3 + k]


@jit
def _pass_joint(at, i, b, given, room, back):
    """Derivatives by a joint and its velocity; fields of its body become those before it."""
    axis, fields, by, total = at.axis[i], room.fields, room.back, room.scratch[0]
    velocity = fields[VELOCITY, b]
    chain.add_wrench(by[VELOCITY, b], at.v[i], axis, by[ACCELERATION, b])
    for k in range(6):
        total[k] = by[VELOCITY, b, k] + by[END, b, k]
    chain.add_wrench(total, -1.0, velocity, by[ACCELERATION, b])
    back.v[i] += chain.product(axis, total, 6)
    chain.add_motion(fields[ACCELERATION, b], -at.v[i], velocity, axis)
    for k in range(6):
        fields[ACCELERATION, b, k] -= given * axis[k]
        velocity[k] -= at.v[i] * axis[k]
        fields[ADJOINT, b, k] -= back.adjoint[0, i] * axis[k]
        fields[END, b, k] -= back.end[i] * axis[k]
    _pass_on(b, room, total)
    back.q[i] += chain.product(axis, total, 6)


@jit
def _pass_on(b, room, total):
    """The derivative (6,) by a turn of what lies beyond a body's joint, with its fields before."""
    for k in range(6):
        total[k] = room.wrench[b, k]
    for f in range(room.back.shape[0]):
        chain.add_wrench(total, -1.0, room.fields[f, b], room.back[f, b])


@jit
def _turn_back(out, turn, frame, moment, own):
    """Add a derivative by small turns (3,) of the world to that by a quaternion (4,) in a frame."""
    for k in range(3):
        own[k] = 0.0
    chain.add_back(own, frame, moment)
    out[0] -= 2 * chain.product(own, turn[1:], 3)
    for k in range(3):
        out[1 + k] += 2 * turn[0] * own[k]
    chain.add_cross(out, 1, 2.0, own, turn[1:])
