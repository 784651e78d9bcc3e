"""Where tendons turn on their way, and how much friction that can hold; and back; compiled.

As `scene.integration.capstan` finds it. The angle between two directions a and b, about the axis n,
changes with them by n x b / b^2 and -n x a / a^2; where a tendon is straight, it has no derivative,
and 0 is taken.
"""

from math import atan2

import numpy as np

from softrobot_env.compile.native import jit
from softrobot_env.scene.integration import layout

from . import chain

#: Places of a station in `Values.rough`, see `layout.STATION`.
_X, _Y, _BEGIN, _END, _PART, _MORE = 0, 1, 2, 4, 6, 7


@jit
def find_exponents(plan, values, at, room):
    """Logarithms of the largest ratios of tensions in all zones of an evaluated posture."""
    for z in range(plan.zones.shape[0]):
        d, _, feed = plan.zones[z]
        rough = values.rough[plan.tendon[d]]
        at.exponent[z] = rough[layout.FEED] if feed else 0.0 * rough[0]
    for b in range(plan.bends.shape[0]):
        z, rough = plan.bends[b, 3], values.rough[plan.bends[b, 0]]
        angle = _bent(plan, values, at, b, room)
        if angle.real < 0:
            angle = _find_angle(plan, values, at, b, room)
        amount = rough[layout.COEFFICIENT] * angle
        at.exponent[z] += plan.shares[b, 0] * amount
        if plan.shares[b, 1] > 0:
            at.exponent[z + 1] += plan.shares[b, 1] * amount
    for z in range(plan.zones.shape[0]):
        if at.tension[plan.zones[z, 0]].real <= 0:
            at.exponent[z] = 0.0


@jit
def _find_angle(plan, values, at, b, room):
    """Angle [rad] of a bend; the directions before and after it are kept."""
    first, second, axis = room.scratch[0], room.scratch[1], room.scratch[2]
    t, where, place = plan.bends[b, 0], plan.bends[b, 1], plan.bends[b, 2]
    if place >= 0:
        _cross_station(plan, at, where, values.rough[t, place:], room)
    else:
        frame = at.frame[plan.on[plan.parts[where, 0]]]
        for r in range(3):
            second[r] = at.span[where, r]
            first[r] = at.span[where - 1, r] if where > plan.begin[t] else frame[3 * r + 2]
    for r in range(3):
        axis[r] = 0.0
    chain.add_cross(axis, 0, 1.0, first, second)
    sine, cosine = np.sqrt(chain.product(axis, axis, 3)), chain.product(first, second, 3)
    angle = atan2(sine.real, cosine.real)
    if sine.real == 0:
        sine = 0.0 * sine
    found = 0.0 * sine + angle
    if sine.imag != 0 or cosine.imag != 0:
        c, s = np.cos(angle), np.sin(angle)
        found = angle + (sine * c - cosine * s) / (cosine * c + sine * s)
    return found + values.rough[t, place + _MORE] if place >= 0 else found


@jit
def _bent(plan, values, at, b, room):
    """Angle [rad] of a bend of a channel along the robot that nothing twists, else -1."""
    t, body, place = plan.bends[b, 0], plan.bends[b, 1], plan.bends[b, 2]
    turn = room.scratch[0]
    if place >= 0:
        square, line = _find_turn(plan, at, body, turn), values.rough[t, place:]
        if turn[2] == 0 and line[_BEGIN] == line[_BEGIN + 1] == line[_END] == line[_END + 1] == 0:
            return (np.sqrt(square) if square.real > 0 else 0.0 * square) + line[_MORE]
    return 0.0 * at.q[0] - 1.0


@jit
def _find_turn(plan, at, body, turn):
    """Let turn (3,) be the rotation vector of a body on the one before; its square."""
    for r in range(3):
        turn[r] = 0.0
        for i in range(plan.first[body], plan.first[body] + plan.count[body]):
            turn[r] += at.q[i] * plan.axis[i, r]
    return chain.product(turn, turn, 3)


@jit
def _rates_of(square):
    """sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of the root of a square."""
    if square.real > 0.1:
        a = np.sqrt(square)
        sine = np.sin(a) / a
        return sine, (1 - np.cos(a)) / square, (1 - sine) / square
    third = (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110)))) / 6
    rest = (1 - square / 12 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90)))) / 2
    return 1 - square * third, rest, third


@jit
def _cross_station(plan, at, body, line, room):
    """Directions of a channel's path where a station begins, and where it ends."""
    first, second, turn, end = room.scratch[0], room.scratch[1], room.scratch[2], room.scratch[3]
    square = _find_turn(plan, at, body, turn)
    sine, rest, _ = _rates_of(square)
    x, y, twist = line[_X], line[_Y], turn[2] / line[_PART]
    along = 1 - (turn[1] * x - turn[0] * y) / line[_PART]
    first[0], first[1], first[2] = line[_BEGIN] - twist * y, line[_BEGIN + 1] + twist * x, along
    end[0], end[1], end[2] = line[_END] - twist * y, line[_END + 1] + twist * x, along
    across = end[3:]
    for r in range(3):
        second[r] = end[r]
    _add_turn(second, (sine, rest), turn, end, across)


