"""The intervals of a recorded motion once more, and back through them; compiled."""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.compile.native import jit, making, shared
from softrobot_env.scene.integration import layout
from softrobot_env.scene.integration import mujoco_functions as mj
from softrobot_env.scene.integration.articulated import Tree
from softrobot_env.scene.integration.extrapolation import CALMING

from . import bends, chain, step
from .chain import Posture
from .holding import Step

#: Rows of a table, postures in which all of its steps begin, and these steps, at most.
ROWS = 4
POSTURES, STEPS = 1 + ROWS * (ROWS - 1) // 2, ROWS * (ROWS + 1) // 2

#: Guesses of what slid before an interval that are tried, and shares [1] by which states that are
#: the same, and others, differ.
TRIED, _SAME, _STRAYED = 3, 1e-9, 1e-6

#: Of an interval on a tape, see `layout.INTERVAL`.
_LENGTH, _ROWS, _ENTRY, _CALMED, _BEGIN, _DURATION = range(layout.INTERVAL)


class Track(NamedTuple):
    """What an interval passes through.

    Attributes:
        postures: Arrays of `Posture`, each with an axis of postures before.
        trees: Arrays of `Tree` but for its first four, with an axis of steps before; the last two,
            which hold nothing afterwards, are those of all.
        steps: `Step` without its tree, likewise.
        weights: (2, ROWS, ROWS), of the rows' ends in what was taken, by the first of them, and
            room.
        controls: (POSTURES, nu).
        owner: (STEPS,), in which posture a step begins.
        start, here, end: (2, nv), positions and velocities.
        laws: (2, ...), of the drives and of what rubs, in the interval before.
        slides: (columns,), how what rubs slid before, see `holding`.
    """

    postures: Posture
    trees: tuple
    steps: Step
    weights: ndarray
    controls: ndarray
    owner: ndarray
    start: ndarray
    here: ndarray
    end: ndarray
    laws: ndarray
    slides: ndarray


@making
def _posture(track, number):
    """One of the postures."""
    p = track.postures
    return Posture(
        p.q[number], p.v[number], p.place[number], p.frame[number], p.axis[number],
        p.inertia[number], p.length[number], p.rate[number], p.span[number], p.pull[number],
        p.tension[number], p.law[number], p.force[number], p.columns[number], p.exponent[number],
        p.axes[number], p.inertias[number],
    )  # fmt: skip


@making
def _step(plan, track, number):
    """One of the steps."""
    axes, moments, inverse, inertias, motion = track.trees
    steps = track.steps
    tree = Tree(
        plan.parents, plan.first, plan.count, plan.run, axes[number], moments[number],
        inverse[number], inertias, motion,
    )  # fmt: skip
    return Step(
        tree, steps.diagonal[number], steps.right[number], steps.answers[number],
        steps.shares[number], steps.acts[number], steps.factor[number], steps.grows[number],
        steps.impulse[number], steps.known[number], steps.slide[number], steps.sides[number],
        steps.change[number], steps.unknown[number], steps.order[number], steps.answered[number],
        steps.found[number], steps.count[number],
    )  # fmt: skip


@jit
def _weigh(interval, weights):
    """Let weights[0, 0] be those of the rows in the entry that was taken, see `extrapolation`."""
    rows, table, entry = int(interval[_ROWS]), weights[1], weights[0, 1]
    for row in range(rows):
        for k in range(ROWS):
            entry[k] = 1.0 if k == row else 0.0
        for j in range(row):
            weight = 1 / ((row + 1) / (row - j) - 1)
            for k in range(ROWS):
                old = table[j, k]
                table[j, k] = entry[k]
                entry[k] += weight * (entry[k] - old)
        for k in range(ROWS):
            table[row, k] = entry[k]
    taken = int(interval[_ENTRY])
    share = CALMING[taken] if interval[_CALMED] else 0.0
    for k in range(ROWS):
        weights[0, 0, k] = table[taken, k] + share * (table[min(1, taken), k] - table[taken, k])


@jit
def _control(track, number, interval, ramp, time):
    """Let the controls of a posture be those of a time [s] in an interval, on a ramp (2, nu)."""
    share = (interval[_BEGIN] + time) / interval[_DURATION]
    for d in range(ramp.shape[1]):
        track.controls[number, d] = ramp[0, d] + share * (ramp[1, d] - ramp[0, d])


