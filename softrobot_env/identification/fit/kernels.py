"""Statics of a backbone of constant-curvature pieces with tendons, and derivatives by parameters.

A piece of length l turns by a rotation vector phi from its begin to its end: bends, and twist. A
tendon at d = (x, y, 0) runs straight from guide to guide. With m spans in a piece, each of length
l / m and turn phi / m, the chord of one is |V w|, w = l e_z + phi x d, where V is the integral of
the rotation along the span; since V stretches what is along phi by 1 and what is across by
sin(t / 2) / (t / 2), t = |phi|, it needs no positions. A continuous channel has many spans.

Everything is written for real and for complex numbers: the derivative by a parameter is the
imaginary part after an imaginary step of 1e-30 (exact to rounding). An equilibrium is found by
Newton's method; its derivative follows from the same matrix, and that of where the tendons rub
last is carried along from row to row.
"""

from typing import NamedTuple

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel

#: Imaginary step.
TINY = 1e-30


class Layout(NamedTuple):
    """What no parameter changes.

    Attributes:
        sizes: (n,) [m], lengths of the pieces.
        spans: (n_tendons, n) between guides in each piece.
        last: (n_tendons,) number of pieces that a tendon runs through.
        by_length: Whether controls are lengths pulled in, else tensions.
        nodes: (n_markers,) ends of pieces that carry the markers, 0 is the base.
        loose: [m] of sliding at which friction is whole.
    """

    sizes: np.ndarray
    spans: np.ndarray
    last: np.ndarray
    by_length: bool
    nodes: np.ndarray
    loose: float


class Body(NamedTuple):
    """What parameters change; real, or complex for a derivative; or many with a leading axis.

    Attributes:
        stiffness: (n, 4) [N m], of the turn about x, of x by y, about y, and of the twist.
        rest: (n, 2) turns about x and y without load.
        place: (n_tendons, 2) [m].
        spring, pretension, friction: (n_tendons,) [N/m, N, N].
        straight: (n_tendons,) [m], lengths in the straight robot.
        mass: (n + 1,) [kg], at the ends of the pieces.
        head: (2,) [kg, m], mass above the end, and its height.
        gravity: (3,) [m/s2] along the robot's axes.
        play: (n_tendons,) [m], half of the servos' backlash.
        marker: (n_markers, 3) [m], from the nodes, along the cross-section's axes.
    """

    stiffness: np.ndarray
    rest: np.ndarray
    place: np.ndarray
    spring: np.ndarray
    pretension: np.ndarray
    friction: np.ndarray
    straight: np.ndarray
    mass: np.ndarray
    head: np.ndarray
    gravity: np.ndarray
    play: np.ndarray
    marker: np.ndarray


class Work(NamedTuple):
    """Scratch of one kind of numbers: lengths, their derivatives, places, axes, forces."""

    length: np.ndarray
    arm: np.ndarray
    place: np.ndarray
    axes: np.ndarray
    force: np.ndarray


def scratch(pieces: int, tendons: int, kind: type) -> Work:
    """Scratch arrays for a robot."""
    shapes = ((tendons,), (tendons, 3 * pieces), (pieces + 1, 3), (pieces + 1, 3, 3), (3 * pieces,))
    return Work(*(np.zeros(shape, dtype=kind) for shape in shapes))


@kernel
def _series(x):
    """(1 - cos t) / t^2 and its like for x = t^2; no division, so that complex steps pass.

    Returns:
        sin t / t, b = (1 - cos t) / t^2, c = (t - sin t) / t^3, e = (1/2 - b) / x, and
        f = (1/6 - c) / x, from which the derivatives by x follow.
    """
    f = 1 / 120 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110 * (1 - x / 156 * (1 - x / 210)))))
    e = 1 / 24 * (1 - x / 30 * (1 - x / 56 * (1 - x / 90 * (1 - x / 132 * (1 - x / 182)))))
    c = 1 / 6 - x * f
    return 1 - x * c, 0.5 - x * e, c, e, f


