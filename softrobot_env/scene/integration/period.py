"""A control period of a simulation, its servos and its shadow: the functions that C code calls.

Local errors alone say nothing of motions that part from each other: snapping, swinging upside down,
chaos. So each simulation has a shadow, the same with `integrator.SHADOW` times the accuracy. How
far it strays, times the ratio of the sums of the local errors, estimates the error in time; of
positions with a safety factor, `SAFE`. The error is at most all that they are apart. A shadow that
has strayed far does not move alike: its way in second order, half its square over the length,
counts as well. A speed counts as the displacement that it makes in a swing of the robot, speed over
first angular frequency: so one number bounds the errors of positions, and of velocities times that
frequency.

The functions serve any robot, single simulations and the threads of many.
"""

from functools import partial
from pathlib import Path

import numpy as np

from softrobot_env.compile.native import array_at, called, entry, jit, making, shared

from .. import timestep
from . import layout
from . import mujoco_functions as mj
from .extrapolation import Ramp, bounded, displacement, integrate, sway, work_on, work_size
from .forces import actuate, chain_of, drives_of, evaluate, place_tendons, slack_of
from .motors import hold, lever, take_effort
from .mujoco_functions import reals

#: Safety factor [1] on what the shadow says of positions: in smooth motions that is about as large
#: as the error, and may fall short of it, by a factor of three in one random scene of some hundred.
SAFE = 6.0

#: The same where motors move with the chain, whose sticking and limits are no smooth motions.
SAFE_OF_MOTORS = 12.0


@jit
def wind(servos, memory, path):
    """Let servos (`SERVO_ROWS`, nu) turn for a control period, and say where the horns are.

    By the law of `scene.servos`.

    Args:
        servos: Settings, order and state.
        memory: Of the simulation: its control period and timesteps.
        path: (1 + timesteps, nu) [m], horns now and at the end of every timestep.

    Returns:
        Number of rows of the path up to the one at which all motors have arrived.
    """
    rows, tick = 1 + _moving(servos, memory), _tick(memory)
    half, horn = servos[layout.HALF], servos[layout.HORN]
    mj.assign(path[0], horn)
    for k in range(1, rows):
        for i in range(horn.size):
            # A motor turns one way, so its horn is pushed by one side of the backlash at most.
            motor = _turned(servos, i, k * tick)
            path[k, i] = min(max(horn[i], motor - half[i]), motor + half[i])
    for i in range(horn.size):
        servos[layout.MOTOR, i] = _turned(servos, i, (rows - 1) * tick)
    mj.assign(horn, path[rows - 1])
    return rows


@called
def turn(servos, memory, path):
    """As `wind`, for Python."""
    return wind(servos, memory, path)


@jit
def _tick(memory):
    """Time [s] between two rows of a path."""
    return memory[layout.PERIOD] / memory[layout.SUBSTEPS]


@jit
def _way(servos, i):
    """What motor i still has to wind [m]."""
    return servos[layout.OFFSET, i] + servos[layout.COMMAND, i] - servos[layout.MOTOR, i]


@jit
def _turned(servos, i, time):
    """Where motor i is [m] after a time [s]."""
    most = servos[layout.SPEED, i] * time
    return servos[layout.MOTOR, i] + min(max(_way(servos, i), -most), most)


@jit
def _moving(servos, memory):
    """Timesteps until all motors have arrived, at least one and at most all of them."""
    arrival, tick = 0.0, _tick(memory)
    for i in range(servos.shape[1]):
        arrival = max(arrival, np.abs(_way(servos, i)) / servos[layout.SPEED, i])
    steps = 1
    while steps < memory[layout.SUBSTEPS] and steps * tick < arrival:
        steps += 1
    return steps


# ---------------------------------------------------------------- our own integrator


@jit
def _integrate_period(work, path, held):
    """Advance by a control period along a path (rows, nu) of controls, whose end is `held`."""
    chain, memory = work.chain, work.memory
    tick, ways = _tick(memory), max(len(path) - 1, 0)
    for k in range(ways):
        if k:
            evaluate(chain)
        integrate(work, shared(Ramp(path[k], path[k + 1], tick)))
    if ways < memory[layout.SUBSTEPS]:
        if ways:
            evaluate(chain)
        rest = memory[layout.PERIOD] - ways * tick
        integrate(work, shared(Ramp(held, held, rest)))


