"""Inertias, forces, springs and friction of a chain in one posture, for compiled code."""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import mujoco_functions as mj
from .articulated import AXIS, INERTIA
from .capstan import find_zones
from .layout import (
    AT,
    DRIVE_SIZE,
    DRIVES_TOO,
    LENGTHS,
    LINEAR,
    NBODY,
    NQ,
    NTENDON,
    NU,
    NV,
    RUBBING,
    RUNS,
    TAKEN,
    WIRES,
)
from .motors import SOFTEST, wire_force, wire_stiffness, wound
from .mujoco_functions import ints, reals

#: Parameters of a drive's law in MuJoCo, mjNBIAS.
BIASES = 10


class Chain(NamedTuple):
    """A simulation, as views of MuJoCo's arrays.

    Attributes:
        model, data: Addresses of MuJoCo's structures.
        header: See `layout`.
        q, v, ctrl: (nq,), (nv,), (nu,).
        axes, inertias: (6 nv,), (10 nbody,), of the DOFs and the bodies, see `articulated`.
        lengths: (nv,) [m], see `chain.backbone_lengths`.
        runs: (nbody,), see `articulated`.
    """

    model: int
    data: int
    header: ndarray
    q: ndarray
    v: ndarray
    ctrl: ndarray
    axes: ndarray
    inertias: ndarray
    lengths: ndarray
    runs: ndarray


class Forces(NamedTuple):
    """What acts on a chain in one posture.

    Attributes:
        axes, inertias: (6 nv,), (10 nbody,), as the chain's.
        force: (nv,), all generalised forces but friction of tendons.
        tension: (nu,) [N] of all drives.
        stiffness: (nu,) [N/m] of taut drives.
        drives: (nu,), their numbers.
        pulls: (nu, nv), their moment arms.
        friction: (elements,) [N] of whatever tension, of elements: whole tendons or their zones.
        arms: (elements, nv), moment arms of the lengths that slide.
        grows, shrinks: (elements,), change of tension [1] in a zone over that before it, as that
            length grows and as it shrinks; see `capstan`.
        drive: (elements,), which drive makes the tension, -1 of whole tendons.
        name: (elements,), places in the next two, the same in all postures.
        grip: (elements,) [N], the friction in the last Euler step from here.
        slide: (elements,), whether they slid in it, by the sign of the length's rate, or stuck (0).
        course: (5, nv + nbody), see `capstan`.
        counts: Numbers (2,) of taut drives and of elements, which come first.
    """

    axes: ndarray
    inertias: ndarray
    force: ndarray
    tension: ndarray
    stiffness: ndarray
    drives: ndarray
    pulls: ndarray
    friction: ndarray
    arms: ndarray
    grows: ndarray
    shrinks: ndarray
    drive: ndarray
    name: ndarray
    grip: ndarray
    slide: ndarray
    course: ndarray
    counts: ndarray


@making
def chain_of(model, data, header):
    """The chain of a simulation."""
    nv = header[NV]
    return Chain(
        model,
        data,
        header,
        reals(data, header[AT.qpos], header[NQ]),
        reals(data, header[AT.qvel], nv),
        reals(data, header[AT.ctrl], header[NU]),
        reals(data, header[AT.cdof], AXIS * nv),
        reals(data, header[AT.cinert], INERTIA * header[NBODY]),
        mj.reals_at(header[LENGTHS], nv),
        mj.ints_at(header[RUNS], header[NBODY]),
    )


@jit
def forces_size(chain):
    """Number of doubles that `no_forces` cuts."""
    nv, nu, elements = chain.v.size, chain.ctrl.size, chain.header[RUBBING]
    fixed = chain.axes.size + chain.inertias.size + nv + 2 + 5 * (nv + chain.header[NBODY])
    return fixed + nu * (nv + 3) + elements * (nv + 7)


