"""Friction along tendons: where they turn on their way, and how much that can hold; compiled.

A tendon of tension T that turns by a small angle presses on its guide by T times the angle. Sliding
around an angle a in all changes its tension by the factor exp(-mu a) against the motion; at rest it
may change by any factor between that and exp(mu a) (L. Euler 1769). What `tendon_user` says of a
tendon is in `layout`.

A tendon consists of *segments* of one tension each, which cover some stations of the chain, or some
spans between guides. Before each lies a *zone*, which turns by the angles of the guides there, or
those of a channel's path between the middles of two segments. The friction of a zone, the drop of
tension there, does work on the length beyond it, whose moment arms are those of the segments
beyond.
"""

from math import atan2, sqrt

import numpy as np

from softrobot_env.compile.native import jit, making

from .layout import AT, COEFFICIENT, COURSE, FEED, NBODY, NTENDON, STATION, STATIONS, USER, ZONES
from .mujoco_functions import ints, reals

_ON_TENDON = 3  # mjTRN_TENDON


@jit
def find_zones(chain, forces):
    """Add the zones of taut tendons to the elements of friction, where `evaluate` was called last.

    Args:
        chain: The chain.
        forces: With the drives' tensions; to its elements they are added.
    """
    name = chain.header[NTENDON]
    _find_rotations(chain, forces.course)
    for k in range(chain.ctrl.size):
        tendon = _rubbing(chain, k)
        if tendon < 0:
            continue
        line = _line(chain, tendon)
        zones = int(line[ZONES])
        if forces.tension[k] > 0:
            _follow(chain, tendon, line, zones, forces.course)
            if line[FEED] > 0:
                _add_zone(chain, k, tendon, 0, line[FEED], name, forces)
            for zone in range(zones):
                if forces.course[0, zone] > 0:
                    first, exponent = int(forces.course[1, zone]), forces.course[0, zone]
                    _add_zone(chain, k, tendon, first, exponent, name + 1 + zone, forces)
        name += 1 + zones


@jit
def list_zones(chain, course, out):
    """Drives, first DOFs beyond and exponents [1] of all zones, by name in rows (3, zones).

    Those that hold nothing have no exponent.

    Returns:
        Number of zones.
    """
    count = 0
    _find_rotations(chain, course)
    for k in range(chain.ctrl.size):
        tendon = _rubbing(chain, k)
        if tendon < 0:
            continue
        line = _line(chain, tendon)
        zones = int(line[ZONES])
        _follow(chain, tendon, line, zones, course)
        out[0, count], out[1, count], out[2, count] = k, 0, line[FEED]
        for zone in range(zones):
            at = count + 1 + zone
            out[0, at], out[1, at], out[2, at] = k, course[1, zone], course[0, zone]
        count += 1 + zones
    return count


@jit
def _rubbing(chain, drive):
    """Which tendon that rubs on its way a drive pulls, -1 if none."""
    model, header, nu = chain.model, chain.header, chain.ctrl.size
    tendon = ints(model, header[AT.actuator_trnid], 2 * nu)[2 * drive]
    if ints(model, header[AT.actuator_trntype], nu)[drive] != _ON_TENDON:
        return -1
    line = _line(chain, tendon)
    return tendon if line[COEFFICIENT] > 0 or line[FEED] > 0 else -1


@making
def _line(chain, tendon):
    """The row of `tendon_user` of a tendon."""
    size = chain.header[USER]
    rows = reals(chain.model, chain.header[AT.tendon_user], (tendon + 1) * size)
    return rows[tendon * size :]


@jit
def _follow(chain, tendon, line, zones, course):
    """Exponents [1] of a tendon's zones, and the first DOFs beyond them, in rows of `course`."""
    if line[STATIONS] > 0:
        _along_stations(chain, tendon, line, zones, course)
    else:
        _through_guides(chain, tendon, line, zones, course)


@jit
def _along_stations(chain, tendon, line, zones, course):
    """As `_follow`, of a channel."""
    model, header, nv = chain.model, chain.header, chain.v.size
    bodies = ints(model, header[AT.dof_bodyid], nv)
    starts = ints(model, header[AT.body_dofadr], header[NBODY])
    begin = ints(model, header[AT.ten_J_rowadr], header[NTENDON])[tendon]
    end = begin + ints(model, header[AT.ten_J_rownnz], header[NTENDON])[tendon]
    columns = ints(model, header[AT.ten_J_colind], end)
    count = int(line[STATIONS])
    for zone in range(zones):
        course[0, zone] = 0.0
    # From the end: a tendon's row may begin with what moves the base.
    station, last, at = count, -1, end - 1
    while station > 0:
        body = bodies[columns[at]]
        at -= 1
        if body == last:
            continue
        station, last = station - 1, body
        zone = station * zones // count
        half = line[COEFFICIENT] * _turn(course, body, line, COURSE + STATION * station) / 2
        course[0, zone] += half
        if zone + 1 < zones:
            course[0, zone + 1] += half
        course[1, zone] = starts[body]


