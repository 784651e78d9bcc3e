"""Time integration that states its error: extrapolated, linearly implicit Euler steps, compiled.

The chain is M(q) v' = f(q, v, u), q' = v. With K the stiffness of joints and of taut tendons driven
by length, and D the joints' damping, one Euler step of size h is

    (M + h D + h^2 K) dv = h (f - h K v),    v + dv,    q + h (v + dv).

M, f and the tendons' directions are those of the posture at its start, from MuJoCo, but that M is
not made, see `articulated`. Tendons with dry friction stick, or slide against it, by Coulomb's law
on the velocity at the step's end. The error of a step is a series in h, whatever approximations K
and D are (P. Deuflhard and U. Nowak 1987, LIMEX), so that results of 1, 2, 3, ... steps over one
interval are extrapolated to h = 0 by Neville's scheme: k rows give order k. The difference of the
last two entries estimates the error.
The first force evaluation serves all rows: 4 evaluations for order 3, 7 for order 4.

The error of an interval H is the displacement that the joints' errors cause at most, along the
backbone. Its share of the accuracy may be (rate H)^2, as that of an acceleration, within
`SMALLEST_SHARE` (what a jump of a control leaves in stiff modes does not add up) and
`LARGEST_SHARE`. Errors of speeds, which do not last in stiff modes, count by what they make in a
swing of the robot, up to `LARGEST_SPEED`. An interval beyond that gets another row, and then is
divided; the next one is as long as its error lets it be. What drives do unseen at its end counts
too, see `forces`.

Where a tendon goes slack or taut, sticks or slides another way within an interval, the error is no
series, and all entries may be off together. What the tendon's force would do if it had changed all
along, between the springs of both laws, counts as an error there, at most as far as extrapolated
entries are from plain steps.

Modes that nothing damps and that turn by 0.3 to 2 rad in an interval would grow, so in intervals
longer than `CALM` damping times the entry takes a share of that of order 2: what it does not follow
is damped. There each ramp begins with the shortest interval, which sees what is about to be damped.

Here local errors are kept; `period` estimates what becomes of them. Joints whose positions are no
vectors are handled by `mj_integratePos`.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import jit, making

from ..timestep import RATE
from . import layout
from . import mujoco_functions as mj
from .euler import System, euler_step, system_on, system_size, turn_motors
from .forces import (
    Chain,
    Forces,
    drive_forces,
    drives_length,
    drives_of,
    evaluate,
    find_surprises,
    find_switched,
    forces_size,
    measure,
    no_forces,
)
from .linear_algebra import dot
from .motors import Motors, begin_motors, jump_of, motors_on, place_motors, reset_motors
from .mujoco_functions import ints, reals

#: Largest and smallest share [1] of the accuracy by which one interval may err.
LARGEST_SHARE, SMALLEST_SHARE = 0.1, 0.003

#: Weight [1] of what kinks make, in the books: the other errors booked are differences of entries,
#: about so many times the errors of the better ones.
_KINK = 10.0

#: What a force does that grows steadily [1], over what it does if it is there from the start.
_RAMP = 1 / 3

#: Longest interval in damping times [1] in which dampers keep entries of order 3 and 4 stable.
CALM = 100.0

#: Share [1] of the entry of order 2 that keeps the others of a table stable beyond, by their
#: number: undamped modes of 0.3 to 2 rad an interval would grow by up to 0.5 % in it.
CALMING = (0.0, 0.0, 0.45, 0.2)

#: Largest displacement, over the accuracy [1], that the speeds' errors of one interval may make in
#: a swing of the robot.
LARGEST_SPEED = 2.0

#: Share [1] of its length by which the rounding of times may change an interval.
_ROUNDING = 1e-9


class Ramp(NamedTuple):
    """Controls that go from `begin` to `end` (nu,) steadily, within a time [s]."""

    begin: ndarray
    end: ndarray
    duration: float


class Table(NamedTuple):
    """Neville's scheme: a row of results, and the latest entry of the next one.

    Attributes:
        turns: (rows, nv + m), of the joints and of m motors since the start of the interval.
        velocities: (rows, nv + m), at its end.
        turn, velocity: (nv + m,), the entry.
        gap, lag: (nv + m,), of the turns and the velocities, from the entry before.
    """

    turns: ndarray
    velocities: ndarray
    turn: ndarray
    velocity: ndarray
    gap: ndarray
    lag: ndarray


class Work(NamedTuple):
    """A chain under extrapolation.

    Attributes:
        chain: The chain.
        memory: Of the simulation or its shadow, see `layout`.
        q, v: (nq,), (nv,), at the start of the interval.
        first, forces: At the start of the interval, and at that of a later Euler step.
        drives, begun: (nu,) [N], forces of the drives in the last evaluation, and at the start.
        system, change: Of an Euler step; (nv,).
        table: Results of the rows.
        motors: Those of its servos, which move along with it.
    """

    chain: Chain
    memory: ndarray
    q: ndarray
    v: ndarray
    first: Forces
    forces: Forces
    drives: ndarray
    begun: ndarray
    system: System
    change: ndarray
    table: Table
    motors: Motors


@jit
def work_size(chain, memory):
    """Number of doubles that `work_on` cuts."""
    nq, nv, nu, most = chain.q.size, chain.v.size, chain.ctrl.size, int(memory[layout.MOST])
    entries = nv + chain.header[layout.MOTORS]
    places = nq + nv + 2 * nu + nv + (2 * most + 4) * entries + 8 * (entries - nv)
    return places + 2 * forces_size(chain) + system_size(chain)


@making
def work_on(chain, memory, servos, held, room):
    """Arrays for `integrate`, cut from free memory, with servos (rows, m) whose motors it moves.

    What friction held is given, see `System`.
    """
    nq, nv, most = chain.q.size, chain.v.size, int(memory[layout.MOST])
    entries = nv + servos.shape[1]
    rows = mj.cut(room, most, entries), mj.cut(room, most, entries)
    entry = mj.cut(room, 4, entries)
    return Work(
        chain,
        memory,
        mj.cut(room, 1, nq)[0],
        mj.cut(room, 1, nv)[0],
        no_forces(chain, room),
        no_forces(chain, room),
        mj.cut(room, 1, chain.ctrl.size)[0],
        mj.cut(room, 1, chain.ctrl.size)[0],
        system_on(chain, held, room),
        mj.cut(room, 1, nv)[0],
        Table(rows[0], rows[1], entry[0], entry[1], entry[2], entry[3]),
        motors_on(servos, drives_of(chain), room),
    )


@jit
def integrate(work, ramp):
    """Advance along a ramp, from a state where `forces.evaluate` was called last."""
    chain, memory = work.chain, work.memory
    time, end = 0.0, ramp.duration * (1 - 1e-3 * _ROUNDING)
    length = min(memory[layout.NEXT], memory[layout.LONGEST])
    if ramp.duration > memory[layout.CALM]:  # see what controls set off before it is damped
        length = memory[layout.SHORTEST]
    while time < end:
        left = ramp.duration - time
        h = left / max(np.ceil(left / length - _ROUNDING), 1.0)
        _start(work, ramp, time)
        h, rows, error, kink = _solve_interval(work, ramp, time, h)
        _note(work, h, error, kink)
        # Where the error is too large: plain Euler steps, which are stable.
        entry = rows - 1 if error <= 1 else 0
        calmed = entry > 0 and h > memory[layout.CALM]
        if calmed:
            _calm(work.table, entry)
        if memory[layout.STEPS] <= memory[layout.TAPED]:
            _tape(work, ramp, (h, 1.0 * rows, 1.0 * entry, 1.0 * calmed, time, ramp.duration))
        _take(work, entry, h)
        time += h
        length = _next_length(memory, h, rows, error)
        if not bounded(chain.v):
            break
        if time < end:
            evaluate(chain)
    memory[layout.NEXT] = length
    mj.assign(chain.ctrl, ramp.end)
    _control_by_motors(work)


@making
def _tape(work, ramp, interval):
    """Keep an interval, see `layout.INTERVAL`, for derivatives of what was computed."""
    chain, at = work.chain, layout.INTERVAL
    width = at + chain.q.size + chain.v.size + 3 * chain.ctrl.size
    place = chain.header[layout.TAPE] + 8 * width * (np.int64(work.memory[layout.STEPS]) - 1)
    row = mj.reals_at(place, width)
    for k in range(at):
        row[k] = interval[k]
    for values in (work.q, work.v, work.begun, ramp.begin, ramp.end):
        mj.assign(row[at : at + values.size], values)
        at += values.size


# ---------------------------------------------------------------- an interval


@jit
def _start(work, ramp, time):
    """Remember the state and what acts in it: it serves the first step of all rows."""
    mj.assign(work.q, work.chain.q)
    mj.assign(work.v, work.chain.v)
    begin_motors(work.motors)
    _measure(work, work.first, ramp, time)
    mj.assign(work.begun, drive_forces(work.chain))


@jit
def _measure(work, forces, ramp, time):
    """What acts with the controls of a time [s] on the ramp."""
    _control(work.chain.ctrl, ramp, time)
    _control_by_motors(work)
    measure(work.chain, forces)
    work.memory[layout.EVALUATIONS] += 1


@jit
def _control(ctrl, ramp, time):
    """Let controls (nu,) be those of a time [s] on the ramp."""
    share = time / ramp.duration
    for k in range(ctrl.size):
        ctrl[k] = ramp.begin[k] + share * (ramp.end[k] - ramp.begin[k])


@jit
def _control_by_motors(work):
    """Let controls be those of the motors' horns, if the motors move with the chain."""
    for d in range(work.motors.turned.size):
        work.chain.ctrl[d] = work.motors.horn[d]


