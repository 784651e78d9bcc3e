"""One linearly implicit Euler step of a chain, as `scene.integration.euler` takes it, and back.

With the moment arms C of springs of drives and of friction, and their impulses s, see `holding`,
the change w of the velocities v in a step h solves

    A w + C' s = h (f - h K v).

The adjoint solves the same system, transposed, for what is wanted of the step's end; then
derivatives by all else are those of a work, that of the unbalanced forces along the adjoint a. Most
of it is h times the power of the bodies' inertia, of a twist of every body by a.
"""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit
from softrobot_env.scene.integration import articulated
from softrobot_env.scene.integration.linear_algebra import dot

from . import bends, chain, holding
from . import model as m
from .chain import ACCELERATION, ADJOINT, BY_ADJOINT, BY_END, BY_LENGTHS, BY_RATE, END, VELOCITY

#: Share [1] of a derivative that is looked for.
_TELLING = 1e-10


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
def euler(plan, values, at, step, h, known):
    """Find the change of the velocities in a step [s] from a posture, see `holding.hold`."""
    for i in range(at.v.size):
        own = values.joint[i]
        step.diagonal[i] = own[m.ARMATURE] + h * (own[m.DAMP] + h * own[m.STIFF])
        step.right[i] = h * (at.force[i] - h * own[m.STIFF] * at.v[i])
    articulated.factorize(step.tree, at.axes, at.inertias, step.diagonal)
    holding.hold(plan, values, at, step, h, known)


# ---------------------------------------------------------------- and back


@jit
def pull_back(plan, values, at, step, h, controls, room, back):
    """Derivatives by what a step [s] begins with, in place of those by what it ends with.

    Those by controls and the chain's numbers are added up.
    """
    adjoint, columns, size = back.adjoint[0], at.columns.shape[0], 0.0
    for i in range(at.v.size):
        back.v[i] += h * back.q[i]
        adjoint[i] = -back.v[i]
        back.end[i] = at.v[i] + step.change[i]
    articulated.solve(step.tree, back.adjoint.T, 1)
    if columns:
        size = holding.hold_back(plan, at, step, back)
    _work(plan, values, at, step.change, h, room, back)
    _work_of_joints(values, at, step.change, h, back)
    work_of_forces(plan, values, at, h, controls, room, back)
    for c in range(columns):
        if holding.is_there(plan, at, c):
            _work_of_column(plan, values, at, step, c, h, controls, room, back)
    if plan.zones.shape[0]:
        bends.pull_back_exponents(plan, values, at, room, back)
    sweep(plan, values, at, step.change, 1 / h, room, back)
    for u in range(step.count[0] if columns else 0):
        c = step.unknown[u]
        weight = -holding.GIVE * back.holding[c] * step.impulse[c]
        own = weight * dot(step.answers[1 + c], step.acts[u])
        if c >= plan.wound.size and abs(own) > _TELLING * size:
            _work_of_giving(plan, values, at, step, u, h, weight, room, back)


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
    for z in range(room.exponents.size):
        room.exponents[z] = 0.0


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
        first = plan.begin[t]
        room.seeds[BY_LENGTHS, first] += _resist_back(own, out, along, way, at.rate[t])
        room.seeds[BY_RATE, first] += along * own[m.DAMP]
        room.seeds[BY_ADJOINT, first] += h * at.pull[t]
    for d in range(plan.tendon.size):
        t = plan.tendon[d]
        if t < 0:
            _work_of_load(plan, values, at, d, h, controls, room, back)
            continue
        weight = -h * plan.gear[d] * room.rates[0, t]
        by_length = drive_back(plan, values, at, d, weight, controls, back)
        room.seeds[BY_LENGTHS, plan.begin[t]] += by_length


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
    amount = at.tension[d]
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
def _work_of_column(plan, values, at, step, c, h, controls, room, back):
    """Derivatives of the work of an impulse, and of what it answers to."""
    wound, whole, held = plan.wound.size, plan.wound.size + plan.rubs.size, back.holding[c]
    t, part = chain.column_from(plan, c)
    share = plan.gear[plan.wound[c]] if c < wound else 1.0
    room.seeds[BY_ADJOINT, part] += share * step.impulse[c]
    if c >= wound and step.slide[c].real != 0:
        if c < whole:
            back.values.tendon[t, m.FRICTION] += h * step.slide[c] * held
            return
        d, grows = plan.zones[c - whole, 0], step.grows[c]
        by_tension = drive_back(plan, values, at, d, h * grows * held, controls, back)
        room.seeds[BY_LENGTHS, plan.begin[t]] += by_tension
        by_grows = held * step.impulse[c] / grows
        room.exponents[c - whole] = by_grows * step.slide[c] * (1 + grows)
        return
    if c < wound:
        d = plan.wound[c]
        given = held * step.impulse[c] / (h * values.drive[d, m.BY_LENGTH]) ** 2
        back.values.drive[d, m.BY_LENGTH] -= given
    room.seeds[BY_END, part] += share * held


