"""A chain in one posture and what acts on it, of real or complex numbers, and back; compiled.

Twists and wrenches are about the world's origin: rotation or moment first. A field is a twist of
every body: how it moves at the velocities v, how it is accelerated, how it moves by what the
adjoint of a step says, and how it moves at the velocities at the step's end.

Derivatives by the joints follow from one thought. Let F be fields at a body and B the derivatives
by them of something that depends on them, and on the body's place. What lies beyond a joint about
the axis S, turned with its own part of the fields, would stay as it is but for what the joint
passes on: B . (-S x F) of the fields F before it. So derivatives by fields, summed from the tips to
the base, give those by joints, velocities, lengths and gravity in one pass; what depends on two
bodies adds a wrench P to each.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import jit

from . import model as m

#: Fields: velocity, acceleration, of the adjoint, velocity at the end of a step.
VELOCITY, ACCELERATION, ADJOINT, END = range(4)
FIELDS = 4

#: Rows of `Room.seeds`.
BY_RATE, BY_ADJOINT, BY_END, BY_LENGTHS = range(4)


class Posture(NamedTuple):
    """A chain in one posture, at one velocity, under some controls.

    Attributes:
        q, v: (nv,).
        place, frame: (nbody, 3), (nbody, 9), of bodies in the world.
        axis: (nv, 6), twists of the joints.
        inertia: (nbody, 10), about the world's origin, as `Values.inertia`.
        length, rate: (ntendon,) [m, m/s].
        span: (parts, 4), direction and length of spans.
        pull: (ntendon,) [N], tension, positive if it pulls.
        tension: (nu,) [N], forces of the drives.
        law: (nu,), whether a drive is at its least (-1) or largest (1) force, or between.
        force: (nv,), all forces but what an Euler step finds.
        columns: (wound + rubs + zones, nv), moment arms of drives of lengths, of tendons that rub,
            and of what lies beyond zones.
        exponent: (zones,) [1], logarithms of the largest ratios of tensions, 0 of slack tendons.
        axes, inertias: As `axis` and `inertia`, in one row.
    """

    q: ndarray
    v: ndarray
    place: ndarray
    frame: ndarray
    axis: ndarray
    inertia: ndarray
    length: ndarray
    rate: ndarray
    span: ndarray
    pull: ndarray
    tension: ndarray
    law: ndarray
    force: ndarray
    columns: ndarray
    exponent: ndarray
    axes: ndarray
    inertias: ndarray


class Room(NamedTuple):
    """What is used for one thing after another.

    Attributes:
        fields, back: (FIELDS, nbody, 6), and derivatives by them.
        wrench: (nbody, 6).
        seeds: (4, parts), derivatives by the rates in three fields, and by the length, of a tendon
            from a part to its end.
        exponents: (zones,), derivatives by these.
        rates: (2, ntendon), of tendons by the adjoint, and by the velocities at the end.
        scratch: (4, 6).
    """

    fields: ndarray
    back: ndarray
    wrench: ndarray
    seeds: ndarray
    exponents: ndarray
    rates: ndarray
    scratch: ndarray


# ---------------------------------------------------------------- vectors


@jit
def clear(array):
    """Let (n, m) be zero."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = 0.0


