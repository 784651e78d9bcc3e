"""Time integration that states its error: extrapolated, linearly implicit Euler steps, compiled.

The chain is M(q) v' = f(q, v, u), q' = v. With K the stiffness of joints and of taut tendons driven
by length, and D the joints' damping, one Euler step of size h is

    (M + h D + h^2 K) dv = h (f - h K v),    v + dv,    q + h (v + dv).

M, f and the tendons' directions are those of the posture at its start, from MuJoCo. Tendons with
dry friction stick, or slide against it, by Coulomb's law on the velocity at the step's end. The
error of a step is a series in h, whatever approximations K and D are (P. Deuflhard and U. Nowak
1987, LIMEX), so that results of 1, 2, 3, ... steps over one interval are extrapolated to h = 0 by
Neville's scheme: k rows give order k. The difference of the last two entries estimates the error.
The first force evaluation serves all rows: 4 evaluations for order 3, 7 for order 4.

The error of an interval H is the displacement that the joints' errors cause at most, along the
backbone. Its share of the accuracy may be (rate H)^2, as that of an acceleration, within
`SMALLEST_SHARE` (what a jump of a control leaves in stiff modes does not add up) and
`LARGEST_SHARE`. An interval beyond that gets another row, and then is divided; the next one is as
long as its error lets it be.

Local errors alone say nothing of motions that part from each other: snapping, swinging upside down,
chaos. So each simulation has a shadow, the same with `integration.SHADOW` times the accuracy. How
far it strays, times the ratio of the sums of the local errors, estimates the error in time.

Everything is one C function for any robot, called by single simulations and by the threads of
`batch`; joints whose positions are no vectors are handled by `mj_integratePos`.
"""

from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from softrobot_env.scene.structs import library_path

# ---------------------------------------------------------------- MuJoCo's functions

llvmlite.binding.load_library_permanently(library_path())

_ADDRESS = types.uintp


def _function(name: str, *arguments: types.Type) -> Any:
    return types.ExternalFunction(name, types.void(_ADDRESS, _ADDRESS, *arguments))


_kinematics = _function("mj_kinematics")
_com_pos = _function("mj_comPos")
_tendon = _function("mj_tendon")
_make_mass = _function("mj_makeM")
_factor_mass = _function("mj_factorM")
_transmission = _function("mj_transmission")
_com_vel = _function("mj_comVel")
_passive = _function("mj_passive")
_rne = _function("mj_rne", types.int32, _ADDRESS)
_actuation = _function("mj_fwdActuation")
_acceleration = _function("mj_fwdAcceleration")
_fwd_position = _function("mj_fwdPosition")
_fwd_velocity = _function("mj_fwdVelocity")
_sensor_pos = _function("mj_sensorPos")
_sensor_vel = _function("mj_sensorVel")
_check_pos = _function("mj_checkPos")
_check_vel = _function("mj_checkVel")
_forward = _function("mj_forward")
_step = _function("mj_step")
_step1 = _function("mj_step1")
_step2 = _function("mj_step2")
_integrate = types.ExternalFunction(
    "mj_integratePos", types.void(_ADDRESS, _ADDRESS, _ADDRESS, types.float64)
)
_differentiate = types.ExternalFunction(
    "mj_differentiatePos", types.void(_ADDRESS, _ADDRESS, types.float64, _ADDRESS, _ADDRESS)
)


@intrinsic
def _pointer(typing, address):
    """An address as a pointer that `numba.carray` takes."""
    signature = types.voidptr(types.uintp)
    return signature, lambda context, builder, _, args: builder.inttoptr(args[0], cgutils.voidptr_t)


# ---------------------------------------------------------------- what is passed

#: Places of a robot's sizes and shared arrays in `header` (int64).
NQ, NV, NU, NBODY, NTENDON, MEMORY, STRIDE, LENGTHS = range(8)
PATH, ROWS, TOLD, TELL, SHADOW_STATES, OFFSETS = range(8, 14)