@making
def _cross(plan, values, track, room, interval, ramp, slides, known):
    """Fill a track from its start to its end.

    What slides in each step (STEPS, columns) is known, or found from `track.slides`.
    """
    start, here, end, used, taken = track.start, track.here, track.end, 0, 0
    _weigh(interval, track.weights)
    for i in range(start.shape[1]):
        end[0, i], end[1, i] = start[0, i], 0.0 * start[0, i]
    for row in range(int(interval[_ROWS])):
        part, weight = interval[_LENGTH] / (row + 1), track.weights[0, 0, row]
        chain.copy(here, start)
        for k in range(row + 1):
            number = used if k or row == 0 else 0
            at = shared(_posture(track, number))
            if number == used:
                _control(track, number, interval, ramp, k * part)
                mj.assign(at.q, here[0])
                mj.assign(at.v, here[1])
                forces = interval[interval.size - (0 if k else ramp.shape[1]) :]
                chain.evaluate(plan, values, at, track.controls[number], forces, room)
                if plan.zones.shape[0]:
                    bends.find_exponents(plan, values, at, room)
                used += 1
            now = shared(_step(plan, track, taken))
            if known or taken:  # else as the integrator: from the step or the row before
                mj.assign(now.slide, slides[taken if known else taken - 1 if k else taken - row])
            else:
                mj.assign(now.slide, track.slides)
            step.euler(plan, values, at, now, part, known)
            if not known:
                for c in range(now.slide.size):
                    slides[taken, c] = now.slide[c].real
            track.owner[taken] = number
            taken += 1
            for i in range(here.shape[1]):
                here[1, i] += now.change[i]
                here[0, i] += part * here[1, i]
        for i in range(here.shape[1]):
            end[0, i] += weight * (here[0, i] - start[0, i])
            end[1, i] += weight * here[1, i]
    for c in range(track.slides.size):
        track.slides[c] = slides[taken - 1, c]


@making
def _uncross(plan, values, track, room, interval, back, ramp):
    """From derivatives by the end of a filled track to those by its start, and by the ramp."""
    wanted, found, taken = track.end, track.here, 0
    mj.assign(wanted[0], back.q)
    mj.assign(wanted[1], back.v)
    chain.clear(found)
    for row in range(int(interval[_ROWS])):
        part, weight = interval[_LENGTH] / (row + 1), track.weights[0, 0, row]
        taken += row + 1
        if weight == 0:
            continue
        for i in range(back.q.size):
            back.q[i], back.v[i] = weight * wanted[0, i], weight * wanted[1, i]
        for k in range(row, -1, -1):
            own = taken - 1 - row + k
            number = track.owner[own]
            at, now = shared(_posture(track, number)), shared(_step(plan, track, own))
            for d in range(back.controls.size):
                back.controls[d] = 0.0
            step.pull_back(plan, values, at, now, part, track.controls[number], room, back)
            share = (interval[_BEGIN] + k * part) / interval[_DURATION]
            for d in range(back.controls.size):
                ramp[0, d] += (1 - share) * back.controls[d]
                ramp[1, d] += share * back.controls[d]
        for i in range(back.q.size):
            found[0, i] += back.q[i]
            found[1, i] += back.v[i]
    mj.assign(back.q, found[0])
    mj.assign(back.v, found[1])


@jit
def _switched(track, laws, number):
    """Whether a law is another than in the interval before; laws (2, ...) are kept."""
    switched, slide = 0, track.steps.slide[0]
    for k in range(track.postures.law.shape[1]):
        law = track.postures.law[0, k].real
        switched = 1 if number and law != laws[0, k] else switched
        laws[0, k] = law
    for k in range(slide.size):
        switched = 1 if number and slide[k].real != laws[1, k] else switched
        laws[1, k] = slide[k].real
    return switched


@jit
def _begin(track, interval):
    """Begin where an interval did."""
    nv = track.start.shape[1]
    for i in range(nv):
        track.start[0, i] = interval[layout.INTERVAL + i]
        track.start[1, i] = interval[layout.INTERVAL + nv + i]