@jit
def _integrate_motors(work, held):
    """Advance by a control period in which servos move with the chain.

    A dead time ends within the period: the command before holds until then.
    """
    motors, period = work.motors, work.memory[layout.PERIOD]
    servos, late = motors.servos, motors.servos[layout.LATE, 0]
    before = servos.shape[0] - layout.SERVO_ROWS
    if before:
        _aim(motors, layout.SERVO_ROWS + before - 1)
        integrate(work, shared(Ramp(held, held, min(late, period))))
    if late < period:
        if before:
            evaluate(work.chain)
        _aim(motors, layout.SERVO_ROWS + before - 2 if before > 1 else layout.COMMAND)
        integrate(work, shared(Ramp(held, held, period - late)))
    take_effort(motors)


@jit
def _aim(motors, row):
    """Let the commands of a row of the servos be in force."""
    for d in range(motors.goal.size):
        motors.goal[d] = motors.servos[row, d] + motors.servos[layout.OFFSET, d]


@jit
def _remember_commands(servos):
    """Let commands be those of a control period ago."""
    for row in range(servos.shape[0] - 1, layout.SERVO_ROWS - 1, -1):
        before = row - 1 if row > layout.SERVO_ROWS else layout.COMMAND
        mj.assign(servos[row], servos[before])