#: Arrays whose offsets in MuJoCo's structures follow in the header, from `OFFSETS` on.
MODEL_FIELDS = (
    "M_rownnz", "M_rowadr", "M_colind", "jnt_stiffness", "dof_jntid", "dof_damping",
    "actuator_biasprm", "actuator_forcerange", "ten_J_rownnz", "ten_J_rowadr", "ten_J_colind",
    "tendon_frictionloss", "actuator_gainprm",
)  # fmt: skip
DATA_FIELDS = (
    "qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied", "qacc", "M", "qfrc_passive",
    "qfrc_bias", "qfrc_actuator", "actuator_moment", "moment_rownnz", "moment_rowadr",
    "moment_colind", "actuator_force", "cdof", "qfrc_smooth", "ten_J",
    "actuator_length",
)  # fmt: skip
HEADER = OFFSETS + len(MODEL_FIELDS) + len(DATA_FIELDS) + 1  # and the time

(
    _ROWNNZ, _ROWADR, _COLIND, _STIFFNESS, _JOINT, _DAMPING, _BIASPRM, _FORCERANGE, _TENNNZ,
    _TENADR, _TENIND, _LOSS, _GAINPRM, _QPOS, _QVEL,
    _CTRL, _APPLIED, _XFRC, _QACC, _MASS, _FPASSIVE, _FBIAS, _FACTUATOR, _MOMENT, _MOMNNZ, _MOMADR,
    _MOMIND, _FORCE, _CDOF, _SMOOTH, _TENDONS, _LENGTH,
    _TIME,
) = range(OFFSETS, HEADER)  # fmt: skip

#: Places in a simulation's `memory` (float64): settings, then what it remembers and tells.
METHOD, SUBSTEPS, PERIOD, LONGEST, SHORTEST, ACCURACY, RATE, FEWEST, MOST = range(9)
NEXT, WORST, MISSED, EVALUATIONS, STEPS, SUM, ESTIMATE = range(9, 16)
MEMORY_SIZE = 16  # of a simulation; its shadow's, alike, follows

#: Values of METHOD: ours, MuJoCo's in two halves, MuJoCo's Runge-Kutta.
EXTRAPOLATED, SPLIT, WHOLE = range(3)

#: Largest and smallest share [1] of the accuracy by which one interval may err.
LARGEST_SHARE, SMALLEST_SHARE = 0.1, 0.003

_SWEEPS = 200
_HUGE = 1e10  # MuJoCo's bound of a state that has not diverged

_GAINS, _BIASES = 10, 10  # mjNGAIN, mjNBIAS