@partial(kernel, everywhere=True, nogil=True)
def find_slides(plan, values, track, room, tape, ramps, after, slides):
    """Find what slid in all steps of all intervals.

    Some motions of what rubs have several solutions, of which a guess says which is found. The
    integrator's is what its last step before left, which may be that of an interval that it did
    not take. So where the interval before leaves a guess with which another state is found than
    the integrator did, that which this leaves is tried, and that nothing slides.

    Args:
        plan, values, track, room: Of the chain.
        tape, ramps: As of `retrace`.
        after: (n, 2, nv), states that the integrator found.
        slides: (n, STEPS, columns), to be found; (TRIED, columns), room.

    Returns:
        In how many intervals another state is found nevertheless.
    """
    slides, tried = slides
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    strays, columns = 0, track.slides.size
    for c in range(columns):
        track.slides[c] = 0.0
    for n in range(tape.shape[0]):
        best, least, number = 0, np.inf, 0
        _begin(track, tape[n])
        while number < TRIED and least > _SAME:
            for c in range(columns):
                tried[number, c] = track.slides[c] if number + 1 < TRIED else 0.0
            mj.assign(track.slides, tried[number])
            _cross(plan, values, track, room, tape[n], ramps[n], slides[n], False)
            error = _off(track.end, after[n])
            if error < least:
                best, least = number, error
            number += 1
        if best + 1 < number:
            mj.assign(track.slides, tried[best])
            _cross(plan, values, track, room, tape[n], ramps[n], slides[n], False)
        strays += least > _STRAYED
    return strays


@jit
def _off(found, wanted):
    """Largest difference of states (2, nv), over the largest position or speed [1]."""
    off = 0.0
    for r in range(2):
        difference, largest = 0.0, 1e-300
        for i in range(found.shape[1]):
            difference = max(difference, abs(found[r, i] - wanted[r, i]))
            largest = max(largest, abs(wanted[r, i]))
        off = max(off, difference / largest)
    return off


@partial(kernel, everywhere=True, nogil=True)
def follow(plan, values, track, room, tape, ramps, slides, states):
    """Cross all intervals of a tape along ramps (n, 2, nu), of complex numbers.

    States (n + 1, 2, nv) are those at their ends, of which the first is given. Each begins where
    that of the tape did, with the imaginary part of what was found.
    """
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    for n in range(tape.shape[0]):
        _begin(track, tape[n])
        for r in range(2):
            for i in range(track.start.shape[1]):
                track.start[r, i] += 1j * states[n, r, i].imag
        _cross(plan, values, track, room, tape[n], ramps[n], slides[n], True)
        chain.copy(states[n + 1], track.end)


@partial(kernel, everywhere=True, nogil=True)
def retrace(plan, values, track, room, tape, ramps, slides, back):
    """From derivatives by the states between intervals to those by the first, and by all else.

    Args:
        plan, values, track, room: Of the chain.
        tape: (n, INTERVAL + 2 nv + nu), intervals, states and forces at their beginnings.
        ramps: (2, n, 2, nu), of controls, and derivatives by them.
        slides: (n, STEPS, columns), what slid in the steps, see `find_slides`.
        back: Derivatives by the first state, found, and by values; by states (n + 1, 2, nv).

    Returns:
        In how many intervals a drive or a friction had another law than in the one before.
    """
    back, seeds = back
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    back = shared(back)
    count, nv = tape.shape[0], back.q.size
    for i in range(nv):
        back.q[i], back.v[i] = seeds[count, 0, i], seeds[count, 1, i]
    switches = 0
    for n in range(count - 1, -1, -1):
        _begin(track, tape[n])
        _cross(plan, values, track, room, tape[n], ramps[0, n], slides[n], True)
        switches += _switched(track, track.laws, count - 1 - n)
        _uncross(plan, values, track, room, tape[n], back, ramps[1, n])
        for i in range(nv):
            back.q[i] += seeds[n, 0, i]
            back.v[i] += seeds[n, 1, i]
    return switches


@partial(kernel, everywhere=True, nogil=True)
def linearise(plan, values, track, room, tape, ramps, slides, ends, back):
    """Derivatives of the states at the ends of stretches by those at their starts, and by ramps.

    Args:
        plan, values, track, room, tape, slides: As of `retrace`.
        ramps: (n, 2, nu), of controls.
        ends: (m + 1,), where stretches begin and end among the intervals.
        back: Room; (m, 2 nv, 2 nv), to be found, by the states; (n, 2 nv, 2, nu), by the ramps.
    """
    back, by_state, by_ramp = back
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    back, nv = shared(back), track.start.shape[1]
    for m in range(by_state.shape[0]):
        found = by_state[m]
        for i in range(2 * nv):
            for j in range(2 * nv):
                found[i, j] = 1.0 if i == j else 0.0
        for n in range(ends[m + 1] - 1, ends[m] - 1, -1):
            _begin(track, tape[n])
            _cross(plan, values, track, room, tape[n], ramps[n], slides[n], True)
            for i in range(2 * nv):
                mj.assign(back.q, found[i])
                mj.assign(back.v, found[i, nv:])
                _uncross(plan, values, track, room, tape[n], back, by_ramp[n, i])
                mj.assign(found[i, :nv], back.q)
                mj.assign(found[i, nv:], back.v)


# ---------------------------------------------------------------- what is seen of a state