@making
def no_forces(chain, room):
    """Arrays for `measure`, cut from free memory."""
    nv, nu, elements = chain.v.size, chain.ctrl.size, chain.header[RUBBING]
    return Forces(
        mj.cut(room, 1, chain.axes.size)[0],
        mj.cut(room, 1, chain.inertias.size)[0],
        mj.cut(room, 1, nv)[0],
        mj.cut(room, 1, nu)[0],
        mj.cut(room, 1, nu)[0],
        mj.cut(room, 1, nu)[0],
        mj.cut(room, nu, nv),
        mj.cut(room, 1, elements)[0],
        mj.cut(room, elements, nv),
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 5, nv + chain.header[NBODY]),
        mj.cut(room, 1, 2)[0],
    )


@jit
def evaluate(chain):
    """Kinematics, inertias and all forces but the drives' at MuJoCo's state."""
    model, data = chain.model, chain.data
    mj.mj_kinematics(model, data)
    mj.mj_com_pos(model, data)
    place_tendons(chain)
    mj.mj_fwd_velocity(model, data)


@jit
def place_tendons(chain):
    """Lengths and moment arms of tendons and drives in MuJoCo's positions.

    Moment arms of lengths that are linear in the positions stay as `mj_forward` left them.
    """
    model, data, header, nu = chain.model, chain.data, chain.header, chain.ctrl.size
    tendons = header[NTENDON]
    if header[LINEAR]:
        nonzero = ints(model, header[AT.ten_J_rownnz], tendons)
        start = ints(model, header[AT.ten_J_rowadr], tendons)
        lengths = reals(data, header[AT.ten_length], tendons)
        for k in range(tendons):
            end = start[k] + nonzero[k]
            columns = ints(model, header[AT.ten_J_colind], end)
            arms = reals(data, header[AT.ten_J], end)
            lengths[k] = _along(chain.q, columns, arms, start[k])
    else:
        mj.mj_tendon(model, data)
    if header[LINEAR] < DRIVES_TOO:
        mj.mj_transmission(model, data)
        return
    nonzero = ints(data, header[AT.moment_rownnz], nu)
    start = ints(data, header[AT.moment_rowadr], nu)
    lengths = reals(data, header[AT.actuator_length], nu)
    for k in range(nu):
        end = start[k] + nonzero[k]
        columns = ints(data, header[AT.moment_colind], end)
        arms = reals(data, header[AT.actuator_moment], end)
        lengths[k] = _along(chain.q, columns, arms, start[k])


@jit
def _along(q, columns, arms, start):
    """The length that positions make by a sparse row of moment arms, from `start` on."""
    length = 0.0
    for at in range(start, arms.size):
        length += arms[at] * q[columns[at]]
    return length


@jit
def measure(chain, forces):
    """All that acts where `evaluate` was called last, with the controls in force."""
    _sum_forces(chain, forces.force)
    mj.assign(forces.axes, chain.axes)
    mj.assign(forces.inertias, chain.inertias)
    mj.assign(forces.tension, drive_forces(chain))
    find_springs(chain, forces.tension, forces)
    _find_rubbing(chain, forces)
    if chain.header[RUBBING] > chain.header[NTENDON]:
        find_zones(chain, forces)


@jit
def _sum_forces(chain, force):
    """All generalised forces (nv,)."""
    model, data, header, nv = chain.model, chain.data, chain.header, chain.v.size
    actuate(chain)
    passive, bias = reals(data, header[AT.qfrc_passive], nv), reals(data, header[AT.qfrc_bias], nv)
    actuator = reals(data, header[AT.qfrc_actuator], nv)
    applied = reals(data, header[AT.qfrc_applied], nv)
    for i in range(nv):
        force[i] = passive[i] - bias[i] + actuator[i] + applied[i]
    if _any(reals(data, header[AT.xfrc_applied], 6 * header[NBODY])):
        mj.mj_acceleration(model, data)  # for its sum: the acceleration has no mass matrix
        mj.assign(force, reals(data, header[AT.qfrc_smooth], nv))


@jit
def actuate(chain):
    """Forces of the drives with the controls in force, as MuJoCo has them or by `motors`."""
    bounds = reals(chain.model, chain.header[AT.actuator_forcerange], 2 * chain.ctrl.size)
    force = reals(chain.data, chain.header[AT.qfrc_actuator], chain.v.size)
    for i in range(force.size):
        force[i] = 0.0
    for k in range(chain.ctrl.size):
        pull = _limited(_unlimited(chain, k), bounds, k)
        drive_forces(chain)[k] = pull
        _add_pull(chain, k, pull, force)