@jit
def copy(array, values):
    """Let (n, m) be other values (n, m)."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = values[i, j]


@jit
def add_cross(out, at, sign, a, b):
    """Add sign times a x b to three numbers of `out` from `at` on."""
    out[at] += sign * (a[1] * b[2] - a[2] * b[1])
    out[at + 1] += sign * (a[2] * b[0] - a[0] * b[2])
    out[at + 2] += sign * (a[0] * b[1] - a[1] * b[0])


@jit
def add_motion(out, sign, a, b):
    """Add sign times the twist a x b (6,)."""
    add_cross(out, 0, sign, a, b)
    add_cross(out, 3, sign, a, b[3:])
    add_cross(out, 3, sign, a[3:], b)


@jit
def add_wrench(out, sign, a, b):
    """Add sign times a x* b, of a twist and a wrench (6,)."""
    add_cross(out, 0, sign, a, b)
    add_cross(out, 0, sign, a[3:], b[3:])
    add_cross(out, 3, sign, a, b[3:])


@jit
def add_momentum(out, share, inertia, a):
    """Add a share of the momentum (6,) that an inertia (10,) has by a twist."""
    x, y, z, u, v, w = a[0], a[1], a[2], a[3], a[4], a[5]
    cx, cy, cz, m = inertia[6], inertia[7], inertia[8], inertia[9]
    xx, yy, zz = inertia[0], inertia[1], inertia[2]
    xy, xz, yz = inertia[3], inertia[4], inertia[5]
    out[0] += share * (xx * x + xy * y + xz * z + cy * w - cz * v)
    out[1] += share * (xy * x + yy * y + yz * z + cz * u - cx * w)
    out[2] += share * (xz * x + yz * y + zz * z + cx * v - cy * u)
    out[3] += share * (m * u + y * cz - z * cy)
    out[4] += share * (m * v + z * cx - x * cz)
    out[5] += share * (m * w + x * cy - y * cx)


@jit
def product(a, b, size):
    """Scalar product of the first numbers of two arrays."""
    total = a[0] * b[0]
    for k in range(1, size):
        total += a[k] * b[k]
    return total


@jit
def _turned(out, frame, a):
    """Let out (3,) be a vector a of a frame (9,), in the world."""
    for r in range(3):
        out[r] = frame[3 * r] * a[0] + frame[3 * r + 1] * a[1] + frame[3 * r + 2] * a[2]


@jit
def add_back(out, frame, a):
    """Add a vector a (3,) of the world to out, in a frame (9,)."""
    for r in range(3):
        out[r] += frame[r] * a[0] + frame[3 + r] * a[1] + frame[6 + r] * a[2]


# ---------------------------------------------------------------- kinematics


@jit
def place(plan, values, at):
    """Where bodies, joints and inertias of a posture are."""
    world = at.frame[0]
    for k in range(9):
        world[k] = 1.0 if k % 4 == 0 else 0.0
    for b in range(1, plan.parents.size):
        parent, frame = at.frame[plan.parents[b]], at.frame[b]
        _turned(at.place[b], parent, values.place[b])
        for k in range(3):
            at.place[b, k] += at.place[plan.parents[b], k]
        for k in range(9):
            frame[k] = parent[k]
        if plan.turned[b]:
            _turn_by_quaternion(frame, parent, values.turn[b])
        for i in range(plan.first[b], plan.first[b] + plan.count[b]):
            axis, hinge = at.axis[i], plan.axis[i]
            _turned(axis, frame, hinge)
            axis[3] = axis[4] = axis[5] = 0.0
            add_cross(axis, 3, 1.0, at.place[b], axis)
            _turn_about(frame, hinge, np.cos(at.q[i]), np.sin(at.q[i]))
        if plan.massive[b]:
            _place_inertia(at.inertia[b], values.inertia[b], at.place[b], frame)


@jit
def _turn_about(frame, axis, cosine, sine):
    """Turn a frame (9,) about its own axis (3,)."""
    x, y, z = axis[0], axis[1], axis[2]
    for r in range(3):
        a, b, c = frame[3 * r], frame[3 * r + 1], frame[3 * r + 2]
        along = (1 - cosine) * (a * x + b * y + c * z)
        frame[3 * r] = cosine * a + sine * (b * z - c * y) + along * x
        frame[3 * r + 1] = cosine * b + sine * (c * x - a * z) + along * y
        frame[3 * r + 2] = cosine * c + sine * (a * y - b * x) + along * z


@jit
def _turn_by_quaternion(frame, parent, turn):
    """Let a frame (9,) be that of a parent turned by a quaternion (4,)."""
    w, x, y, z = turn[0], turn[1], turn[2], turn[3]
    for r in range(3):
        row = parent[3 * r : 3 * r + 3]
        inner, out = w * w - x * x - y * y - z * z, frame[3 * r : 3 * r + 3]
        along = 2 * product(row, turn[1:], 3)
        for k in range(3):
            out[k] = inner * row[k] + along * turn[1 + k]
        add_cross(out, 0, 2.0 * w, row, turn[1:])


@jit
def _place_inertia(out, own, place, frame):
    """An inertia (10,) about the world's origin, of one about a body's, along its axes."""
    a, b, c, d, e, f = own[0], own[1], own[2], own[3], own[4], own[5]
    for r in range(3):
        u, v, w = frame[3 * r], frame[3 * r + 1], frame[3 * r + 2]
        p, q, s = a * u + d * v + e * w, d * u + b * v + f * w, e * u + f * v + c * w
        out[r] = p * u + q * v + s * w
        if r < 2:
            x, y, z = frame[6], frame[7], frame[8]
            out[4 + r] = p * x + q * y + s * z
        if r == 0:
            out[3] = p * frame[3] + q * frame[4] + s * frame[5]
    x, y, z, m = place[0], place[1], place[2], own[9]
    _turned(out[6:], frame, own[6:])
    cx, cy, cz = out[6], out[7], out[8]
    out[0] += m * (y * y + z * z) + 2 * (y * cy + z * cz)
    out[1] += m * (x * x + z * z) + 2 * (x * cx + z * cz)
    out[2] += m * (x * x + y * y) + 2 * (x * cx + y * cy)
    out[3] -= m * x * y + x * cy + y * cx
    out[4] -= m * x * z + x * cz + z * cx
    out[5] -= m * y * z + y * cz + z * cy
    out[6], out[7], out[8], out[9] = cx + m * x, cy + m * y, cz + m * z, m


@jit
def move_bodies(plan, at, rates, field):
    """The field (nbody, 6) of velocities by rates (nv,) of the joints."""
    for k in range(6):
        field[0, k] = 0.0
    for b in range(1, plan.parents.size):
        own, parent = field[b], field[plan.parents[b]]
        for k in range(6):
            own[k] = parent[k]
        for i in range(plan.first[b], plan.first[b] + plan.count[b]):
            for k in range(6):
                own[k] += rates[i] * at.axis[i, k]


@jit
def accelerate_bodies(plan, values, at, change, share, fields):
    """The field of accelerations, by shares of changes (nv,); gravity is one of the world."""
    field = fields[ACCELERATION]
    for k in range(3):
        field[0, k], field[0, 3 + k] = 0.0, -values.gravity[0, k]
    for b in range(1, plan.parents.size):
        own, before = field[b], fields[VELOCITY, plan.parents[b]]
        for k in range(6):
            own[k] = field[plan.parents[b], k]
        first = plan.first[b]
        if plan.count[b] == 0:
            continue
        moving = fields[ADJOINT, b]  # not in use yet
        for k in range(6):
            moving[k] = before[k]
        for i in range(first, first + plan.count[b]):
            add_motion(own, at.v[i], moving, at.axis[i])
            for k in range(6):
                own[k] += share * change[i] * at.axis[i, k]
                moving[k] += at.v[i] * at.axis[i, k]


# ---------------------------------------------------------------- tendons


@jit
def find_point(plan, values, at, site, out):
    """Let out (3,) be a site in the world; its body."""
    body = plan.on[site]
    _turned(out, at.frame[body], values.site[site])
    for k in range(3):
        out[k] += at.place[body, k]
    return body


@jit
def find_velocity(out, twist, point):
    """Let out (3,) be the velocity of a point by a twist."""
    for k in range(3):
        out[k] = twist[3 + k]
    add_cross(out, 0, 1.0, twist, point)


@jit
def stretch_tendons(plan, values, at, room):
    """Lengths of tendons, and their rates by the velocities, with the field of those."""
    here, there, speed = room.scratch[0], room.scratch[1], room.scratch[2]
    for t in range(at.length.size):
        at.length[t] = 0.0
        for k in range(plan.begin[t], plan.begin[t + 1]):
            one, other = plan.parts[k, 0], plan.parts[k, 1]
            if other < 0:
                at.length[t] += values.arm[k] * at.q[one]
                continue
            span = at.span[k]
            find_point(plan, values, at, one, here)
            find_point(plan, values, at, other, there)
            square = 0.0 * here[0]
            for r in range(3):
                span[r] = there[r] - here[r]
                square += span[r] * span[r]
            span[3] = np.sqrt(square)
            for r in range(3):
                span[r] /= span[3]
            at.length[t] += span[3]
    rate_tendons(plan, values, at, at.v, room.fields[VELOCITY], at.rate, speed)


@jit
def rate_tendons(plan, values, at, rates, field, out, speed):
    """Rates (ntendon,) of tendons' lengths by those (nv,) of the joints, and by their field."""
    point = speed[3:]
    for t in range(out.size):
        out[t] = 0.0
        for k in range(plan.begin[t], plan.begin[t + 1]):
            one, other = plan.parts[k, 0], plan.parts[k, 1]
            if other < 0:
                out[t] += values.arm[k] * rates[one]
                continue
            body = find_point(plan, values, at, one, point)
            find_velocity(speed, field[body], point)
            out[t] -= product(at.span[k], speed, 3)
            body = find_point(plan, values, at, other, point)
            find_velocity(speed, field[body], point)
            out[t] += product(at.span[k], speed, 3)