@kernel
def tendon_lengths(layout, place, q, length, arm):
    """Set lengths (n_tendons,) [m] and their derivatives (n_tendons, 3 n) by q (3 n,)."""
    for k in range(len(length)):
        total = q[0] * 0
        arm[k, :] = 0
        dx, dy = place[k, 0], place[k, 1]
        r2 = dx * dx + dy * dy
        for i in range(layout.last[k]):
            m = layout.spans[k, i]
            span = layout.sizes[i] / m
            p0, p1, p2 = q[3 * i] / m, q[3 * i + 1] / m, q[3 * i + 2] / m
            x = p0 * p0 + p1 * p1 + p2 * p2
            _a, b, c, e, _f = _series(x)
            s, ds = 2 * b, 2 * e - c  # sinc(t / 2)^2 and its derivative by x
            # (1 - s) / x = 2 e, and its derivative: that of the series of e
            de = -(1 - x / 28 * (1 - x / 60 * (1 - x / 99))) / 360
            up = span + p0 * dy - p1 * dx
            square = p2 * p2 * r2 + up * up
            along = span * span * p2 * p2
            chord = np.sqrt(s * square + 2 * e * along)
            total += m * chord
            common = 2 * ds * square + 2 * de * along
            arm[k, 3 * i] = (common * p0 + 2 * s * up * dy) / (2 * chord)
            arm[k, 3 * i + 1] = (common * p1 - 2 * s * up * dx) / (2 * chord)
            arm[k, 3 * i + 2] = (common * p2 + 2 * s * p2 * r2 + 4 * e * span * span * p2) / (
                2 * chord
            )
        length[k] = total


@kernel
def posture(layout, q, place, axes):
    """Set places (n + 1, 3) [m] and axes (n + 1, 3, 3) of the pieces' ends."""
    n = len(layout.sizes)
    place[0, :] = 0
    axes[0, :, :] = 0
    for j in range(3):
        axes[0, j, j] = 1
    turn = np.zeros((3, 3), q.dtype)
    for i in range(n):
        p0, p1, p2 = q[3 * i], q[3 * i + 1], q[3 * i + 2]
        x = p0 * p0 + p1 * p1 + p2 * p2
        a, b, c, _e, _f = _series(x)
        span = layout.sizes[i]
        v0, v1, v2 = b * p1 + c * p0 * p2, -b * p0 + c * p1 * p2, a + c * p2 * p2
        one = 1 - x * b
        turn[0, 0], turn[0, 1], turn[0, 2] = (
            one + b * p0 * p0,
            b * p0 * p1 - a * p2,
            b * p0 * p2 + a * p1,
        )
        turn[1, 0], turn[1, 1], turn[1, 2] = (
            b * p0 * p1 + a * p2,
            one + b * p1 * p1,
            b * p1 * p2 - a * p0,
        )
        turn[2, 0], turn[2, 1], turn[2, 2] = (
            b * p0 * p2 - a * p1,
            b * p1 * p2 + a * p0,
            one + b * p2 * p2,
        )
        for j in range(3):
            r0, r1, r2 = axes[i, j, 0], axes[i, j, 1], axes[i, j, 2]
            place[i + 1, j] = place[i, j] + span * (r0 * v0 + r1 * v1 + r2 * v2)
            for k in range(3):
                axes[i + 1, j, k] = r0 * turn[0, k] + r1 * turn[1, k] + r2 * turn[2, k]


@kernel
def _add_weight(layout, body, q, place, axes, out):
    """Take the weights' generalised force off `out` (3 n,) [N m]; sets the posture."""
    posture(layout, q, place, axes)
    n, g = len(layout.sizes), body.gravity
    w = body.head[0]
    f0, f1, f2 = w * g[0], w * g[1], w * g[2]
    h = body.head[1]
    a0, a1, a2 = h * axes[n, 0, 2], h * axes[n, 1, 2], h * axes[n, 2, 2]
    m0, m1, m2 = a1 * f2 - a2 * f1, a2 * f0 - a0 * f2, a0 * f1 - a1 * f0
    for i in range(n - 1, -1, -1):
        w = body.mass[i + 1]
        f0, f1, f2 = f0 + w * g[0], f1 + w * g[1], f2 + w * g[2]
        p0, p1, p2 = q[3 * i], q[3 * i + 1], q[3 * i + 2]
        x = p0 * p0 + p1 * p1 + p2 * p2
        a, b, c, e, f = _series(x)
        da, db, dc = (c - b) / 2, e - c / 2, (3 * f - e) / 2
        r = axes[i]
        l0 = r[0, 0] * f0 + r[1, 0] * f1 + r[2, 0] * f2
        l1 = r[0, 1] * f0 + r[1, 1] * f1 + r[2, 1] * f2
        l2 = r[0, 2] * f0 + r[1, 2] * f1 + r[2, 2] * f2
        n0 = r[0, 0] * m0 + r[1, 0] * m1 + r[2, 0] * m2
        n1 = r[0, 1] * m0 + r[1, 1] * m1 + r[2, 1] * m2
        n2 = r[0, 2] * m0 + r[1, 2] * m1 + r[2, 2] * m2
        s = (db * p1 + dc * p0 * p2) * l0 + (dc * p1 * p2 - db * p0) * l1 + (da + dc * p2 * p2) * l2
        d = p0 * n0 + p1 * n1 + p2 * n2
        span = layout.sizes[i]
        out[3 * i] -= span * (2 * p0 * s + c * p2 * l0 - b * l1)
        out[3 * i + 1] -= span * (2 * p1 * s + b * l0 + c * p2 * l1)
        out[3 * i + 2] -= span * (2 * p2 * s + c * p0 * l0 + c * p1 * l1 + 2 * c * p2 * l2)
        out[3 * i] -= a * n0 - b * (p1 * n2 - p2 * n1) + c * p0 * d
        out[3 * i + 1] -= a * n1 - b * (p2 * n0 - p0 * n2) + c * p1 * d
        out[3 * i + 2] -= a * n2 - b * (p0 * n1 - p1 * n0) + c * p2 * d
        a0, a1, a2 = (
            place[i + 1, 0] - place[i, 0],
            place[i + 1, 1] - place[i, 1],
            place[i + 1, 2] - place[i, 2],
        )
        m0, m1, m2 = m0 + a1 * f2 - a2 * f1, m1 + a2 * f0 - a0 * f2, m2 + a0 * f1 - a1 * f0