@jit
def _add_turn(out, shares, turn, vector, room):
    """Add shares of turn x vector, and of turn x that, to out (3,)."""
    for r in range(3):
        room[r] = 0.0
    chain.add_cross(room, 0, 1.0, turn, vector)
    for r in range(3):
        out[r] += shares[0] * room[r]
    chain.add_cross(out, 0, shares[1], turn, room)


# ---------------------------------------------------------------- and back


@jit
def pull_back_exponents(plan, values, at, room, back):
    """From derivatives by exponents to those by the chain's numbers, joints and places."""
    for z in range(plan.zones.shape[0]):
        if plan.zones[z, 2]:
            t = plan.tendon[plan.zones[z, 0]]
            back.values.rough[t, layout.FEED] += room.exponents[z]
    for b in range(plan.bends.shape[0]):
        t, where, place, z = plan.bends[b]
        amount = plan.shares[b, 0] * room.exponents[z]
        if plan.shares[b, 1] > 0:
            amount += plan.shares[b, 1] * room.exponents[z + 1]
        if amount == 0:
            continue
        angle = _find_angle(plan, values, at, b, room)
        back.values.rough[t, layout.COEFFICIENT] += amount * angle
        amount *= values.rough[t, layout.COEFFICIENT]
        if not _find_slopes(amount, room):
            continue
        if place >= 0:
            back.values.rough[t, place + _MORE] += amount
            _pull_back_station(plan, values, at, b, room, back)
            continue
        _pull_back_span(plan, values, at, where, room.scratch[1, 3:], room, back)
        if where > plan.begin[t]:
            _pull_back_span(plan, values, at, where - 1, room.scratch[0, 3:], room, back)
            continue
        own = room.wrench[plan.on[plan.parts[where, 0]]]
        chain.add_cross(own, 0, 1.0, room.scratch[0], room.scratch[0, 3:])


@jit
def _find_slopes(amount, room):
    """Let amounts of an angle's derivatives by its directions be behind these, if it has any."""
    first, second, axis = room.scratch[0], room.scratch[1], room.scratch[2]
    size = np.sqrt(chain.product(axis, axis, 3))
    for r in range(3):
        first[3 + r] = second[3 + r] = 0.0
    if size == 0:
        return False
    amount /= size
    chain.add_cross(first, 3, -amount / chain.product(first, first, 3), axis, first)
    chain.add_cross(second, 3, amount / chain.product(second, second, 3), axis, second)
    return True


@jit
def _pull_back_span(plan, values, at, part, slope, room, back):
    """Derivatives by the sites of a span, of those (3,) by its direction."""
    span, point, moved = at.span[part], room.scratch[2], room.scratch[3]
    for side in range(2):
        share = (2 * side - 1) / span[3]
        site = plan.parts[part, side]
        body = chain.find_point(plan, values, at, site, point)
        own = room.wrench[body]
        chain.add_cross(own, 0, share, point, slope)
        for r in range(3):
            own[3 + r] += share * slope[r]
            moved[r] = share * slope[r]
        chain.add_back(back.values.site[site], at.frame[body], moved)


@jit
def _pull_back_station(plan, values, at, b, room, back):
    """Derivatives by the joints at a station, and by where the path runs there."""
    first, second, turn, other = room.scratch[0], room.scratch[1], room.scratch[2], room.scratch[3]
    t, body, place = plan.bends[b, 0], plan.bends[b, 1], plan.bends[b, 2]
    line, out = values.rough[t, place:], back.values.rough[t, place:]
    sine, rest, third = _rates_of(_find_turn(plan, at, body, turn))
    begin, end, moment, across = first[3:], second[3:], turn[3:], other[3:]
    for r in range(3):
        moment[r] = 0.0
    chain.add_cross(moment, 0, 1.0, second, end)
    for r in range(3):  # the directions themselves are needed no more
        first[r], other[r] = end[r], moment[r]
    _add_turn(moment, (-rest, third), turn, other, across)
    _add_turn(end, (-sine, rest), turn, first, across)
    x, y, part = line[_X], line[_Y], line[_PART]
    u, v, twist = turn[0], turn[1], turn[2] / part
    one, two, along = begin[0] + end[0], begin[1] + end[1], (begin[2] + end[2]) / part
    by_twist = x * two - y * one
    out[_X] += two * twist - along * v
    out[_Y] += along * u - one * twist
    out[_PART] += (along * (v * x - u * y) - by_twist * twist) / part
    for r in range(2):
        out[_BEGIN + r] += begin[r]
        out[_END + r] += end[r]
    moment[0] += along * y
    moment[1] -= along * x
    moment[2] += by_twist / part
    for i in range(plan.first[body], plan.first[body] + plan.count[body]):
        back.q[i] += chain.product(moment, plan.axis[i], 3)
