"""Statics of a backbone of constant-curvature pieces with tendons, and derivatives by parameters.

A piece of length l rotates by a vector phi from its beginning to its end: bends, and twist. A
tendon at d = (x, y, 0) runs straight from guide to guide. With m spans in a piece, each of length l
/ m and turn phi / m, the chord of one is |V w|, w = l e_z + phi x d, where V is the integral of the
rotation along the span; since V stretches what is along phi by 1 and what is across by sin(t / 2) /
(t / 2), t = |phi|, it needs no positions. A continuous channel has many spans.

All functions work for real and for complex numbers: the derivative by a parameter is the imaginary
part after an imaginary step of 1e-30 (exact to rounding). An equilibrium is found by Newton's
method; its derivative follows from the same matrix, and the derivative of the friction's anchors is
carried from row to row.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams.numerics.quaternions import (
    add,
    cross,
    difference,
    dot3,
    scaled,
    store,
    vector,
    vector_at,
)
from softrobot_env.beams.pcc.constant_strain import (
    clamp,
    compose,
    motion,
    motion_transpose,
    position,
    stumpff,
    to_axes,
    to_world,
    transmit,
    turn,
)
from softrobot_env.compile.kernels import kernel

#: Imaginary step.
TINY = 1e-30


class Layout(NamedTuple):
    """Data that no parameter changes.

    Attributes:
        sizes: (n,) [m], lengths of the pieces.
        spans: (n_tendons, n) between guides in each piece.
        last: (n_tendons,) number of pieces that a tendon runs through.
        by_length: Whether controls are lengths pulled in, else tensions.
        nodes: (n_markers,) ends of pieces that carry the markers, 0 is the base.
        loose: [m] of sliding at which friction of a tendon is fully developed.
        give: (n,) [rad], rotation at which friction of a piece is fully developed.
        apart: Whether friction of the backbone is separate from that of the tendons.
        along: Whether friction of any tendon grows with its tension.
    """

    sizes: ndarray
    spans: ndarray
    last: ndarray
    by_length: bool
    nodes: ndarray
    loose: float
    give: ndarray
    apart: bool
    along: bool


class Body(NamedTuple):
    """Data that parameters change; real, or complex for a derivative; or many with a leading axis.

    Attributes:
        stiffness: (n, 4) [N m], of the turn about x, of x by y, about y, and of the twist.
        rest: (n, 2) turns about x and y without load.
        place: (n_tendons, 2) [m].
        spring, pretension, friction: (n_tendons,) [N/m, N, N].
        straight: (n_tendons,) [m], lengths in the straight robot.
        mass: (n + 1,) [kg], at the ends of the pieces.
        head: (2,) [kg, m], mass above the end, and its height.
        gravity: (3,) [m/s2] along the robot's axes.
        backlash: (n_tendons,) [m], half of the servos' backlash.
        marker: (n_markers, 3) [m], from the nodes, along the cross-section's axes.
        holding: (n,) [N m], friction of the backbone against bending in any direction.
        rubbing: (n_tendons,) [1], coefficients of their friction in the robot.
        feed: (n_tendons,) [1], the same times the angle of their feed lines.
    """

    stiffness: ndarray
    rest: ndarray
    place: ndarray
    spring: ndarray
    pretension: ndarray
    friction: ndarray
    straight: ndarray
    mass: ndarray
    head: ndarray
    gravity: ndarray
    backlash: ndarray
    marker: ndarray
    holding: ndarray
    rubbing: ndarray
    feed: ndarray


class Work(NamedTuple):
    """Work arrays of one kind of numbers: lengths, their derivatives, tensions, postures, forces.

    Lengths are those of tendons and of their parts in pieces; tensions are those in the parts.
    """

    length: ndarray
    part: ndarray
    arm: ndarray
    tension: ndarray
    place: ndarray
    axes: ndarray
    force: ndarray


class Scratch(NamedTuple):
    """Work arrays of a robot.

    Attributes:
        real, complex: Of these kinds of numbers.
        tangent: (3 n, 3 n) of the last balance.
        spin, shift: (3 n, 3) what each turn does to the end of its piece, rotation and motion [m],
            where the tangent was set.
    """

    real: Work
    complex: Work
    tangent: ndarray
    spin: ndarray
    shift: ndarray


def scratch(pieces: int, tendons: int) -> Scratch:
    """Scratch arrays for a robot."""
    along, places = 3 * pieces, (pieces + 1, 3)
    parts = (tendons, pieces)
    shapes = ((tendons,), parts, (tendons, along), parts, places, (*places, 3), (along,))
    kinds = (Work(*(np.zeros(shape, kind) for shape in shapes)) for kind in (float, complex))
    return Scratch(*kinds, *(np.zeros((along, k)) for k in (along, 3, 3)))


class State(NamedTuple):
    """A robot at rest; several with a leading axis are complex, for steps of parameters.

    Attributes:
        q: (3 n,) rotations of the pieces.
        control: (n_tendons,) [m] or [N], positions of the servos, or tensions.
        anchor: (n_tendons + 2 n,) at which friction would vanish: lengths [m], then bends [rad]; if
            friction grows with tension, n_tendons n more: lengths [m] beyond the beginnings of
            pieces.
    """

    q: ndarray
    control: ndarray
    anchor: ndarray


class Rows(NamedTuple):
    """Controls and results, row by row.

    Attributes:
        controls: (t, n_tendons) [m] or [N].
        begins: (t,) bool, rows in which friction is zero and servos are in the middle of their
            backlash; the first is one.
        turns: (t, 3 n) of the pieces, set.
        markers: (t, n_markers, 3) [m], set.
        slopes: (t, n_markers, 3, p) their derivatives, set.
        found: (t,) bool, whether an equilibrium was found, set.
    """

    controls: ndarray
    begins: ndarray
    turns: ndarray
    markers: ndarray
    slopes: ndarray
    found: ndarray


@kernel
def _tendon_length(layout, place, q, k, part, arm):
    """Length [m] of tendon k; sets its parts (n,) and its derivatives (3 n,) by q (3 n,)."""
    total = q[0] * 0 + place[k, 0] * 0
    arm[:] = 0
    dx, dy = place[k, 0], place[k, 1]
    r2 = dx * dx + dy * dy
    for i in range(layout.last[k]):
        m = layout.spans[k, i]
        span = layout.sizes[i] / m
        p0, p1, p2 = q[3 * i] / m, q[3 * i + 1] / m, q[3 * i + 2] / m
        x = p0 * p0 + p1 * p1 + p2 * p2
        _, _, b, c, e, _, _, _ = stumpff(x)
        s, ds = 2 * b, 2 * e - c  # sinc(t / 2)^2 and its derivative by x
        # (1 - s) / x = 2 e, and its derivative: that of the series of e
        de = -(1 - x / 28 * (1 - x / 60 * (1 - x / 99))) / 360
        up = span + p0 * dy - p1 * dx
        square = p2 * p2 * r2 + up * up
        along = span * span * p2 * p2
        chord = np.sqrt(s * square + 2 * e * along)
        part[i] = m * chord
        total += part[i]
        common = 2 * ds * square + 2 * de * along
        arm[3 * i] = (common * p0 + 2 * s * up * dy) / (2 * chord)
        arm[3 * i + 1] = (common * p1 - 2 * s * up * dx) / (2 * chord)
        arm[3 * i + 2] = (common * p2 + 2 * s * p2 * r2 + 4 * e * span * span * p2) / (2 * chord)
    return total


@kernel
def _set_posture(layout, q, place, axes):
    """Set places (n + 1, 3) [m] and axes (n + 1, 3, 3), one a row, of the pieces' ends."""
    frame, here = clamp(q[0] * 0)
    _store_frame(axes[0], frame)
    store(place[0], here)
    for i in range(len(layout.sizes)):
        phi = vector_at(q, 3 * i)
        c = stumpff(dot3(phi, phi))
        here = add(here, to_world(frame, position(layout.sizes[i], c, phi)))
        frame = compose(frame, c, phi)
        _store_frame(axes[i + 1], frame)
        store(place[i + 1], here)