@kernel
def imbalance(layout, body, q, control, anchor, rubs, work):
    """Set work.force (3 n,) [N m] to what is missing from balance, and the rest of it.

    Args:
        layout, body: The robot.
        q: (3 n,) turns of the pieces.
        control: (n_tendons,) [m] or [N], what servos make of a command.
        anchor: (n_tendons,) [m], lengths at which friction would vanish.
        rubs: Whether friction counts.
        work: Scratch of the numbers' kind.
    """
    n = len(layout.sizes)
    tendon_lengths(layout, body.place, q, work.length, work.arm)
    for i in range(n):
        b0, b1 = q[3 * i] - body.rest[i, 0], q[3 * i + 1] - body.rest[i, 1]
        k = body.stiffness[i]
        work.force[3 * i] = k[0] * b0 + k[1] * b1
        work.force[3 * i + 1] = k[1] * b0 + k[2] * b1
        work.force[3 * i + 2] = k[3] * q[3 * i + 2]
    for t in range(len(work.length)):
        pull = control[t] + work.length[t] * 0
        if layout.by_length:
            stretch = control[t] + work.length[t] - body.straight[t]
            pull = body.pretension[t] + body.spring[t] * stretch
        if pull.real < 0:
            pull = pull * 0
        if rubs and body.friction[t].real > 0:
            slid = (work.length[t] - anchor[t]) / layout.loose
            if slid.real > 1:
                slid = slid * 0 + 1
            elif slid.real < -1:
                slid = slid * 0 - 1
            pull = pull + body.friction[t] * slid
        for i in range(3 * layout.last[t]):
            work.force[i] += pull * work.arm[t, i]
    _add_weight(layout, body, q, work.place, work.axes, work.force)


@kernel
def _tangent(layout, body, q, control, anchor, rubs, work, out):
    """Set out (3 n, 3 n) to the derivative of the imbalance by q, by complex steps."""
    z = q.astype(np.complex128)
    for j in range(len(q)):
        z[j] = complex(q[j], TINY)
        imbalance(layout, body, z, control, anchor, rubs, work)
        z[j] = q[j]
        for i in range(len(q)):
            out[i, j] = work.force[i].imag / TINY


@kernel
def _settle(layout, body, q, control, anchor, rubs, tolerance, real, work, matrix):
    """Newton's method from q (3 n,), which it changes; whether it found an equilibrium.

    `matrix` is then the tangent there.
    """
    imbalance(layout, body, q, control, anchor, rubs, real)
    size = np.sqrt(np.sum(real.force**2))
    for iteration in range(40):
        _tangent(layout, body, q, control, anchor, rubs, work, matrix)
        if size < tolerance and iteration > 0:
            return True
        if not np.isfinite(size):
            return False
        step = np.linalg.solve(matrix, real.force)
        share = min(1.0, 0.4 / np.abs(step).max()) if np.abs(step).max() > 0 else 1.0
        start = q.copy()
        for _ in range(12):
            q[:] = start - share * step
            imbalance(layout, body, q, control, anchor, rubs, real)
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
        many.play[j],
        many.marker[j],
    )