@jit
def _solve_interval(work, ramp, time, h):
    """Fill the table for an interval [s], divided until its error is small enough.

    Returns:
        Its length [s], the number of rows, its error over what is allowed, and what a kink may
        make of that [m].
    """
    shortest = work.memory[layout.SHORTEST]
    while True:
        divides = h > (1 + _ROUNDING) * shortest
        rows, error = _extrapolate(work, ramp, time, h, divides)
        kink = _kink(work, h, rows)
        if work.motors.turned.size:
            kink = max(kink, _kink_of_motors(work, h, rows))
        larger = np.maximum(error, kink / _allowed(work.memory, h))
        if larger <= 1 or not divides:
            return h, rows, error, kink
        least = max(rows, int(work.memory[layout.FEWEST]))
        left, wanted = ramp.duration - time, h * _shrinkage(least, larger)
        h = left / np.ceil(left / max(wanted, shortest))


@jit
def _extrapolate(work, ramp, time, h, divides):
    """Add rows until the error is small enough; their number, and the error over the allowed.

    Fewer if the interval divides, and if it will have to because of a kink.
    """
    error, rows, failed = np.inf, 0, work.system.trial.failed
    failed[0] = 0.0
    while rows < work.memory[layout.MOST] and not error <= 1:
        rows += 1
        _take_steps(work, ramp, time, h, rows)
        _add_row(work, rows - 1)
        allowed = _allowed(work.memory, h)
        if 1 < rows < work.memory[layout.FEWEST] and divides and _kink(work, h, rows) > allowed:
            error = 1.0
        if rows >= work.memory[layout.FEWEST]:
            error = displacement(work.chain, work.table.gap) / allowed
            fast = sway(work.chain, work.memory, work.table.lag)
            error = np.maximum(error, fast / (LARGEST_SPEED * work.memory[layout.ACCURACY]))
            if work.motors.turned.size:
                error = np.maximum(error, _error_of_motors(work, allowed))
            if error <= 1 and drives_length(work.chain):
                error = max(error, _unseen(work, ramp, time + h, rows - 1, h / rows) / allowed)
    return rows, np.inf if failed[0] else error