@jit
def _resist(own, way, rate):
    """Force of a spring of third order and a damper, of a row of `Values.joint` or `tendon`."""
    return way * (own[m.STIFF] + way * (own[m.SQUARE] + way * own[m.CUBE])) + own[m.DAMP] * rate


@jit
def pull_tendons(plan, values, at, controls):
    """Tensions of the tendons under controls (nu,), by the laws of the drives."""
    for t in range(at.pull.size):
        way = at.length[t] - values.tendon[t, m.REST]
        at.pull[t] = _resist(values.tendon[t], way, at.rate[t])
    for d in range(plan.tendon.size):
        t = plan.tendon[d]
        at.tension[d] = drive_force(plan, values, at, controls, d)
        if t >= 0:
            at.pull[t] -= plan.gear[d] * at.tension[d]


@jit
def drive_force(plan, values, at, controls, d):
    """Force [N] of a drive, by its law."""
    own, control = values.drive[d], within(controls[d], plan.control[:, d])
    t, force = plan.tendon[d], own[m.CONSTANT]
    if t >= 0:
        force += own[m.BY_LENGTH] * (plan.gear[d] * at.length[t])
    force += (
        own[m.GAIN] * control
    )  # in MuJoCo's order, so that nothing is slack in one of them alone
    if at.law[d].real != 0:
        return 0.0 * force + own[m.LEAST if at.law[d].real < 0 else m.MOST]
    return force