@making
def _follow_path(chain, memory, servos, friction, state, path, held, room):
    """Advance a simulation or its shadow, with arrays cut from free memory.

    Motors of servos (rows, m) begin where its state has them, and are left there.
    """
    work = shared(work_on(chain, memory, servos, friction, room))
    if servos.shape[1] == 0:
        _integrate_period(work, path, held)
        return
    now, m, end = work.motors.now, servos.shape[1], chain.q.size + chain.v.size
    for k in range(4 * m):
        now[k // m, k % m] = state[end + k]
    _integrate_motors(work, held)
    for k in range(4 * m):
        state[end + k] = now[k // m, k % m]


@making
def _extrapolated_period(chain, memory, shadowed, states, servos, friction, path, free):
    """Advance a simulation, then its shadow, and compare them.

    The work is done in the array `free`, which the caller keeps alive: views do not.
    """
    room, held = np.empty(1, np.int64), np.empty(chain.ctrl.size)
    room[0] = free.ctypes.data
    mj.assign(held, path[len(path) - 1] if len(path) else chain.ctrl)
    _follow(chain, servos, states)
    _follow_path(chain, memory, servos, friction[:2], states[0], path, held, room)
    _save(chain, states[0])
    _load(chain, states[1])
    evaluate(chain)
    _follow_path(chain, shadowed, servos, friction[2:], states[1], path, held, room)
    _save(chain, states[1])
    _load(chain, states[0])
    _show_motors(chain, servos, states[0])
    mj.reals_at(np.int64(chain.data) + 8 * chain.header[layout.AT.time], 1)[0] += memory[
        layout.PERIOD
    ]
    _finish(chain)
    _compare(chain, memory, shadowed, states)


@jit
def _save(chain, state):
    """Keep the state (nq + nv,) of a chain."""
    nq = chain.q.size
    mj.assign(state[:nq], chain.q)
    mj.assign(state[nq : nq + chain.v.size], chain.v)


@jit
def _load(chain, state):
    mj.assign(chain.q, state[: chain.q.size])
    mj.assign(chain.v, state[chain.q.size :])


@jit
def _follow(chain, servos, states):
    """Let the shadow start anew where the simulation is, if that was moved, or if it diverged."""
    nq, nv, m, here, there = chain.q.size, chain.v.size, servos.shape[1], states[0], states[1]
    stayed = _equal(chain.q, here[:nq]) and _equal(chain.v, here[nq:])
    for k in range(4 * m):  # motors, and where they are
        now = servos[layout.MOTOR + k // m, k % m]
        stayed = stayed and now == here[nq + nv + k]
        here[nq + nv + k] = now
    if not (stayed and bounded(there)):
        _save(chain, there)
        mj.assign(there[nq + nv :], here[nq + nv :])


@jit
def _show_motors(chain, servos, state):
    """Let servos, and controls, be where the motors of a state are."""
    m = servos.shape[1]
    for k in range(4 * m):
        servos[layout.MOTOR + k // m, k % m] = state[chain.q.size + chain.v.size + k]
    for d in range(m):
        chain.ctrl[d] = servos[layout.HORN, d]


@jit
def _equal(one, other):
    """Whether all of (n,) and (n,) are."""
    for i in range(one.size):
        if one[i] != other[i]:
            return False
    return True


@jit
def _finish(chain):
    """All read-outs of the new state, and MuJoCo's own checks of it.

    No factors of the mass matrix, which a long chain would spend half its time on; whoever needs
    them calls `mj_factorM`. No check of the acceleration: the velocity tells whether that is
    finite, and small stiff robots do reach what MuJoCo takes for a divergence.
    """
    model, data = chain.model, chain.data
    mj.mj_check_pos(model, data)
    mj.mj_check_vel(model, data)
    mj.mj_kinematics(model, data)
    mj.mj_com_pos(model, data)
    mj.mj_cam_light(model, data)
    place_tendons(chain)
    mj.mj_make_mass(model, data)
    mj.mj_sensor_pos(model, data)
    mj.mj_fwd_velocity(model, data)
    mj.mj_sensor_vel(model, data)
    actuate(chain)


@making
def _compare(chain, memory, shadowed, states):
    """Estimate the error from how far the shadow has strayed, in position and in velocity."""
    nq, apart = chain.q.size, np.empty(chain.v.size)
    mj.subtract(chain.model, apart, states[1, :nq], states[0, :nq])
    safe = SAFE_OF_MOTORS if chain.header[layout.MOTORS] else SAFE
    place = _error(memory, shadowed, displacement(chain, apart), safe)
    for i in range(apart.size):
        apart[i] = states[1, nq + i] - states[0, nq + i]
    speed = _error(memory, shadowed, sway(chain, memory, apart), 1.0)
    memory[layout.ESTIMATE] = max(memory[layout.ESTIMATE], place, speed)


@jit
def _error(memory, shadowed, strayed, safe):
    """The error [m] that it means for a shadow to have strayed so far, with a safety factor."""
    if not strayed < np.inf:
        return np.inf
    if memory[layout.SUM] < shadowed[layout.SUM]:
        share = safe * memory[layout.SUM] / shadowed[layout.SUM]
        strayed *= min(share + strayed / (2 * memory[layout.REACH]), 1.0)
    return strayed


# ---------------------------------------------------------------- MuJoCo's integrators


@jit
def _mujoco_period(chain, memory, path):
    """Advance by MuJoCo's steps; each has the controls at its start.

    The forces of drives at the end are those of the state there.
    """
    model, data, substeps = chain.model, chain.data, int(memory[layout.SUBSTEPS])
    last = len(path) - 1
    for k in range(substeps):
        if last >= 0:
            mj.assign(chain.ctrl, path[min(k, last)])
        if k == 0 and memory[layout.METHOD] == layout.SPLIT:
            mj.mj_step2(model, data)
        else:
            mj.mj_step(model, data)
    if last >= 0:
        mj.assign(chain.ctrl, path[last])
    mj.mj_step1(model, data)
    mj.mj_actuation(model, data)
    memory[layout.EVALUATIONS] += substeps * (4 if memory[layout.METHOD] == layout.WHOLE else 1)
    memory[layout.STEPS] += substeps


# ---------------------------------------------------------------- what C code calls

_entry = partial(entry, outside=(Path(timestep.__file__),))


@making
def _path(number, header, memory):
    """Controls (rows, nu) during the period, that of its servos if a simulation has them."""
    nu = header[layout.NU]
    if header[layout.ROWS] or header[layout.MOTORS] or not header[layout.SERVOS]:
        return mj.table_at(header[layout.PATH], header[layout.ROWS], nu)
    servos = _servos(number, header)
    path = np.empty((1 + int(memory[layout.SUBSTEPS]), nu))
    return path[: wind(servos, memory, path)]


@making
def _servos(number, header):
    """Servos (rows, nu) of a simulation."""
    rows, nu = header[layout.SERVO_SIZE], header[layout.NU]
    return mj.table_at(header[layout.SERVOS] + 8 * number * rows * nu, rows, nu)


@making
def _motors(number, header):
    """Its servos (rows, m) if their motors move with the chain, else none."""
    if header[layout.SERVOS] and header[layout.MOTORS] and not header[layout.ROWS]:
        return _servos(number, header)
    return mj.table_at(header[layout.MEMORY], layout.SERVO_ROWS, 0)


@making
def _advance(model, data, number, header):
    chain = shared(chain_of(model, data, header))
    address = header[layout.MEMORY] + number * header[layout.STRIDE]
    memory = mj.reals_at(address, layout.MEMORY_SIZE)
    memory[layout.MISSED] = 0.0
    path = _path(number, header, memory)
    if memory[layout.METHOD] == layout.EXTRAPOLATED:
        shadowed = mj.reals_at(address + 8 * layout.MEMORY_SIZE, layout.MEMORY_SIZE)
        size = chain.q.size + chain.v.size + 4 * header[layout.MOTORS]
        servos = _motors(number, header)
        place = header[layout.SHADOW_STATES] + number * 16 * size
        states = mj.table_at(place, 2, size)
        free = np.empty(work_size(chain, memory) + work_size(chain, shadowed))
        rubbing = header[layout.RUBBING]
        friction = mj.table_at(header[layout.HELD] + number * 32 * rubbing, 4, rubbing)
        _extrapolated_period(chain, memory, shadowed, states, servos, friction, path, free)
        _remember_commands(servos)
    else:
        _mujoco_period(chain, memory, path)


@making
def _report(data, number, header):
    """Copy what is to be reported of a simulation to its row of the arrays of all."""
    fields = array_at(header[layout.REPORTS], (header[layout.REPORTED], 3), np.int64)
    for k in range(header[layout.REPORTED]):
        place, size, address = fields[k, 0], fields[k, 1], fields[k, 2]
        mj.assign(mj.reals_at(address + 8 * size * number, size), reals(data, place, size))


@making
def _rest(model, data, number, header):
    """Let motors hold the robot as it stands, and drives have their forces."""
    chain, servos = shared(chain_of(model, data, header)), _motors(number, header)
    drives = drives_of(chain)
    for d in range(servos.shape[1]):
        half = servos[layout.HALF, d]
        command = servos[layout.OFFSET, d] + servos[layout.COMMAND, d] - half
        limit = reals(model, header[layout.AT.actuator_forcerange], 2 * chain.ctrl.size)[2 * d + 1]
        horn, tension = hold(drives, d, command, slack_of(chain, d), limit)[:2]
        servos[layout.HORN, d], servos[layout.MOTOR, d] = horn, horn + half
        servos[layout.TURNING, d] = 0.0
        servos[layout.EFFORT, d] = tension * lever(drives, d, horn)
        chain.ctrl[d] = horn
    if header[layout.WIRES]:
        actuate(chain)


@making
def _header_at(address):
    return array_at(address, (layout.HEADER,), np.int64)


@_entry
def refresh(model, data, number, header):
    """Compute all read-outs of a simulation, without moving it; arguments as `advance`."""
    mj.mj_forward(model, data)
    _rest(model, data, number, _header_at(header))
    _report(data, number, _header_at(header))


@_entry
def advance(model, data, number, header):
    """Advance a simulation by one control period.

    Args:
        model, data: Addresses of MuJoCo's structures.
        number: Which simulation it is: selects its memory.
        header: Address of the header.
    """
    _advance(model, data, number, _header_at(header))
    _report(data, number, _header_at(header))