_jit = numba.njit(nogil=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"})


@_jit
def _reals(structure, place, size):
    """The array of doubles to which a structure's word points."""
    words = numba.carray(_pointer(structure), (place + 1,), np.uint64)
    return numba.carray(_pointer(words[place]), (size,), np.float64)


@_jit
def _ints(structure, place, size):
    words = numba.carray(_pointer(structure), (place + 1,), np.uint64)
    return numba.carray(_pointer(words[place]), (size,), np.int32)


@_jit
def _word(structure, place):
    return numba.carray(_pointer(structure), (place + 1,), np.uint64)[place]


# ---------------------------------------------------------------- linear algebra


@_jit
def _factorize(matrix, n):
    """Lower Cholesky factor of (n, n) in place, row by row; the diagonal holds its inverse."""
    for i in range(n):
        for j in range(i):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = rest * matrix[j, j]
        rest = matrix[i, i]
        for k in range(i):
            rest -= matrix[i, k] * matrix[i, k]
        matrix[i, i] = 1 / np.sqrt(rest)


@_jit
def _solve(factor, x, n):
    """x (n,) becomes the solution, by the factor of `_factorize`."""
    for i in range(n):
        rest = x[i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest * factor[i, i]
    for i in range(n - 1, -1, -1):
        x[i] *= factor[i, i]
        for k in range(i):
            x[k] -= factor[i, k] * x[i]


# ---------------------------------------------------------------- forces


@_jit
def _evaluate(model, data, header):
    """Kinematics, mass and all forces but the drives' at MuJoCo's state."""
    _kinematics(model, data)
    _com_pos(model, data)
    _tendon(model, data)
    _make_mass(model, data)
    _transmission(model, data)
    _com_vel(model, data)
    _passive(model, data)
    _rne(model, data, 0, _word(data, header[_FBIAS]))


@_jit
def _forces(model, data, header, nv, force):
    """All generalised forces (nv,) with the controls in force."""
    _actuation(model, data)
    passive, bias = _reals(data, header[_FPASSIVE], nv), _reals(data, header[_FBIAS], nv)
    actuator, applied = _reals(data, header[_FACTUATOR], nv), _reals(data, header[_APPLIED], nv)
    for i in range(nv):
        force[i] = passive[i] - bias[i] + actuator[i] + applied[i]
    wrenches = _reals(data, header[_XFRC], 6 * header[NBODY])
    if np.any(wrenches != 0):
        _factor_mass(model, data)
        _acceleration(model, data)
        force[:] = _reals(data, header[_SMOOTH], nv)


@_jit
def _springs(model, data, header, nu, nv, spring, rows):
    """Stiffness (nu,) [N/m] of taut drives and their rows (nu, nv) of lever arms; their number."""
    biases = _reals(model, header[_BIASPRM], nu * _BIASES)
    bounds, now = _reals(model, header[_FORCERANGE], 2 * nu), _reals(data, header[_FORCE], nu)
    moment = _reals(data, header[_MOMENT], 0)
    count = 0
    for k in range(nu):
        stiffness = -biases[k * _BIASES + 1]
        if stiffness <= 0 or now[k] <= bounds[2 * k] or now[k] >= bounds[2 * k + 1]:
            continue
        nonzero, start = _ints(data, header[_MOMNNZ], nu)[k], _ints(data, header[_MOMADR], nu)[k]
        columns = _ints(data, header[_MOMIND], start + nonzero)
        moment = _reals(data, header[_MOMENT], start + nonzero)
        rows[count, :nv] = 0.0
        for at in range(start, start + nonzero):
            rows[count, columns[at]] = moment[at]
        spring[count] = stiffness
        count += 1
    return count


@_jit
def _euler(
    model, header, nv, h, mass, force, spring, rows, count, v, matrix, change, loss, arms, rubbing
):
    """The change (nv,) of the velocities v in one linearly implicit Euler step."""
    nonzero, start = _ints(model, header[_ROWNNZ], nv), _ints(model, header[_ROWADR], nv)
    columns = _ints(model, header[_COLIND], mass.size)
    joints, damping = _ints(model, header[_JOINT], nv), _reals(model, header[_DAMPING], nv)
    stiffness = _reals(model, header[_STIFFNESS], joints[nv - 1] + 1)
    for i in range(nv):
        matrix[i, : i + 1] = 0.0
        for at in range(start[i], start[i] + nonzero[i]):
            matrix[i, columns[at]] = mass[at]
        k = stiffness[joints[i]]
        matrix[i, i] += h * (damping[i] + h * k)
        change[i] = h * (force[i] - h * k * v[i])
    for s in range(count):
        rate = 0.0
        for i in range(nv):
            rate += rows[s, i] * v[i]
        for i in range(nv):
            lever = h * h * spring[s] * rows[s, i]
            change[i] -= lever * rate
            for j in range(i + 1):
                matrix[i, j] += lever * rows[s, j]
    _factorize(matrix, nv)
    _solve(matrix, change, nv)
    if rubbing:
        _rub(nv, h, loss, arms, rubbing, v, matrix, change)


@_jit
def _rubbing(model, data, header, loss, arms):
    """Friction (k,) [N] of tendons that rub, and their rows (k, nv) of lever arms; their number."""
    count, tendons = 0, header[NTENDON]
    friction = _reals(model, header[_LOSS], tendons)
    nonzero, start = _ints(model, header[_TENNNZ], tendons), _ints(model, header[_TENADR], tendons)
    for k in range(tendons):
        if friction[k] <= 0:
            continue
        end = start[k] + nonzero[k]
        columns, values = _ints(model, header[_TENIND], end), _reals(data, header[_TENDONS], end)
        arms[count] = 0.0
        for at in range(start[k], end):
            arms[count, columns[at]] = values[at]
        loss[count] = friction[k]
        count += 1
    return count


@_jit
def _rub(nv, h, loss, arms, count, v, factor, change):
    """Let tendons stick, or slide against their friction, at the end of an Euler step.

    Coulomb's law on the velocity at its end, by projected Gauss-Seidel sweeps over the impulses.
    """
    answers, rates, impulses = np.empty((count, nv)), np.empty(count), np.zeros(count)
    own = np.empty(count)
    for k in range(count):
        answers[k] = arms[k]
        _solve(factor, answers[k], nv)
        rates[k] = own[k] = 0.0
        for i in range(nv):
            rates[k] += arms[k, i] * (v[i] + change[i])
            own[k] += arms[k, i] * answers[k, i]
    for _ in range(_SWEEPS):
        moved = 0.0
        for k in range(count):
            if own[k] <= 0:
                continue
            wanted = impulses[k] + rates[k] / own[k]
            wanted = min(max(wanted, -h * loss[k]), h * loss[k])
            step = wanted - impulses[k]
            impulses[k] = wanted
            moved = max(moved, abs(step) / (h * loss[k]))
            for j in range(count):
                coupling = 0.0
                for i in range(nv):
                    coupling += arms[j, i] * answers[k, i]
                rates[j] -= step * coupling
        if moved < 1e-12:
            break
    for k in range(count):
        for i in range(nv):
            change[i] -= impulses[k] * answers[k, i]


@_jit
def _displacement(data, header, nv, lengths, turn):
    """Largest displacement [m] of the backbone by small turns (nv,) of the joints, at most."""
    axes = _reals(data, header[_CDOF], 6 * nv)
    x, y, z, way = 0.0, 0.0, 0.0, 0.0
    for i in range(nv):
        x += axes[6 * i] * turn[i]
        y += axes[6 * i + 1] * turn[i]
        z += axes[6 * i + 2] * turn[i]
        way += lengths[i] * np.sqrt(x * x + y * y + z * z)
    return way


@_jit
def _regime(force, low, high):
    """Whether a drive of a length lets its tendon slacken (-1), winds it (0) or is at its limit."""
    return -1 if force <= low else 1 if force >= high else 0


@_jit
def _jumps(model, data, header, before, jump):
    """Forces (nu,) [N] at the end of a step less those that its last stage led to expect.

    They differ where a tendon went slack or taut, or came to its limit, since the forces `before`.
    Returns whether there are any.
    """
    nu = header[NU]
    gains = _reals(model, header[_GAINPRM], nu * _GAINS)
    biases = _reals(model, header[_BIASPRM], nu * _BIASES)
    bounds, now = _reals(model, header[_FORCERANGE], 2 * nu), _reals(data, header[_FORCE], nu)
    ctrl, length = _reals(data, header[_CTRL], nu), _reals(data, header[_LENGTH], nu)
    found = False
    for k in range(nu):
        jump[k] = 0.0
        low, high, at = bounds[2 * k], bounds[2 * k + 1], k * _BIASES
        was = _regime(before[k], low, high)
        if biases[at + 1] < 0 and was != _regime(now[k], low, high):
            free = gains[k * _GAINS] * ctrl[k] + biases[at] + biases[at + 1] * length[k]
            jump[k] = now[k] - (free if was == 0 else before[k])
            found = True
    return found


@_jit
def _pull(model, data, header, nv, tension, force):
    """Generalised forces (nv,) of drives' forces (nu,) [N]."""
    force[:] = 0.0
    for k in range(header[NU]):
        nonzero, start = (
            _ints(data, header[_MOMNNZ], header[NU])[k],
            _ints(data, header[_MOMADR], header[NU])[k],
        )
        columns = _ints(data, header[_MOMIND], start + nonzero)
        moment = _reals(data, header[_MOMENT], start + nonzero)
        for at in range(start, start + nonzero):
            force[columns[at]] += tension[k] * moment[at]


@_jit
def _lengthen(model, data):
    """Tendons of MuJoCo's posture."""
    _kinematics(model, data)
    _com_pos(model, data)
    _tendon(model, data)
    _transmission(model, data)


# ---------------------------------------------------------------- a control period


@_jit
def _drive(ctrl, begin, end, share):
    for k in range(ctrl.size):
        ctrl[k] = begin[k] + share * (end[k] - begin[k])


@_jit
def _integrate_segment(model, data, header, memory, begin, end, duration):
    """Advance over a time [s] in which the controls go from `begin` to `end` (nu,) steadily."""
    nq, nv, nu = header[NQ], header[NV], header[NU]
    lengths = numba.carray(_pointer(np.uint64(header[LENGTHS])), (nv,), np.float64)
    q, v, ctrl = (
        _reals(data, header[_QPOS], nq),
        _reals(data, header[_QVEL], nv),
        _reals(data, header[_CTRL], nu),
    )
    start, nonzero = _ints(model, header[_ROWADR], nv), _ints(model, header[_ROWNNZ], nv)
    mass = _reals(data, header[_MASS], start[nv - 1] + nonzero[nv - 1])
    most = int(memory[MOST])
    q0, v0, mass0, force0 = np.empty(nq), np.empty(nv), np.empty(mass.size), np.empty(nv)
    force, change, matrix = np.empty(nv), np.empty(nv), np.empty((nv, nv))
    turn, speed = np.empty((most, nv)), np.empty((most, nv))
    spring0, rows0 = np.empty(nu), np.empty((nu, nv))
    spring, rows = np.empty(nu), np.empty((nu, nv))
    loss, tendons = np.empty(header[NTENDON]), header[NTENDON]
    arms0, arms = np.empty((tendons, nv)), np.empty((tendons, nv))
    gap, table = np.empty(nv), np.empty((2, nv))
    before, jump, still = np.empty(nu), np.empty(nu), np.zeros(nv)
    winding = False
    biases = _reals(model, header[_BIASPRM], nu * _BIASES)
    for k in range(nu):
        if biases[k * _BIASES + 1] < 0:
            winding = True
    steady = True
    for k in range(nu):
        if begin[k] != end[k]:
            steady = False
    time, length = 0.0, min(memory[NEXT], memory[LONGEST])
    while time < duration * (1 - 1e-12):
        left = np.ceil((duration - time) / length - 1e-9)
        h = (duration - time) / max(left, 1.0)
        q0[:], v0[:] = q, v
        _drive(ctrl, begin, end, time / duration)
        _forces(model, data, header, nv, force0)
        memory[EVALUATIONS] += 1
        mass0[:] = mass
        count0 = _springs(model, data, header, nu, nv, spring0, rows0)
        rubbing = _rubbing(model, data, header, loss, arms0)
        while True:
            error, used = np.inf, 0
            for row in range(most):
                part = h / (row + 1)
                for k in range(row + 1):
                    if k == 0:
                        q[:], v[:] = q0, v0
                        _euler(
                            model,
                            header,
                            nv,
                            part,
                            mass0,
                            force0,
                            spring0,
                            rows0,
                            count0,
                            v,
                            matrix,
                            change,
                            loss,
                            arms0,
                            rubbing,
                        )
                    else:
                        _evaluate(model, data, header)
                        if not steady:
                            _drive(ctrl, begin, end, (time + k * part) / duration)
                        _forces(model, data, header, nv, force)
                        memory[EVALUATIONS] += 1
                        count = _springs(model, data, header, nu, nv, spring, rows)
                        _rubbing(model, data, header, loss, arms)
                        _euler(
                            model,
                            header,
                            nv,
                            part,
                            mass,
                            force,
                            spring,
                            rows,
                            count,
                            v,
                            matrix,
                            change,
                            loss,
                            arms,
                            rubbing,
                        )
                    for i in range(nv):
                        v[i] += change[i]
                    _integrate(model, q.ctypes.data, v.ctypes.data, part)
                # Neville: entry j of this row from entry j - 1 of this row and of the one before.
                _differentiate(model, table[0].ctypes.data, 1.0, q0.ctypes.data, q.ctypes.data)
                table[1] = v
                for j in range(row):
                    weight = 1 / ((row + 1) / (row - j) - 1)
                    for i in range(nv):
                        old = turn[j, i]
                        turn[j, i] = table[0, i]
                        table[0, i] += weight * (table[0, i] - old)
                        gap[i] = table[0, i] - turn[j, i]
                        old = speed[j, i]
                        speed[j, i] = table[1, i]
                        table[1, i] += weight * (table[1, i] - old)
                turn[row], speed[row] = table[0], table[1]
                used = row + 1
                if used >= memory[FEWEST]:
                    share = min((memory[RATE] * h) ** 2, LARGEST_SHARE) + SMALLEST_SHARE
                    error = _displacement(data, header, nv, lengths, gap) / (
                        share * memory[ACCURACY]
                    )
                    if error <= 1 and winding:
                        before[:] = _reals(data, header[_FORCE], nu)
                        q[:] = q0
                        _integrate(model, q.ctypes.data, turn[row].ctypes.data, 1.0)
                        _lengthen(model, data)
                        _drive(ctrl, begin, end, (time + h) / duration)
                        _actuation(model, data)
                        if _jumps(model, data, header, before, jump):
                            _pull(model, data, header, nv, jump, force)
                            count = _springs(model, data, header, nu, nv, spring, rows)
                            _euler(
                                model,
                                header,
                                nv,
                                part,
                                mass,
                                force,
                                spring,
                                rows,
                                count,
                                still,
                                matrix,
                                change,
                                loss,
                                arms,
                                0,
                            )
                            for i in range(nv):
                                change[i] *= part
                            unseen = _displacement(data, header, nv, lengths, change)
                            error = max(error, unseen / (share * memory[ACCURACY]))
                    if error <= 1:
                        break
            if error <= 1 or not h > (1 + 1e-9) * memory[SHORTEST]:
                break
            ratio = 1 / error  # not a number where the step has blown up
            h *= max(0.25, 0.9 * ratio ** (1 / (used - 1))) if ratio > 0 else 0.25
            h = (duration - time) / np.ceil((duration - time) / max(h, memory[SHORTEST]))
        best = used - 1
        if not error <= 1:
            memory[MISSED] += 1
            best = 0  # plain Euler steps, which are stable
        memory[WORST] = max(memory[WORST], error) if error == error else np.inf
        share = min((memory[RATE] * h) ** 2, LARGEST_SHARE) + SMALLEST_SHARE
        memory[SUM] += error * share * memory[ACCURACY]
        memory[STEPS] += 1
        accel = _reals(data, header[_QACC], nv)
        q[:] = q0
        _integrate(model, q.ctypes.data, turn[best].ctypes.data, 1.0)
        for i in range(nv):
            v[i] = speed[best, i]
            accel[i] = (v[i] - v0[i]) / h
        time += h
        growth = 0.8 * (1 / max(error, 1e-300)) ** (1 / (used - 1)) if error < np.inf else 0.5
        # A row too many costs less than an interval too short.
        length = h * min(max(growth, 0.5), 2.0)
        length = min(max(length, memory[SHORTEST]), memory[LONGEST])
        bad = False
        for i in range(nv):
            if not abs(v[i]) <= _HUGE:
                bad = True
        if bad:
            break
        if time < duration * (1 - 1e-12):
            _evaluate(model, data, header)
    memory[NEXT] = length
    _drive(ctrl, begin, end, 1.0)


@_jit
def _finish(model, data):
    """All read-outs of the new state, and MuJoCo's own checks of it.

    Not that of accelerations: those of small stiff robots are above its bound of 1e10, and one that
    is not finite shows in the velocity.
    """
    _check_pos(model, data)
    _check_vel(model, data)
    _fwd_position(model, data)
    _sensor_pos(model, data)
    _fwd_velocity(model, data)
    _sensor_vel(model, data)
    _actuation(model, data)


@_jit
def _integrate_period(model, data, header, memory, path, rows, held):
    """Advance by a control period along a path (rows, nu) of controls, whose end is `held`."""
    substeps = int(memory[SUBSTEPS])
    tick = memory[PERIOD] / substeps
    for k in range(rows - 1):
        if k:
            _evaluate(model, data, header)
        _integrate_segment(model, data, header, memory, path[k], path[k + 1], tick)
    if rows - 1 < substeps:
        if rows > 1:
            _evaluate(model, data, header)
        rest = memory[PERIOD] - max(rows - 1, 0) * tick
        _integrate_segment(model, data, header, memory, held, held, rest)


@_jit
def _states(header, number):
    """Where a simulation and its shadow were at the end of the last period, (2, nq + nv)."""
    size = header[NQ] + header[NV]
    start = int(header[SHADOW_STATES] + number * 16 * size)
    return numba.carray(_pointer(np.uint64(start)), (2, size), np.float64)


@_jit
def _follow(states, q, v):
    """Let the shadow start anew where the simulation is, if that was moved."""
    for i in range(q.size + v.size):
        now = q[i] if i < q.size else v[i - q.size]
        if states[0, i] != now or not abs(states[1, i]) <= _HUGE:
            states[1, : q.size], states[1, q.size :] = q, v
            break


@_jit
def _compare(model, data, header, memory, shadowed, states):
    """Estimate the error from how far the shadow has strayed."""
    nq, nv = header[NQ], header[NV]
    lengths = numba.carray(_pointer(np.uint64(header[LENGTHS])), (nv,), np.float64)
    turn = np.empty(nv)
    here, there = states[0, :nq].ctypes.data, states[1, :nq].ctypes.data
    _differentiate(model, turn.ctypes.data, 1.0, here, there)
    strayed = _displacement(data, header, nv, lengths, turn)
    if not strayed < np.inf:
        estimate = np.inf
    elif shadowed[SUM] > 0:
        estimate = strayed * memory[SUM] / shadowed[SUM]
    else:
        estimate = 0.0
    memory[ESTIMATE] = max(memory[ESTIMATE], estimate)


@_jit
def _advance(model, data, number, header_address):
    header = numba.carray(_pointer(header_address), (HEADER,), np.int64)
    nu = header[NU]
    memory = numba.carray(
        _pointer(np.uint64(header[MEMORY] + number * header[STRIDE])), (MEMORY_SIZE,), np.float64
    )
    ctrl = _reals(data, header[_CTRL], nu)
    memory[MISSED] = 0.0
    rows = header[ROWS]
    path = numba.carray(_pointer(np.uint64(header[PATH])), (max(rows, 1), nu), np.float64)
    substeps = int(memory[SUBSTEPS])
    if memory[METHOD] == EXTRAPOLATED:
        start = int(header[MEMORY] + number * header[STRIDE] + 8 * MEMORY_SIZE)
        shadowed = numba.carray(_pointer(np.uint64(start)), (MEMORY_SIZE,), np.float64)
        q, v = _reals(data, header[_QPOS], header[NQ]), _reals(data, header[_QVEL], header[NV])
        states = _states(header, number)
        _follow(states, q, v)
        held = path[rows - 1].copy() if rows else ctrl.copy()
        _integrate_period(model, data, header, memory, path, rows, held)
        states[0, : q.size], states[0, q.size :] = q, v
        q[:], v[:] = states[1, : q.size], states[1, q.size :]
        _evaluate(model, data, header)
        _integrate_period(model, data, header, shadowed, path, rows, held)
        states[1, : q.size], states[1, q.size :] = q, v
        q[:], v[:] = states[0, : q.size], states[0, q.size :]
        numba.carray(_pointer(data), (header[_TIME] + 1,), np.float64)[header[_TIME]] += memory[
            PERIOD
        ]
        _finish(model, data)
        _compare(model, data, header, memory, shadowed, states)
    else:
        for k in range(substeps):
            if rows:
                ctrl[:] = path[min(k, rows - 1)]
            if k == 0 and memory[METHOD] == SPLIT:
                _step2(model, data)
            else:
                _step(model, data)
        if rows:
            ctrl[:] = path[rows - 1]
        _step1(model, data)
        memory[EVALUATIONS] += substeps * (4 if memory[METHOD] == WHOLE else 1)
        memory[STEPS] += substeps


@_jit
def _tell(data, number, header_address):
    """Copy what is to be told of a simulation to its row of the arrays of all."""
    header = numba.carray(_pointer(header_address), (HEADER,), np.int64)
    told = numba.carray(_pointer(np.uint64(header[TELL])), (header[TOLD], 3), np.int64)
    for k in range(header[TOLD]):
        place, size, address = told[k, 0], told[k, 1], told[k, 2]
        row = numba.carray(_pointer(np.uint64(address + 8 * size * number)), (size,), np.float64)
        row[:] = _reals(data, place, size)


@numba.cfunc(types.void(_ADDRESS, _ADDRESS, types.int32, _ADDRESS), nopython=True, cache=True)
def refresh(model, data, number, header):
    """Compute all read-outs of a simulation, without moving it; arguments as `advance`."""
    _forward(model, data)
    _tell(data, number, header)


@numba.cfunc(types.void(_ADDRESS, _ADDRESS, types.int32, _ADDRESS), nopython=True, cache=True)
def advance(model, data, number, header):
    """Advance a simulation by one control period.

    Args:
        model, data: Addresses of MuJoCo's structures.
        number: Which simulation it is: selects its memory.
        header: Address of the header.
    """
    _advance(model, data, number, header)
    _tell(data, number, header)