@jit
def find_laws(plan, values, at, controls, known):
    """Whether drives are at limits, by their forces (nu,) if known."""
    for d in range(plan.tendon.size):
        own, at.law[d] = values.drive[d], 0.0
        if own[m.BY_LENGTH].real == 0:
            continue
        force = known[d] if known.size else drive_force(plan, values, at, controls, d).real
        if force <= own[m.LEAST].real:
            at.law[d] = -1.0
        elif force >= own[m.MOST].real:
            at.law[d] = 1.0


@jit
def within(control, limits):
    """A control within its limits (2,)."""
    if control.real < limits[0]:
        return 0.0 * control + limits[0]
    if control.real > limits[1]:
        return 0.0 * control + limits[1]
    return control


# ---------------------------------------------------------------- all forces


@jit
def evaluate(plan, values, at, controls, known, room):
    """All of a posture, with its q and v, under controls (nu,), with forces of drives if known."""
    place(plan, values, at)
    move_bodies(plan, at, at.v, room.fields[VELOCITY])
    accelerate_bodies(plan, values, at, at.v, 0.0, room.fields)
    stretch_tendons(plan, values, at, room)
    find_laws(plan, values, at, controls, known)
    pull_tendons(plan, values, at, controls)
    clear(room.wrench)
    for b in range(1, plan.parents.size):
        if plan.massive[b]:
            own, momentum = room.wrench[b], room.scratch[0]
            add_momentum(own, -1.0, at.inertia[b], room.fields[ACCELERATION, b])
            for k in range(6):
                momentum[k] = 0.0
            add_momentum(momentum, 1.0, at.inertia[b], room.fields[VELOCITY, b])
            add_wrench(own, -1.0, room.fields[VELOCITY, b], momentum)
    for i in range(at.force.size):
        at.force[i] = -_resist(values.joint[i], at.q[i] - values.joint[i, m.REST], at.v[i])
    for t in range(at.pull.size):
        parts = plan.begin[t], plan.begin[t + 1]
        _add_parts(plan, values, at, parts, -at.pull[t], at.force, room.wrench)
    _add_loads(plan, values, at, controls, room)
    gather(plan, at, room.wrench, at.force)
    for c in range(at.columns.shape[0]):
        _fill_column(plan, values, at, c, room.wrench)