@jit
def _find_rotations(chain, course):
    """Rotation vectors [rad] of all bodies on the ones before, in rows of `course`."""
    model, header, nv = chain.model, chain.header, chain.v.size
    bodies, joints = ints(model, header[AT.dof_bodyid], nv), ints(model, header[AT.dof_jntid], nv)
    axes = reals(model, header[AT.jnt_axis], 3 * joints[nv - 1] + 3)
    places = ints(model, header[AT.jnt_qposadr], joints[nv - 1] + 1)
    for r in range(2, 5):
        for body in range(header[NBODY]):
            course[r, body] = 0.0
    for i in range(nv):
        angle = chain.q[places[joints[i]]]
        for r in range(3):
            course[2 + r, bodies[i]] += angle * axes[3 * joints[i] + r]


@jit
def _turn(course, body, line, at):
    """Angle [rad] by which a channel's path turns at the station of a body.

    With r the place, its tangent on the cross-section is the slope of r plus strain times r, and
    the rotation of the station turns what comes at its end.
    """
    u, v, w = course[2, body], course[3, body], course[4, body]
    size = u * u + v * v + w * w
    if w == 0 and line[at + 2] == line[at + 3] == line[at + 4] == line[at + 5] == 0:
        return sqrt(size) + line[at + 7]
    x, y, part = line[at], line[at + 1], line[at + 6]
    twist, along = w / part, 1 - (v * x - u * y) / part
    a, b = line[at + 2] - twist * y, line[at + 3] + twist * x
    c, d, e = line[at + 4] - twist * y, line[at + 5] + twist * x, along
    # The rotation vector (u, v, w) turns (c, d, e) to (f, g, h).
    if size > 0.1:
        turn = sqrt(size)
        sine, rest = np.sin(turn) / turn, (1 - np.cos(turn)) / size
    else:  # in a third of the time, to 1e-12
        sine = 1 - size / 6 * (1 - size / 20 * (1 - size / 42 * (1 - size / 72 * (1 - size / 110))))
        rest = (1 - size / 12 * (1 - size / 30 * (1 - size / 56 * (1 - size / 90)))) / 2
    k, m, n = v * e - w * d, w * c - u * e, u * d - v * c
    f = c + sine * k + rest * (v * n - w * m)
    g = d + sine * m + rest * (w * k - u * n)
    h = e + sine * n + rest * (u * m - v * k)
    return _angle(a, b, along, f, g, h) + line[at + 7]


@jit
def _angle(a, b, c, d, e, f):
    """Angle [rad] between (a, b, c) and (d, e, f)."""
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    return atan2(sqrt(x * x + y * y + z * z), a * d + b * e + c * f)


@jit
def _through_guides(chain, tendon, line, zones, course):
    """As `_follow`; a tendon enters its first guide along the robot's axis."""
    model, data, header = chain.model, chain.data, chain.header
    begin = ints(model, header[AT.tendon_adr], header[NTENDON])[tendon]
    count = ints(model, header[AT.tendon_num], header[NTENDON])[tendon] - 1
    sites = ints(model, header[AT.wrap_objid], begin + count + 1)
    frame = reals(data, header[AT.site_xmat], 9 * sites[begin] + 9)
    first = 9 * sites[begin]
    a, b, c = frame[first + 2], frame[first + 5], frame[first + 8]
    for zone in range(zones):
        course[0, zone] = 0.0
    for k in range(count):
        zone = k * zones // count
        start, end = -(-zone * count // zones), -(-(zone + 1) * count // zones)
        site, beyond = sites[begin + k], sites[begin + k + 1]
        places = reals(data, header[AT.site_xpos], 3 * max(site, beyond) + 3)
        d = places[3 * beyond] - places[3 * site]
        e = places[3 * beyond + 1] - places[3 * site + 1]
        f = places[3 * beyond + 2] - places[3 * site + 2]
        exponent = line[COEFFICIENT] * _angle(a, b, c, d, e, f)
        later = exponent * (k - start) / (end - start)
        course[0, zone] += exponent - later
        if zone + 1 < zones:
            course[0, zone + 1] += later
        if k == start:
            body = ints(model, header[AT.site_bodyid], site + 1)[site]
            number = ints(model, header[AT.body_dofnum], header[NBODY])[body]
            last = ints(model, header[AT.body_dofadr], header[NBODY])[body] + number
            course[1, zone] = last if number > 0 else 0
        a, b, c = d, e, f


@jit
def _add_zone(chain, drive, tendon, beyond, exponent, name, forces):
    """Add a zone, before the segments with DOFs from `beyond` on."""
    model, data, header = chain.model, chain.data, chain.header
    k = int(forces.counts[1])
    arm = forces.arms[k]
    for i in range(arm.size):
        arm[i] = 0.0
    at = ints(model, header[AT.ten_J_rowadr], header[NTENDON])[tendon]
    end = at + ints(model, header[AT.ten_J_rownnz], header[NTENDON])[tendon]
    columns = ints(model, header[AT.ten_J_colind], end)
    arms = reals(data, header[AT.ten_J], end)
    for place in range(at, end):
        if columns[place] >= beyond:
            arm[columns[place]] = arms[place]
    forces.friction[k] = 0.0
    grows = np.expm1(exponent)
    forces.grows[k], forces.shrinks[k] = grows, -grows / (1 + grows)
    forces.drive[k], forces.name[k] = drive, name
    forces.counts[1] = k + 1