@jit
def _error_of_motors(work, allowed):
    """Error of motors over the allowed: the displacement of a robot that follows them."""
    error = displacement(work.chain, _follow_motors(work, work.table.gap)) / allowed
    fast = sway(work.chain, work.memory, _follow_motors(work, work.table.lag))
    return np.maximum(error, fast / (LARGEST_SPEED * work.memory[layout.ACCURACY]))


@jit
def _kink_of_motors(work, h, rows):
    """Displacement [m] in an interval [s] by motors that turn another way at its end.

    As `_kink`, of their dry friction, and of the load that a gap takes from them.
    """
    nv, motors, turns = work.chain.v.size, work.motors, work.table.turns
    for d in range(motors.turned.size):
        spread = abs(turns[rows - 1, nv + d] - turns[0, nv + d])
        way = jump_of(motors, d, work.first.tension[d], h)
        work.table.gap[nv + d] = min(way, spread)
    return displacement(work.chain, _follow_motors(work, work.table.gap))


@making
def _follow_motors(work, moved):
    """Least turns (nv,) of the joints by which taut tendons follow motors, of (nv + m,)."""
    nv, first = work.chain.v.size, work.first
    for i in range(nv):
        work.change[i] = 0.0
    for s in range(int(first.counts[0])):
        square = 0.0
        for i in range(nv):
            square += first.pulls[s, i] * first.pulls[s, i]
        way = moved[nv + int(first.drives[s])] / max(square, 1e-300)
        for i in range(nv):
            work.change[i] += way * first.pulls[s, i]
    return work.change


