"""Mass, forces, springs and friction of a chain in one posture, for compiled code."""

from typing import NamedTuple

import numpy as np

from softrobot_env.scene.integration.layout import AT, LENGTHS, NBODY, NQ, NTENDON, NU, NV
from softrobot_env.scene.integration.mujoco_functions import (
    assign,
    cut,
    inlined,
    ints,
    jit,
    making,
    mj_acceleration,
    mj_actuation,
    mj_com_pos,
    mj_com_vel,
    mj_factor_mass,
    mj_kinematics,
    mj_make_mass,
    mj_passive,
    mj_rne,
    mj_tendon,
    mj_transmission,
    reals,
    reals_at,
    word,
)

#: Parameters of a drive's law in MuJoCo, mjNBIAS.
BIASES = 10


class Chain(NamedTuple):
    """A simulation, as views of MuJoCo's arrays.

    Attributes:
        model, data: Addresses of MuJoCo's structures.
        header: See `layout`.
        q, v, ctrl: (nq,), (nv,), (nu,).
        mass: (nM,), elements of the mass matrix that are not zero, by rows.
        lengths: (nv,) [m], see `integrator.backbone_lengths`.
    """

    model: int
    data: int
    header: np.ndarray
    q: np.ndarray
    v: np.ndarray
    ctrl: np.ndarray
    mass: np.ndarray
    lengths: np.ndarray


class Forces(NamedTuple):
    """What acts on a chain in one posture.

    Attributes:
        mass: (nM,), as the chain's.
        force: (nv,), all generalised forces but friction of tendons.
        stiffness: (nu,) [N/m] of taut drives.
        pulls: (nu, nv), their lever arms.
        friction: (ntendon,) [N] of tendons that rub.
        arms: (ntendon, nv), their lever arms.
        counts: Numbers (2,) of taut drives and of tendons that rub, which come first.
    """

    mass: np.ndarray
    force: np.ndarray
    stiffness: np.ndarray
    pulls: np.ndarray
    friction: np.ndarray
    arms: np.ndarray
    counts: np.ndarray


@making
def chain_of(model, data, header):
    """The chain of a simulation."""
    nv = header[NV]
    start, nonzero = ints(model, header[AT.M_rowadr], nv), ints(model, header[AT.M_rownnz], nv)
    return Chain(
        model,
        data,
        header,
        reals(data, header[AT.qpos], header[NQ]),
        reals(data, header[AT.qvel], nv),
        reals(data, header[AT.ctrl], header[NU]),
        reals(data, header[AT.M], start[nv - 1] + nonzero[nv - 1]),
        reals_at(header[LENGTHS], nv),
    )


@making
def no_forces(chain, room):
    """Arrays for `measure`, cut from free memory."""
    nv, nu, tendons = chain.v.size, chain.ctrl.size, chain.header[NTENDON]
    return Forces(
        cut(room, 1, chain.mass.size)[0],
        cut(room, 1, nv)[0],
        cut(room, 1, nu)[0],
        cut(room, nu, nv),
        cut(room, 1, tendons)[0],
        cut(room, tendons, nv),
        cut(room, 1, 2)[0],
    )


@inlined
def evaluate(chain):
    """Kinematics, mass and all forces but the drives' at MuJoCo's state."""
    model, data = chain.model, chain.data
    mj_kinematics(model, data)
    mj_com_pos(model, data)
    mj_tendon(model, data)
    mj_make_mass(model, data)
    mj_transmission(model, data)
    mj_com_vel(model, data)
    mj_passive(model, data)
    mj_rne(model, data, 0, word(data, chain.header[AT.qfrc_bias]))


@inlined
def measure(chain, forces):
    """All that acts where `evaluate` was called last, with the controls in force."""
    _sum_forces(chain, forces.force)
    assign(forces.mass, chain.mass)
    forces.counts[0] = find_taut(chain, forces.stiffness, forces.pulls)
    forces.counts[1] = _find_rubbing(chain, forces.friction, forces.arms)


@jit
def _sum_forces(chain, force):
    """All generalised forces (nv,)."""
    model, data, header, nv = chain.model, chain.data, chain.header, chain.v.size
    mj_actuation(model, data)
    passive, bias = reals(data, header[AT.qfrc_passive], nv), reals(data, header[AT.qfrc_bias], nv)
    actuator = reals(data, header[AT.qfrc_actuator], nv)
    applied = reals(data, header[AT.qfrc_applied], nv)
    for i in range(nv):
        force[i] = passive[i] - bias[i] + actuator[i] + applied[i]
    if _any(reals(data, header[AT.xfrc_applied], 6 * header[NBODY])):
        mj_factor_mass(model, data)
        mj_acceleration(model, data)
        assign(force, reals(data, header[AT.qfrc_smooth], nv))


@jit
def _any(values):
    """Whether one of (n,) is not zero."""
    for i in range(values.size):
        if values[i] != 0:
            return True
    return False


@jit
def find_taut(chain, stiffness, pulls):
    """Stiffness and lever arms of drives within their range of forces; their number."""
    model, data, header, nu = chain.model, chain.data, chain.header, chain.ctrl.size
    biases = reals(model, header[AT.actuator_biasprm], nu * BIASES)
    bounds = reals(model, header[AT.actuator_forcerange], 2 * nu)
    now = reals(data, header[AT.actuator_force], nu)
    nonzero = ints(data, header[AT.moment_rownnz], nu)
    start = ints(data, header[AT.moment_rowadr], nu)
    count = 0
    for k in range(nu):
        own = -biases[k * BIASES + 1]
        if own <= 0 or now[k] <= bounds[2 * k] or now[k] >= bounds[2 * k + 1]:
            continue
        end = start[k] + nonzero[k]
        columns = ints(data, header[AT.moment_colind], end)
        _spread(reals(data, header[AT.actuator_moment], end), columns, start[k], pulls[count])
        stiffness[count] = own
        count += 1
    return count


@jit
def _find_rubbing(chain, friction, arms):
    """Friction and lever arms of tendons that rub; their number."""
    model, data, header, tendons = chain.model, chain.data, chain.header, chain.header[NTENDON]
    losses = reals(model, header[AT.tendon_frictionloss], tendons)
    nonzero = ints(model, header[AT.ten_J_rownnz], tendons)
    start = ints(model, header[AT.ten_J_rowadr], tendons)
    count = 0
    for k in range(tendons):
        if losses[k] <= 0:
            continue
        end = start[k] + nonzero[k]
        columns = ints(model, header[AT.ten_J_colind], end)
        _spread(reals(data, header[AT.ten_J], end), columns, start[k], arms[count])
        friction[count] = losses[k]
        count += 1
    return count


@jit
def _spread(values, columns, start, row):
    """Elements of a sparse row, from `start` on, as a row (nv,)."""
    row[:] = 0.0
    for at in range(start, values.size):
        row[columns[at]] = values[at]