@kernel
def _store_frame(rows, frame):
    """Set rows (3, 3) to three vectors."""
    store(rows[0], frame[0])
    store(rows[1], frame[1])
    store(rows[2], frame[2])


@kernel
def _frame(rows):
    """Rows (3, 3) as three vectors."""
    return vector(rows[0]), vector(rows[1]), vector(rows[2])


@kernel
def _add_weight(layout, body, q, work):
    """Subtract the weights' generalised force from work.force (3 n,) [N m]; sets the posture."""
    _set_posture(layout, q, work.place, work.axes)
    gravity, n, zero = vector(body.gravity), len(layout.sizes), q[0] * 0
    force = to_axes(_frame(work.axes[n]), scaled(body.head[0], gravity))
    moment = cross((zero, zero, zero + body.head[1]), force)
    for i in range(n - 1, -1, -1):
        phi = vector_at(q, 3 * i)
        weight = to_axes(_frame(work.axes[i + 1]), scaled(body.mass[i + 1], gravity))
        load, force, moment = transmit(
            layout.sizes[i], stumpff(dot3(phi, phi)), phi, add(force, weight), moment
        )
        for j in range(3):
            work.force[3 * i + j] -= load[j]


@kernel
def _slid(way, loose):
    """Share of friction in [-1, 1] at a distance from where it would vanish."""
    share = way / loose
    return share * 0 + np.sign(share.real) if abs(share.real) > 1 else share