@jit
def _take_steps(work, ramp, time, h, count):
    """Cross an interval [s] in equal Euler steps, from its start."""
    chain, part = work.chain, h / count
    mj.assign(chain.q, work.q)
    mj.assign(chain.v, work.v)
    reset_motors(work.motors)
    if count > 1:  # what slid in the first step of the row before, as a guess
        mj.assign(work.system.held[0], work.first.slide)
    _take_step(work, work.first, part)
    for k in range(1, count):
        evaluate(chain)
        _measure(work, work.forces, ramp, time + k * part)
        _take_step(work, work.forces, part)


@jit
def _take_step(work, forces, h):
    chain = work.chain
    euler_step(chain, forces, h, work.system, work.change)
    if work.motors.turned.size:
        turn_motors(chain.v, forces, h, work.system, work.motors, work.change)
    for i in range(chain.v.size):
        chain.v[i] += work.change[i]
    mj.move(chain.model, chain.q, chain.v, h)


@jit
def _add_row(work, row):
    """Neville: entry j of this row is from entry j - 1 of this row and of the one before."""
    table, nv = work.table, work.chain.v.size
    mj.subtract(work.chain.model, table.turn, work.chain.q, work.q)
    for i in range(nv):
        table.velocity[i] = work.chain.v[i]
    for d in range(work.motors.turned.size):
        table.turn[nv + d] = work.motors.turned[d] - work.motors.begun[0, d]
        table.velocity[nv + d] = work.motors.turning[d]
    for j in range(row):
        weight = 1 / ((row + 1) / (row - j) - 1)
        _extrapolate_entry(table.turn, table.turns[j], weight)
        _extrapolate_entry(table.velocity, table.velocities[j], weight)
        for i in range(table.gap.size):
            table.gap[i] = table.turn[i] - table.turns[j, i]
            table.lag[i] = table.velocity[i] - table.velocities[j, i]
    mj.assign(table.turns[row], table.turn)
    mj.assign(table.velocities[row], table.velocity)


@jit
def _extrapolate_entry(entry, before, weight):
    """Replace an entry of the row before by that of this row, and that by the next of this row."""
    for i in range(entry.size):
        old = before[i]
        before[i] = entry[i]
        entry[i] += weight * (entry[i] - old)


@jit
def bounded(values):
    """Whether no one of (n,) has diverged."""
    for i in range(values.size):
        if not abs(values[i]) <= layout.HUGE:
            return False
    return True


@jit
def _calm(table, entry):
    """Keep fast undamped modes from growing in an entry of the table."""
    share, turns, velocities = CALMING[entry], table.turns, table.velocities
    for i in range(table.gap.size):
        turns[entry, i] += share * (turns[1, i] - turns[entry, i])
        velocities[entry, i] += share * (velocities[1, i] - velocities[entry, i])


@jit
def _take(work, entry, h):
    """Let an entry of the table be the state at the end of an interval [s]."""
    chain, table = work.chain, work.table
    acceleration = reals(chain.data, chain.header[layout.AT.qacc], chain.v.size)
    mj.assign(chain.q, work.q)
    mj.assign(chain.v, table.velocities[entry])
    mj.move(chain.model, chain.q, table.turns[entry], 1.0)
    if work.motors.turned.size:
        place_motors(work.motors, table.turns[entry], table.velocities[entry])
    for i in range(chain.v.size):
        acceleration[i] = (chain.v[i] - work.v[i]) / h


# ---------------------------------------------------------------- errors and lengths


@jit
def displacement(chain, turn):
    """Largest displacement [m] of a backbone by small turns (nv,) of the joints, at most."""
    nv = chain.v.size
    axes = reals(chain.data, chain.header[layout.AT.cdof], 6 * nv)
    parents = ints(chain.model, chain.header[layout.AT.dof_parentid], nv)
    x, y, z, way, farthest = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(nv):
        if parents[i] < 0:  # another robot begins
            farthest = max(farthest, way)
            x, y, z, way = 0.0, 0.0, 0.0, 0.0
        x += axes[6 * i] * turn[i]
        y += axes[6 * i + 1] * turn[i]
        z += axes[6 * i + 2] * turn[i]
        way += chain.lengths[i] * np.sqrt(x * x + y * y + z * z)
        if not way < np.inf:
            return way
    return max(farthest, way)


@jit
def sway(chain, memory, speeds):
    """Displacement [m] that speeds (nv,) of the joints make in a swing of the robot, at most."""
    return displacement(chain, speeds) * RATE / memory[layout.RATE]