@jit
def _limited(value, ranges, k):
    """A value within the k-th of ranges (2 n,); those without a width limit nothing."""
    low, high = ranges[2 * k], ranges[2 * k + 1]
    return min(max(value, low), high) if low < high else value


@making
def drives_of(chain):
    """Parameters (DRIVE_SIZE nu,) of all drives, see `layout`."""
    return reals(chain.model, chain.header[AT.actuator_gainprm], chain.ctrl.size * DRIVE_SIZE)


@jit
def slack_of(chain, k):
    """Stretch [m] of a drive's wire if nothing were wound."""
    drives, nu = drives_of(chain), chain.ctrl.size
    biases = reals(chain.model, chain.header[AT.actuator_biasprm], nu * BIASES)
    length = reals(chain.data, chain.header[AT.actuator_length], nu)[k]
    linear = biases[k * BIASES] + biases[k * BIASES + 1] * length
    return drives[k * DRIVE_SIZE + TAKEN] + linear / drives[k * DRIVE_SIZE]


@jit
def _stretch(chain, k):
    """Stretch [m] of a drive's wire, by its control."""
    return wound(drives_of(chain), k, chain.ctrl[k]) + slack_of(chain, k)


@jit
def _unlimited(chain, k):
    """Force [N] that a drive had if it pulled like a spring, whatever its limits."""
    nu, bias = chain.ctrl.size, k * BIASES
    biases = reals(chain.model, chain.header[AT.actuator_biasprm], nu * BIASES)
    if chain.header[WIRES] and biases[bias + 1] < 0:
        return wire_force(drives_of(chain), k, _stretch(chain, k))
    control = _limited(
        chain.ctrl[k], reals(chain.model, chain.header[AT.actuator_ctrlrange], 2 * nu), k
    )
    length = reals(chain.data, chain.header[AT.actuator_length], nu)[k]
    # In MuJoCo's order, so that nothing is slack in one of them alone; a length that has diverged
    # is nothing to who pulls by a force.
    spring = biases[bias]
    if biases[bias + 1] != 0:
        spring += biases[bias + 1] * length
    return spring + drives_of(chain)[k * DRIVE_SIZE] * control


@jit
def _any(values):
    """Whether one of (n,) is not zero."""
    for i in range(values.size):
        if values[i] != 0:
            return True
    return False


@jit
def find_springs(chain, before, forces):
    """Find the drives that pull like a spring, now or by the forces `before` (nu,) [N]."""
    model, data, header, nu = chain.model, chain.data, chain.header, chain.ctrl.size
    biases = reals(model, header[AT.actuator_biasprm], nu * BIASES)
    bounds = reals(model, header[AT.actuator_forcerange], 2 * nu)
    now = drive_forces(chain)
    nonzero = ints(data, header[AT.moment_rownnz], nu)
    start = ints(data, header[AT.moment_rowadr], nu)
    count = 0
    for k in range(nu):
        own = -biases[k * BIASES + 1]
        low, high = bounds[2 * k], bounds[2 * k + 1]
        if own <= 0 or (_law(now[k], low, high) and _law(before[k], low, high)):
            continue
        end = start[k] + nonzero[k]
        columns = ints(data, header[AT.moment_colind], end)
        moments = reals(data, header[AT.actuator_moment], end)
        _spread(moments, columns, start[k], forces.pulls[count])
        if header[WIRES]:
            own = max(wire_stiffness(drives_of(chain), k, _stretch(chain, k)), SOFTEST * own)
        forces.stiffness[count] = own
        forces.drives[count] = k
        count += 1
    forces.counts[0] = count