@kernel
def _held(x, y):
    """Share (x, y) of friction of a piece, of length one at most, bent so far from its anchor."""
    size = np.sqrt(x * x + y * y)
    return (x / size, y / size) if size.real > 1 else (x, y)


@kernel
def _pull(layout, body, state, has_friction, k, length):
    """Tension [N] of tendon k by its drive, and friction of whatever tension, by a length [m].

    Tensions are not negative at the servo. If friction of the backbone is separate, that of a
    tendon is at most its tension: a slack tendon has no friction.
    """
    pull = state.control[k] + length * 0
    if layout.by_length:
        pull = body.pretension[k] + body.spring[k] * (pull + length - body.straight[k])
    if pull.real <= 0:
        pull = pull * 0
    most = body.friction[k] + pull * 0
    if not has_friction:
        return pull, 0 * most
    if layout.apart and pull.real < most.real:
        most = pull
    return pull, most * _slid(length - state.anchor[k], layout.loose)


@kernel
def _zone(layout, body, state, k, i, beyond):
    """Share and exponent [1] of friction of tendon k before its part in piece i.

    See `scene.integration.capstan`; `beyond` is the length [m] beyond the beginning of the piece.
    """
    n, q = len(layout.sizes), state.q
    turned = np.sqrt(q[3 * i] * q[3 * i] + q[3 * i + 1] * q[3 * i + 1]) / 2
    exponent = body.rubbing[k] * turned
    if i == 0:
        exponent += body.feed[k]
    else:
        turned = np.sqrt(q[3 * i - 3] * q[3 * i - 3] + q[3 * i - 2] * q[3 * i - 2]) / 2
        exponent += body.rubbing[k] * turned
    anchor = state.anchor[len(state.control) + 2 * n + k * n + i]
    return _slid(beyond - anchor, layout.loose), exponent


@kernel
def _set_tensions(layout, body, state, has_friction, work):
    """Set work.tension (n_tendons, n) [N] in the pieces, by the lengths there."""
    for k in range(len(work.length)):
        pull, held = _pull(layout, body, state, has_friction, k, work.length[k])
        beyond, growth = work.length[k], 0 * pull
        for i in range(layout.last[k]):
            if has_friction and layout.along:
                share, exponent = _zone(layout, body, state, k, i, beyond)
                growth += share * exponent
                beyond -= work.part[k, i]
                work.tension[k, i] = pull * np.exp(growth) + held
            else:
                work.tension[k, i] = pull + held


@kernel
def _add_pieces(layout, body, state, has_friction, work):
    """Add springs and friction of the pieces to work.force (3 n,) [N m]."""
    q, out, bends = state.q, work.force, state.anchor[len(state.control) :]
    for i in range(len(layout.sizes)):
        b0, b1 = q[3 * i] - body.rest[i, 0], q[3 * i + 1] - body.rest[i, 1]
        k = body.stiffness[i]
        out[3 * i] += k[0] * b0 + k[1] * b1
        out[3 * i + 1] += k[1] * b0 + k[2] * b1
        out[3 * i + 2] += k[3] * q[3 * i + 2]
        if has_friction:
            give, x, y = layout.give[i], q[3 * i] - bends[2 * i], q[3 * i + 1] - bends[2 * i + 1]
            x, y = _held(x / give, y / give)
            out[3 * i] += body.holding[i] * x
            out[3 * i + 1] += body.holding[i] * y