@jit
def _work_of_giving(plan, values, at, step, u, h, weight, room, back):
    """Derivatives of a weight times the rate of an unknown by itself, by which it gives way.

    That says how elements that stick share what they hold, where there are more than joints.
    """
    c, rate, ahead = step.unknown[u], step.answers[0], step.sides
    for i in range(at.v.size):
        step.right[i], rate[i] = back.v[i], step.acts[u, i]
    articulated.solve(step.tree, step.answers[:1].T, 1)
    for i in range(at.v.size):
        back.adjoint[0, i], back.end[i] = step.answers[1 + c, i], rate[i]
        along = -weight * back.adjoint[0, i] * rate[i]
        back.values.joint[i, m.ARMATURE] += along
        back.values.joint[i, m.DAMP] += h * along
        back.values.joint[i, m.STIFF] += h * h * along
    forget(room)
    fields, by = room.fields, room.back
    for f in range(chain.FIELDS):
        chain.clear(fields[f])
    chain.move_bodies(plan, at, back.adjoint[0], fields[ADJOINT])
    chain.move_bodies(plan, at, back.end, fields[END])
    for b in range(1, plan.parents.size):
        if plan.massive[b]:
            twists = fields[ADJOINT, b], fields[END, b]
            chain.add_momentum(by[ADJOINT, b], -weight, at.inertia[b], twists[1])
            chain.add_momentum(by[END, b], -weight, at.inertia[b], twists[0])
            _work_by_inertia(at, b, -weight, twists, back.values.inertia[b])
    room.seeds[BY_END, chain.column_from(plan, c)[1]] += weight
    holding.press(plan, at, step, back.adjoint[0], ahead)
    for d in range(plan.wound.size, at.columns.shape[0]):
        share, grows = step.shares[d, u], step.grows[d]
        room.seeds[BY_ADJOINT, chain.column_from(plan, d)[1]] += weight * share
        if grows != 0:
            by_grows = weight * ahead[d] * share / grows
            zone = d - plan.wound.size - plan.rubs.size
            room.exponents[zone] += by_grows * step.slide[d] * (1 + grows)
    if plan.zones.shape[0]:
        bends.pull_back_exponents(plan, values, at, room, back)
    sweep(plan, values, at, step.change, 0.0, room, back)
    for i in range(at.v.size):  # these rates are not those of the joints
        back.v[i] = step.right[i]


@jit
def _field(seed):
    """The field of a row of seeds."""
    return ADJOINT if seed == BY_ADJOINT else END if seed == BY_END else VELOCITY


@jit
def _spread(plan, values, at, room, back):
    """From seeds, derivatives by lengths and rates of tendons, to those by joints and bodies."""
    seeds = room.seeds
    for t in range(at.length.size):
        for k in range(plan.begin[t], plan.begin[t + 1]):
            i = plan.parts[k, 0]
            if k > plan.begin[t]:
                for f in range(seeds.shape[0]):
                    seeds[f, k] += seeds[f, k - 1]
            if plan.parts[k, 1] >= 0:
                _spread_span(plan, values, at, k, room, back)
                continue
            by_length, by_rate = seeds[BY_LENGTHS, k], seeds[BY_RATE, k]
            along, end = seeds[BY_ADJOINT, k], seeds[BY_END, k]
            back.q[i] += values.arm[k] * by_length
            back.v[i] += values.arm[k] * (by_rate + end)
            back.values.arm[k] += at.q[i] * by_length + at.v[i] * by_rate
            back.values.arm[k] += back.adjoint[0, i] * along + back.end[i] * end


@jit
def _spread_span(plan, values, at, k, room, back):
    span, seeds = at.span[k], room.seeds
    point, moved, speed, apart = room.scratch[0], room.scratch[1], room.scratch[2], room.scratch[3]
    for r in range(3):
        apart[r] = 0.0
    for side in range(2):
        body = chain.find_point(plan, values, at, plan.parts[k, side], point)
        for f in range(BY_LENGTHS):
            chain.find_velocity(speed, room.fields[_field(f), body], point)
            for r in range(3):
                apart[r] += (2 * side - 1) * seeds[f, k] * speed[r]
    along = chain.product(apart, span, 3)
    for r in range(3):
        apart[r] = (apart[r] - along * span[r]) / span[3] + seeds[BY_LENGTHS, k] * span[r]
    for side in range(2):
        sign = 2.0 * side - 1
        body = chain.find_point(plan, values, at, plan.parts[k, side], point)
        own = room.wrench[body]
        chain.add_cross(own, 0, sign, point, apart)
        for r in range(3):
            own[3 + r] += sign * apart[r]
            moved[r] = sign * apart[r]
        for f in range(BY_LENGTHS):
            seed = sign * seeds[f, k]
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