@jit
def _fill_column(plan, values, at, c, wrench):
    column = at.columns[c]
    for i in range(column.size):
        column[i] = 0.0
    t, one = column_from(plan, c)
    share = plan.gear[plan.wound[c]] if c < plan.wound.size else 1.0
    clear(wrench)
    _add_parts(plan, values, at, (one, plan.begin[t + 1]), 0.0 * at.q[0] + share, column, wrench)
    if plan.parts[one, 1] >= 0:
        gather(plan, at, wrench, column)


@jit
def column_from(plan, c):
    """The tendon of a column, and the part from which on it is of it."""
    wound, whole = plan.wound.size, plan.wound.size + plan.rubs.size
    if c >= whole:
        zone = plan.zones[c - whole]
        return plan.tendon[zone[0]], zone[1]
    t = plan.tendon[plan.wound[c]] if c < wound else plan.rubs[c - wound]
    return t, plan.begin[t]


@jit
def _add_parts(plan, values, at, parts, push, force, wrench):
    """Add what parts of a tendon do that pushes [N], to forces (nv,) and wrenches of bodies."""
    for k in range(parts[0], parts[1]):
        one, other = plan.parts[k, 0], plan.parts[k, 1]
        if other < 0:
            force[one] += push * values.arm[k]
            continue
        _push(plan, values, at, one, -push, at.span[k], wrench)
        _push(plan, values, at, other, push, at.span[k], wrench)


@jit
def _push(plan, values, at, site, share, force, wrench):
    """Add a share of a force (3,) at a site to the wrench of its body."""
    point = wrench[0, :3]  # the world's own is not asked for
    own = wrench[find_point(plan, values, at, site, point)]
    add_cross(own, 0, share, point, force)
    for k in range(3):
        own[3 + k] += share * force[k]


@jit
def _add_loads(plan, values, at, controls, room):
    for d in range(plan.tendon.size):
        if plan.tendon[d] >= 0:
            continue
        site, load = -1 - plan.tendon[d], room.scratch[0]
        amount = at.tension[d]
        direct_load(plan, at, d, site, load)
        _push(plan, values, at, site, amount, load[3:], room.wrench)
        for k in range(3):
            room.wrench[plan.on[site], k] += amount * load[k]


@jit
def direct_load(plan, at, d, site, out):
    """Let out (6,) be moment and force of a load in the world."""
    if plan.gear[d] > 0:
        frame = at.frame[plan.on[site]]
        _turned(out, frame, plan.loads[d, 3:])
        _turned(out[3:], frame, plan.loads[d])
        return
    for k in range(3):
        out[k], out[3 + k] = plan.loads[d, 3 + k], plan.loads[d, k]


@jit
def gather(plan, at, wrench, force):
    """Add to forces (nv,) what wrenches on the bodies do, which are summed up to the base."""
    for b in range(plan.parents.size - 1, 0, -1):
        own = wrench[b]
        for i in range(plan.first[b], plan.first[b] + plan.count[b]):
            force[i] += product(at.axis[i], own, 6)
        parent = plan.parents[b]
        if parent:
            for k in range(6):
                wrench[parent, k] += own[k]