@kernel
def _add_tendons(layout, work):
    """Add the tendons' forces, from tensions and moment arms, to work.force (3 n,) [N m]."""
    for k in range(len(work.tension)):
        for i in range(3 * layout.last[k]):
            work.force[i] += work.tension[k, i // 3] * work.arm[k, i]


@kernel
def imbalance(layout, body, state, has_friction, work):
    """Set work.force (3 n,) [N m] to the imbalance, and the other work arrays.

    Args:
        layout, body, state: The robot.
        has_friction: Whether friction counts.
        work: Scratch of the numbers' kind.
    """
    work.force[:] = 0
    _add_pieces(layout, body, state, has_friction, work)
    for k in range(len(work.length)):
        work.length[k] = _tendon_length(layout, body.place, state.q, k, work.part[k], work.arm[k])
    _set_tensions(layout, body, state, has_friction, work)
    _add_tendons(layout, work)
    _add_weight(layout, body, state.q, work)


@kernel
def _set_rates(layout, q, scratch):
    """Set spin and shift of the posture of the real numbers."""
    for i in range(len(layout.sizes)):
        phi, start = vector_at(q, 3 * i), _frame(scratch.real.axes[i])
        c = stumpff(dot3(phi, phi))
        for j in range(3):
            unit = (1.0 * (j == 0), 1.0 * (j == 1), 1.0 * (j == 2))
            shift, spin = motion(layout.sizes[i], c, phi, unit)
            store(scratch.shift[3 * i + j], to_world(start, shift))
            store(scratch.spin[3 * i + j], to_world(start, spin))


@kernel
def _add_weight_tangent(layout, body, q, scratch):
    """Add the derivative of the weights' imbalance by q (3 n,) to the tangent; needs spin, shift.

    A rotation of a piece rotates everything beyond it as one body. So the weights' force on a later
    piece, gravity . push, changes by gravity . (spin x push), spin being the rotation by the
    earlier turn.
    """
    n, gravity, real, out = len(layout.sizes), vector(body.gravity), scratch.real, scratch.tangent
    push = np.zeros((3 * n, 3))
    mass = body.head[0]
    lever = scaled(body.head[0] * body.head[1], vector(real.axes[n, 2]))
    for i in range(n - 1, -1, -1):
        mass += body.mass[i + 1]
        _add_own_weight(layout.sizes[i], vector_at(q, 3 * i), i, mass, lever, gravity, scratch)
        for j in range(3 * i, 3 * i + 3):
            spin, shift = vector(scratch.spin[j]), vector(scratch.shift[j])
            store(push[j], add(scaled(mass, shift), cross(spin, lever)))
            for later in range(3 * i + 3, 3 * n):
                pull = dot3(gravity, cross(spin, vector(push[later])))
                out[later, j] -= pull
                out[j, later] -= pull
        lever = add(
            lever, scaled(mass, difference(vector(real.place[i + 1]), vector(real.place[i])))
        )


@kernel
def _add_own_weight(size, phi, i, mass, lever, gravity, scratch):
    """Add how the force of a weight [kg, kg m] on piece i changes with its rotation."""
    axes, zero = scratch.real.axes, 0.0 * phi[0]
    pull, beyond = to_axes(_frame(axes[i]), gravity), to_axes(_frame(axes[i + 1]), lever)
    for j in range(3):
        step = (
            complex(zero, TINY * (j == 0)),
            complex(zero, TINY * (j == 1)),
            complex(zero, TINY * (j == 2)),
        )
        turned = add(phi, step)
        c = stumpff(dot3(turned, turned))
        moment = cross(turn(c, turned, beyond), pull)
        load = motion_transpose(size, c, turned, scaled(mass, pull), moment)
        for k in range(3):
            scratch.tangent[3 * i + k, 3 * i + j] -= load[k].imag / TINY


@kernel
def _add_tension_rates(layout, body, state, has_friction, scratch):
    """Add to the tangent what tensions change by lengths, and by how much pieces turn."""
    real, out = scratch.real, scratch.tangent
    for k in range(len(real.length)):
        pull, held = _pull(layout, body, state, has_friction, k, complex(real.length[k], TINY))
        by_pull, by_held, arm = pull.imag / TINY, held.imag / TINY, real.arm[k]
        beyond = real.length[k]
        growth = np.zeros(3 * layout.last[k])  # derivative of the logarithm of tension by q
        for i in range(layout.last[k]):
            drawn, rate = real.tension[k, i] - held.real, by_pull
            if has_friction and layout.along and pull.real > 0:
                _add_growth(layout, body, state, k, i, beyond, arm, growth)
                rate *= drawn / pull.real
                beyond -= real.part[k, i]
            for m in range(3 * layout.last[k]):
                change = (rate + by_held) * arm[m] + drawn * growth[m]
                for j in range(3 * i, 3 * i + 3):
                    out[j, m] += arm[j] * change


@kernel
def _add_growth(layout, body, state, k, i, beyond, arm, growth):
    """Add the derivative by q of share times exponent of a zone, see `_zone`."""
    share, exponent = _zone(layout, body, state, k, i, beyond)
    if abs(share) < 1:
        growth[3 * i :] += exponent / layout.loose * arm[3 * i : len(growth)]
    for piece in range(max(i - 1, 0), i + 1):
        x, y = state.q[3 * piece], state.q[3 * piece + 1]
        turn = np.sqrt(x * x + y * y)
        if turn > 0:
            growth[3 * piece] += share * body.rubbing[k] * x / turn / 2
            growth[3 * piece + 1] += share * body.rubbing[k] * y / turn / 2


@kernel
def _tangent(layout, body, state, has_friction, scratch):
    """Set the tangent to the derivative of the imbalance by q, where real numbers were set last.

    By complex steps: a piece's spring and a tendon's arm about a piece depend on its turns alone,
    so that three steps give those of all pieces. Sets spin and shift as well.
    """
    q, real, work, out = state.q, scratch.real, scratch.complex, scratch.tangent
    n, tendons = len(layout.sizes), len(real.length)
    out[:, :] = 0
    _set_rates(layout, q, scratch)
    _add_tension_rates(layout, body, state, has_friction, scratch)
    work.tension[:, :] = real.tension
    z = q.astype(np.complex128)
    for j in range(3):
        for i in range(n):
            z[3 * i + j] = complex(q[3 * i + j], TINY)
        work.force[:] = 0
        _add_pieces(layout, body, State(z, state.control, state.anchor), has_friction, work)
        for k in range(tendons):
            if work.tension[k, 0] != 0:
                _tendon_length(layout, body.place, z, k, work.part[k], work.arm[k])
        _add_tendons(layout, work)
        for i in range(3 * n):
            out[i, 3 * (i // 3) + j] += work.force[i].imag / TINY
        z[:] = q
    if np.any(body.gravity != 0):
        _add_weight_tangent(layout, body, q, scratch)


@kernel
def _settle(layout, body, state, has_friction, tolerance, scratch):
    """Newton's method from a state, whose rotations it changes; returns whether it converged."""
    q, real = state.q, scratch.real
    imbalance(layout, body, state, has_friction, real)
    size = np.sqrt(np.sum(real.force**2))
    for iteration in range(40):
        if size < tolerance and iteration > 0:
            return True
        if not np.isfinite(size):
            return False
        _tangent(layout, body, state, has_friction, scratch)
        step = np.linalg.solve(scratch.tangent, real.force)
        share = min(1.0, 0.4 / np.abs(step).max()) if np.abs(step).max() > 0 else 1.0
        start = q.copy()
        for _ in range(12):
            q[:] = start - share * step
            imbalance(layout, body, state, has_friction, real)
            new = np.sqrt(np.sum(real.force**2))
            if new < size * (1 - 1e-4 * share) or new < tolerance:
                break
            share /= 2
        size = new
    return size < 1e3 * tolerance


@kernel
def _body(many, j):
    """One of many bodies."""
    return Body(
        many.stiffness[j],
        many.rest[j],
        many.place[j],
        many.spring[j],
        many.pretension[j],
        many.friction[j],
        many.straight[j],
        many.mass[j],
        many.head[j],
        many.gravity[j],
        many.backlash[j],
        many.marker[j],
        many.holding[j],
        many.rubbing[j],
        many.feed[j],
    )


@kernel
def _seen(layout, marker, work, out):
    """Set markers (n_markers, 3) [m] of the posture in `work`."""
    for k in range(len(layout.nodes)):
        i = layout.nodes[k]
        offset = to_world(_frame(work.axes[i]), vector(marker[k]))
        store(out[k], add(vector(work.place[i]), offset))


@kernel
def _move_servos(body, command, control):
    """Move horns (n_tendons,) with a command at the edge of the backlash; else they stay."""
    for k in range(len(control)):
        off = control[k] - command[k]
        if abs(off.real) > body.backlash[k].real:
            side = 1.0 if off.real > 0 else -1.0
            control[k] = command[k] + side * body.backlash[k]


@kernel
def _move_anchors(layout, state, has_friction, work):
    """Set the friction's anchors for the next row, from the lengths there."""
    q, anchor, bends = state.q, state.anchor, state.anchor[len(work.length) :]
    beyond, n = bends[2 * len(layout.sizes) :], len(layout.sizes)
    kept = 1.0 if has_friction else 0.0
    for k in range(len(work.length)):
        length = work.length[k]
        share = _slid(length - anchor[k], layout.loose)
        anchor[k] = length - kept * layout.loose * share
        for i in range(layout.last[k] if layout.along else 0):
            share = _slid(length - beyond[k * n + i], layout.loose)
            beyond[k * n + i] = length - kept * layout.loose * share
            length -= work.part[k, i]
    for i in range(len(layout.sizes)):
        give, b0, b1 = layout.give[i], q[3 * i], q[3 * i + 1]
        x, y = _held((b0 - bends[2 * i]) / give, (b1 - bends[2 * i + 1]) / give)
        bends[2 * i] = b0 - kept * give * x
        bends[2 * i + 1] = b1 - kept * give * y


@kernel
def _differentiate(layout, many, state, moved, has_friction, scratch, out):
    """Set out (n_markers, 3, p) to derivatives of the markers by p parameters.

    Quantities that stay real at the state's rotations are not recomputed: most parameters change
    one tendon, or none.

    Args:
        layout, many: See `follow`.
        state: That was found, with its anchors of the row before.
        moved: The state after a step of each parameter, (p, ...), as `state` at first; its turns
            and anchors are set.
        has_friction: Whether friction counts.
        scratch: Of the state: real numbers and the tangent there.
        out: Is set.
    """
    real, work, steps = scratch.real, scratch.complex, out.shape[2]
    pulls, lengths = np.zeros((len(state.q), steps)), np.zeros((len(work.length), steps))
    parts = np.zeros((len(work.length), len(layout.sizes), steps))
    for j in range(steps):
        body, one = _body(many, j), State(moved.q[j], moved.control[j], moved.anchor[j])
        one.q[:] = state.q
        for m in range(len(one.anchor)):
            one.anchor[m] = complex(state.anchor[m], one.anchor[m].imag)
        work.force[:] = 0
        _add_pieces(layout, body, one, has_friction, work)
        for k in range(len(work.length)):
            by_place = 0.0
            work.arm[k, :] = real.arm[k]
            if layout.along:
                work.part[k, :] = real.part[k]
            if body.place[k, 0].imag != 0 or body.place[k, 1].imag != 0:
                length = _tendon_length(layout, body.place, one.q, k, work.part[k], work.arm[k])
                by_place = length.imag
                if layout.along:
                    parts[k, :, j] = work.part[k].imag / TINY
            lengths[k, j] = by_place / TINY
            work.length[k] = complex(real.length[k], by_place)  # so that it slides as it does there
        _set_tensions(layout, body, one, has_friction, work)
        _add_tendons(layout, work)
        if np.any(body.mass.imag != 0) or np.any(body.gravity.imag != 0):
            _add_weight(layout, body, one.q, work)
        pulls[:, j] = work.force.imag / TINY
    change = -np.linalg.solve(scratch.tangent, pulls)
    lengths += real.arm @ change
    for k in range(len(work.length) if layout.along else 0):
        for m in range(3 * layout.last[k]):
            parts[k, m // 3] += real.arm[k, m] * change[m]
    _set_slopes(layout, many, change, scratch, out)
    for j in range(steps):
        one = State(moved.q[j], moved.control[j], moved.anchor[j])
        one.q[:] = state.q + complex(0.0, TINY) * change[:, j]
        work.length[:] = real.length + complex(0.0, TINY) * lengths[:, j]
        if layout.along:
            work.part[:, :] = real.part + complex(0.0, TINY) * parts[:, :, j]
        _move_anchors(layout, one, has_friction, work)


@kernel
def _set_slopes(layout, many, change, scratch, out):
    """Set out (n_markers, 3, p) to derivatives of the markers, whose turns change (3 n, p)."""
    real, spin, shift = scratch.real, scratch.spin, scratch.shift
    for k in range(len(layout.nodes)):
        node, rates = layout.nodes[k], np.zeros((3, len(change)))
        offset = to_world(_frame(real.axes[node]), vector(many.marker[0, k].real))
        point = add(vector(real.place[node]), offset)
        for m in range(3 * node):
            beyond = difference(point, vector(real.place[m // 3 + 1]))
            rate = add(vector(shift[m]), cross(vector(spin[m]), beyond))
            rates[0, m], rates[1, m], rates[2, m] = rate
        out[k] = rates @ change
        for j in range(out.shape[2]):
            own = vector(many.marker[j, k].imag)
            own = scaled(1 / TINY, to_world(_frame(real.axes[node]), own))
            for axis in range(3):
                out[k, axis, j] += own[axis]


@kernel
def _find(layout, body, state, before, has_friction, tolerance, scratch):
    """Balance a state whose controls were `before`, at once or in steps; returns success."""
    q = state.q
    start = q.copy()
    if _settle(layout, body, state, has_friction, tolerance, scratch):
        return True
    q[:] = start
    fine = True
    for step in range(32):
        between = before + (step + 1) / 32 * (state.control - before)
        part = State(q, between, state.anchor)
        fine = _settle(layout, body, part, has_friction, tolerance, scratch)
    if not fine and not np.all(np.isfinite(q)):
        q[:] = 0
    return fine


@kernel
def follow(layout, body, many, rows, tolerance, scratch):
    """Equilibria under consecutive rows of controls, each starting from the previous one.

    Args:
        layout, body: The robot.
        many: The same with an imaginary step in each of the parameters, (p, ...); with p = 0, no
            derivatives are computed.
        rows: Controls, and results, which are set.
        tolerance: [N m].
        scratch: Of the robot.
    """
    n, tendons, p = 3 * len(layout.sizes), rows.controls.shape[1], len(many.gravity)
    real, before = scratch.real, np.zeros(tendons)
    anchors = tendons + (2 + tendons * layout.along) * len(layout.sizes)
    state = State(np.zeros(n), np.zeros(tendons), np.zeros(anchors))
    moved = State(
        np.zeros((p, n), np.complex128),
        np.zeros((p, tendons), np.complex128),
        np.zeros((p, anchors), np.complex128),
    )
    for t in range(len(rows.controls)):
        command, has_friction = rows.controls[t], not rows.begins[t]
        if not has_friction:
            state.q[:] = 0
            before[:] = 0
            state.control[:] = command
            moved.control[:] = command
        _move_servos(body, command, state.control)
        rows.found[t] = _find(layout, body, state, before, has_friction, tolerance, scratch)
        before[:] = state.control
        rows.turns[t] = state.q
        imbalance(layout, body, state, has_friction, real)
        _seen(layout, body.marker, real, rows.markers[t])
        for j in range(p):
            _move_servos(_body(many, j), command, moved.control[j])
        if p > 0:
            _tangent(layout, body, state, has_friction, scratch)
            _differentiate(layout, many, state, moved, has_friction, scratch, rows.slopes[t])
        _move_anchors(layout, state, has_friction, real)