#: Places of what is seen: tip and its velocity, then lengths of tendons, then forces of drives.
TIP, SPEED, LENGTHS = 0, 3, 6


@jit
def _look(plan, values, at, room, state, controls):
    """Let a posture be that of a state (2, nv) under controls (nu,), without its forces."""
    mj.assign(at.q, state[0])
    mj.assign(at.v, state[1])
    chain.place(plan, values, at)
    chain.move_bodies(plan, at, at.v, room.fields[chain.VELOCITY])
    chain.stretch_tendons(plan, values, at, room)
    chain.find_laws(plan, values, at, controls, controls[:0].real)
    chain.pull_tendons(plan, values, at, controls)


@partial(kernel, everywhere=True, nogil=True)
def observe(plan, values, track, room, states, controls, seen):
    """What is seen (n, ...), see `TIP`, of states (n, 2, nv) under controls (n, nu)."""
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    tip, drives = plan.on.size - 1, LENGTHS + plan.begin.size - 1
    at = shared(_posture(track, 0))
    for n in range(states.shape[0]):
        _look(plan, values, at, room, states[n], controls[n])
        body = chain.find_point(plan, values, at, tip, seen[n])
        chain.find_velocity(seen[n, SPEED:], room.fields[chain.VELOCITY, body], seen[n])
        mj.assign(seen[n, LENGTHS:drives], at.length)
        for d in range(controls.shape[1]):
            seen[n, drives + d] = at.tension[d]


@partial(kernel, everywhere=True, nogil=True)
def observe_back(plan, values, track, room, states, controls, weights, back):
    """From derivatives by what is seen (n, ...) to those by states (n, 2, nv) and controls.

    The first are added up, the second are (n, nu); `back` has those by values and these.
    """
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    back, by_state, by_control = back
    back = shared(back)
    tip, drives = plan.on.size - 1, LENGTHS + plan.begin.size - 1
    at = shared(_posture(track, 0))
    for n in range(states.shape[0]):
        _look(plan, values, at, room, states[n], controls[n])
        step.forget(room)
        for i in range(back.q.size):
            back.q[i] = back.v[i] = back.end[i] = back.adjoint[0, i] = 0.0
        for d in range(controls.shape[1]):
            back.controls[d] = 0.0
        row, point, speed, moved = weights[n], room.scratch[0], room.scratch[1], room.scratch[2]
        body = chain.find_point(plan, values, at, tip, point)
        twist, own, by = room.fields[chain.VELOCITY, body], room.wrench[body], room.back[0, body]
        chain.find_velocity(speed, twist, point)
        for k in range(3):
            own[3 + k], by[3 + k], moved[k] = row[k], row[SPEED + k], row[k]
        chain.add_cross(own, 0, 1.0, point, row)
        chain.add_cross(own, 0, 1.0, speed, row[SPEED:])
        chain.add_cross(by, 0, 1.0, point, row[SPEED:])
        chain.add_cross(moved, 0, 1.0, row[SPEED:], twist)
        chain.add_back(back.values.site[tip], at.frame[body], moved)
        for t in range(at.length.size):
            room.seeds[chain.BY_LENGTHS, plan.begin[t]] = row[LENGTHS + t]
        for d in range(controls.shape[1]):
            rate = step.drive_back(plan, values, at, d, row[drives + d], controls[n], back)
            if plan.tendon[d] >= 0:
                room.seeds[chain.BY_LENGTHS, plan.begin[plan.tendon[d]]] += rate
        step.sweep(plan, values, at, back.end, 0.0, room, back)
        for i in range(back.q.size):
            by_state[n, 0, i] += back.q[i]
            by_state[n, 1, i] += back.v[i]
        mj.assign(by_control[n], back.controls)


@partial(kernel, everywhere=True, nogil=True)
def rest_back(plan, values, track, room, posture, controls, ways, back):
    """Derivatives of the work of static forces along turns.

    In a posture (nv,) under controls (nu,), along rows (n, nv), which those by the posture replace.
    """
    plan, values, track, room = shared(plan), shared(values), shared(track), shared(room)
    back, at, now = shared(back), shared(_posture(track, 0)), shared(_step(plan, track, 0))
    for i in range(posture.size):
        at.q[i], at.v[i] = posture[i], 0.0
    chain.evaluate(plan, values, at, controls, controls[:0], room)
    for n in range(ways.shape[0]):
        mj.assign(back.adjoint[0], ways[n])
        step.pull_back_rest(plan, values, at, now, controls, room, back)
        for i in range(posture.size):
            ways[n, i] = back.q[i]