@jit
def _unseen(work, ramp, time, entry, part):
    """Displacement [m] by drives that change their law in the last part [s] of an interval.

    The entry of the table at its end, a time [s] on the ramp, is so far off, at most.
    """
    chain, table = work.chain, work.table
    mj.assign(work.drives, drive_forces(chain))
    mj.assign(chain.q, work.q)
    mj.move(chain.model, chain.q, table.turns[entry], 1.0)
    _control(chain.ctrl, ramp, time)
    if work.motors.turned.size:
        place_motors(work.motors, table.turns[entry], table.velocities[entry])
        _control_by_motors(work)
    switched = find_switched(chain, work.drives, work.forces)
    return _pushed(work, part) if switched else 0.0


@jit
def _allowed(memory, h):
    """Error [m] that an interval [s] may have."""
    turned = memory[layout.RATE] * h
    share = min(turned * turned, LARGEST_SHARE) + SMALLEST_SHARE
    return share * memory[layout.ACCURACY]


@jit
def _shrinkage(rows, error):
    """Factor on an interval with an error above the allowed one."""
    ratio = 1 / error  # not a number where the step has blown up
    return max(0.25, 0.9 * ratio ** (1 / (rows - 1))) if ratio > 0 else 0.25


@jit
def _next_length(memory, h, rows, error):
    """Length [s] of the interval after one of length h."""
    growth = 0.8 * (1 / max(error, 1e-300)) ** (1 / (rows - 1)) if error < np.inf else 0.5
    # A row too many costs less than an interval too short.
    length = h * min(max(growth, 0.5), 2.0)
    return min(max(length, memory[layout.SHORTEST]), memory[layout.LONGEST])


@jit
def _note(work, h, error, kink):
    """Keep the books of an interval [s], its error over what is allowed and its kink [m]."""
    memory = work.memory
    memory[layout.MISSED] += not error <= 1
    memory[layout.WORST] = max(memory[layout.WORST], error) if error == error else np.inf
    memory[layout.SUM] += error * _allowed(memory, h) + _KINK * kink
    memory[layout.STEPS] += 1


@jit
def _kink(work, h, rows):
    """Displacement [m] in an interval [s] by the change of forces that no row resolves.

    Of drives that have another law at its end than at its start, and of tendons that rub. It is
    not beyond what the extrapolation has made of plain steps.
    """
    chain, forces, found = work.chain, work.forces, False
    if drives_length(chain):
        found = find_surprises(chain, work.begun, forces)
    else:
        for i in range(chain.v.size):
            forces.force[i] = 0.0
        forces.counts[0] = 0
    found = _add_slips(work, rows) or found
    forces.counts[1] = 0
    return np.minimum(_pushed(work, h), _spread(work, rows)) if found else 0.0


@jit
def _add_slips(work, rows):
    """Add what elements of friction do at the start of an interval that they do not at its end.

    Of whole tendons all of that; of zones that neither began nor ceased to slide it is smooth, and
    of others it changes steadily. Where already the first steps find that a whole tendon slides the
    other way than it does at the start, it turns round within the last row's first one: as late as
    its rate comes to nothing on the way to that at the end.
    """
    first, last, found = work.first, work.forces, False
    end = work.table.velocities[rows - 1]
    for k in range(int(first.counts[1])):
        name, arm, less = int(first.name[k]), first.arms[k], 0.0
        if first.drive[k] < 0:
            less, rate = first.grip[name] - last.grip[name], dot(arm, work.v)
            if first.slide[name] * rate < 0:
                slower = abs(rate) / (abs(rate) + abs(dot(arm, end)))
                less -= 2 * first.grip[name] * slower / rows
        elif first.slide[name] != last.slide[name]:
            less = _RAMP * (first.grip[name] - last.grip[name])
        if less != 0:
            found = True
            for i in range(arm.size):
                last.force[i] += less * arm[i]
    return found


@jit
def _spread(work, rows):
    """Displacement [m] between the first and the last entry of the last row."""
    turns = work.table.turns
    for i in range(work.change.size):
        work.change[i] = turns[rows - 1, i] - turns[0, i]
    return displacement(work.chain, work.change)


@jit
def _pushed(work, h):
    """Displacement [m] that the forces in `work.forces` make within a time [s], from rest."""
    chain = work.chain
    for i in range(chain.v.size):
        chain.v[i] = 0.0
    euler_step(chain, work.forces, h, work.system, work.change)
    for i in range(chain.v.size):
        work.change[i] *= h
    return displacement(chain, work.change)