@jit
def _find_rubbing(chain, forces):
    """Find the tendons that rub whatever their tension."""
    model, data, header, tendons = chain.model, chain.data, chain.header, chain.header[NTENDON]
    losses = reals(model, header[AT.tendon_frictionloss], tendons)
    nonzero = ints(model, header[AT.ten_J_rownnz], tendons)
    start = ints(model, header[AT.ten_J_rowadr], tendons)
    count = 0
    for k in range(forces.grip.size):
        forces.grip[k] = 0.0
    for k in range(tendons):
        if losses[k] <= 0:
            continue
        end = start[k] + nonzero[k]
        columns = ints(model, header[AT.ten_J_colind], end)
        _spread(reals(data, header[AT.ten_J], end), columns, start[k], forces.arms[count])
        forces.friction[count], forces.name[count] = losses[k], k
        forces.grows[count], forces.shrinks[count], forces.drive[count] = 0.0, 0.0, -1.0
        count += 1
    forces.counts[1] = count


@jit
def _spread(values, columns, start, row):
    """Elements of a sparse row, from `start` on, as a row (nv,)."""
    for i in range(row.size):
        row[i] = 0.0
    for at in range(start, values.size):
        row[columns[at]] = values[at]


# ---------------------------------------------------------------------- drives change their law

# A drive of a length pulls like a spring while its tendon is taut and below its limit. Where a
# tendon goes slack or taut, or comes to its limit, between the last evaluation of all forces and
# the end of an interval, no row of the extrapolation sees it: all agree, and all are wrong. So the
# forces at the end are compared with what the last evaluation led to expect.


@jit
def drives_length(chain):
    """Whether any drive pulls like a spring."""
    biases = reals(chain.model, chain.header[AT.actuator_biasprm], chain.ctrl.size * BIASES)
    for k in range(chain.ctrl.size):
        if biases[k * BIASES + 1] < 0:
            return True
    return False


@making
def drive_forces(chain):
    """View (nu,) of the drives' forces [N] of the last evaluation."""
    return reals(chain.data, chain.header[AT.actuator_force], chain.ctrl.size)


@jit
def find_switched(chain, before, forces):
    """Let `forces` be the surprises of drives in MuJoCo's positions, with the springs there.

    Args:
        chain: Its positions and controls are those at the end of an interval.
        before: (nu,) [N], forces of the drives in the last evaluation.
        forces: Their axes and inertias stay as they are.

    Returns:
        Whether any drive has changed its law.
    """
    model, data = chain.model, chain.data
    mj.mj_kinematics(model, data)
    mj.mj_com_pos(model, data)
    place_tendons(chain)
    actuate(chain)
    return find_surprises(chain, before, forces)


@jit
def find_surprises(chain, before, forces):
    """As `find_switched`, with the drives' forces of the last evaluation."""
    found = False
    for i in range(chain.v.size):
        forces.force[i] = 0.0
    for k in range(chain.ctrl.size):
        surprise = _surprise(chain, before, k)
        if surprise != 0:
            found = True
            _add_pull(chain, k, surprise, forces.force)
    find_springs(chain, before, forces)
    forces.counts[1] = 0
    return found


@jit
def _surprise(chain, before, k):
    """Force [N] of a drive less that of the law it had in the last evaluation."""
    model, header, nu = chain.model, chain.header, chain.ctrl.size
    bounds = reals(model, header[AT.actuator_forcerange], 2 * nu)
    biases = reals(model, header[AT.actuator_biasprm], nu * BIASES)
    low, high = bounds[2 * k], bounds[2 * k + 1]
    now, was = drive_forces(chain)[k], _law(before[k], low, high)
    if biases[k * BIASES + 1] >= 0 or _law(now, low, high) == was:
        return 0.0
    if was != 0:
        return now - before[k]
    return now - _unlimited(chain, k)


@jit
def _law(force, low, high):
    """Whether a drive leaves its tendon slack (-1), pulls like a spring (0) or by its limit (1)."""
    return -1 if force <= low else 1 if force >= high else 0


@jit
def _add_pull(chain, k, pull, force):
    """Add a drive's pull [N] to generalised forces (nv,)."""
    data, header, nu = chain.data, chain.header, chain.ctrl.size
    start = ints(data, header[AT.moment_rowadr], nu)[k]
    end = start + ints(data, header[AT.moment_rownnz], nu)[k]
    columns = ints(data, header[AT.moment_colind], end)
    arms = reals(data, header[AT.actuator_moment], end)
    for at in range(start, end):
        force[columns[at]] += pull * arms[at]