@kernel
def _seen(layout, marker, work, out):
    """Set markers (n_markers, 3) [m] of the posture in `work`."""
    for k in range(len(layout.nodes)):
        i = layout.nodes[k]
        for a in range(3):
            out[k, a] = work.place[i, a]
            for b in range(3):
                out[k, a] += work.axes[i, a, b] * marker[k, b]


@kernel
def follow(
    layout, body, many, controls, begins, tolerance, real, work, turns, markers, slopes, rub
):
    """Equilibria under one row of controls after the other, each from that before.

    A servo's horn follows its command at the edge of the play, and otherwise stays.

    Args:
        layout, body: The robot.
        many: The same with an imaginary step in each of the parameters, (p, ...); of none, no
            derivatives are made.
        controls: (t, n_tendons) [m] or [N].
        begins: (t,) bool, where tendons come to rest as if nothing rubbed, and servos in the middle
            of their play; the first does.
        tolerance: [N m].
        real, work: Scratch of real and of complex numbers.
        turns: (t, 3 n) of the pieces, set.
        markers: (t, n_markers, 3) [m], set.
        slopes: (t, n_markers, 3, p) their derivatives, set.
        rub: (t, n_tendons) in [-1, 1], share of their friction, set.

    Returns:
        (t,) bool, whether an equilibrium was found.
    """
    n, tendons, p = 3 * len(layout.sizes), controls.shape[1], len(many.gravity)
    found = np.ones(len(controls), np.bool_)
    q, anchor = np.zeros(n), np.zeros(tendons)
    by_q, by_anchor = np.zeros((n, p)), np.zeros((tendons, p))
    before, matrix = np.zeros(tendons), np.zeros((n, n))
    control, by_control = np.zeros(tendons), np.zeros((tendons, p))
    z, far = np.zeros(n, np.complex128), np.zeros(tendons, np.complex128)
    pulled, seen = np.zeros(tendons, np.complex128), np.zeros((len(layout.nodes), 3), np.complex128)
    for t in range(len(controls)):
        rubs = not begins[t]
        if begins[t]:
            q[:], before[:], control[:], by_control[:, :] = 0, 0, controls[t], 0
        for k in range(tendons):
            off = control[k] - controls[t, k]
            if abs(off) > body.play[k]:
                side = 1.0 if off > 0 else -1.0
                control[k] = controls[t, k] + side * body.play[k]
                for j in range(p):
                    by_control[k, j] = side * many.play[j, k].imag / TINY
        start = q.copy()
        if not _settle(layout, body, q, control, anchor, rubs, tolerance, real, work, matrix):
            q[:] = start
            fine = True
            for step in range(32):
                between = before + (step + 1) / 32 * (control - before)
                fine = _settle(
                    layout, body, q, between, anchor, rubs, tolerance, real, work, matrix
                )
            if not fine:
                found[t] = False
                if not np.all(np.isfinite(q)):
                    q[:] = 0
        before[:] = control
        turns[t] = q
        imbalance(layout, body, q, control, anchor, rubs, real)
        _seen(layout, body.marker, real, markers[t])
        for k in range(tendons):
            slid = (real.length[k] - anchor[k]) / layout.loose
            rub[t, k] = min(max(slid, -1.0), 1.0) if rubs else 0.0
        if p > 0:
            right = np.zeros((n, p))
            for j in range(p):
                one = _body(many, j)
                for k in range(tendons):
                    far[k] = complex(anchor[k], TINY * by_anchor[k, j])
                    pulled[k] = complex(control[k], TINY * by_control[k, j])
                for i in range(n):
                    z[i] = q[i]
                imbalance(layout, one, z, pulled, far, rubs, work)
                for i in range(n):
                    right[i, j] = -work.force[i].imag / TINY
            by_q = np.linalg.solve(matrix, right)
            for j in range(p):
                one = _body(many, j)
                for i in range(n):
                    z[i] = complex(q[i], TINY * by_q[i, j])
                posture(layout, z, work.place, work.axes)
                _seen(layout, one.marker, work, seen)
                slopes[t, :, :, j] = seen.imag / TINY
                tendon_lengths(layout, one.place, z, work.length, work.arm)
                for k in range(tendons):
                    if not rubs or abs(rub[t, k]) >= 1:
                        by_anchor[k, j] = work.length[k].imag / TINY
        for k in range(tendons):
            anchor[k] = real.length[k] - layout.loose * rub[t, k]
    return found
