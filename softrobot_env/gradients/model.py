"""A chain as the derivatives see it: what is joined to what, and the numbers that may vary.

The numbers are smooth functions of a robot's, so that their derivatives by it can be taken by
differences of scenes. Inertias are about the origins of the bodies, along their axes.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import MjModel, mjtJoint, mjtTrn, mjtWrap
from numpy import ndarray

from softrobot_env.scene import build
from softrobot_env.scene.assembly import AssembledScene
from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.integration import layout
from softrobot_env.scene.integration.articulated import runs
from softrobot_env.scene.integration.zones import Zones
from softrobot_env.scene.tendons import is_ideal

#: Columns of `Values.joint`: rest [rad], stiffness [N m] and its higher powers, damping, armature.
REST, STIFF, SQUARE, CUBE, DAMP, ARMATURE = range(6)
#: Columns of `Values.tendon`: as of joints, with the dry friction [N] in place of the armature.
FRICTION = ARMATURE
#: Columns of `Values.drive`: force by control, constant, by length; least and largest force.
GAIN, CONSTANT, BY_LENGTH, LEAST, MOST = range(5)


#: MuJoCo's integrators whose steps `stepping` derives.
STEPPED = ("implicitfast", "Euler")

#: Of a force or control without a limit.
_HUGE = 1e30


class Plan(NamedTuple):
    """What is joined to what.

    Attributes:
        parents, first, count: (nbody,), of a body its parent, first DOF and number of DOFs.
        run: (nbody,), see `articulated.runs`.
        massive, turned: (nbody,), whether it has a mass, and whether it is turned in its parent.
        axis: (nv, 3), of the hinges in their bodies.
        on: (sites,), bodies of the sites; the tip is the last of them.
        begin: (ntendon + 1,), where the parts of tendons begin.
        parts: (parts, 2), a DOF and -1 of lengths along joints; two sites of straight spans.
        tendon: (nu,), which one a drive pulls; -1 less the site of a load.
        gear: (nu,), of drives, and whether a load follows its body (1).
        loads: (nu, 6), force and moment of a load.
        control: (2, nu), smallest and largest.
        wound, rubs: Drives of lengths, and tendons with friction of whatever tension.
        zones: (zones, 3), where friction grows with the tension, see `scene.integration.capstan`:
            a drive, the first part of its tendon that lies beyond, and whether the feed line rubs.
        bends: (bends, 4), where tendons turn on their way to the zones: a tendon, a body with its
            station in `Values.rough`, or the part after a guide with -1, and a zone.
        shares: (bends, 2), of a bend in that zone and in the next.
    """

    parents: ndarray
    first: ndarray
    count: ndarray
    run: ndarray
    massive: ndarray
    turned: ndarray
    axis: ndarray
    on: ndarray
    begin: ndarray
    parts: ndarray
    tendon: ndarray
    gear: ndarray
    loads: ndarray
    control: ndarray
    wound: ndarray
    rubs: ndarray
    zones: ndarray
    bends: ndarray
    shares: ndarray


class Values(NamedTuple):
    """Numbers of a chain, or derivatives by them.

    Attributes:
        place: (nbody, 3) [m], of bodies in their parents.
        turn: (nbody, 4), their quaternions.
        inertia: (nbody, 10): xx, yy, zz, xy, xz, yz [kg m2], mass times centre [kg m], mass [kg].
        joint: (nv, 6), see `REST` and after.
        tendon: (ntendon, 6), likewise.
        arm: (parts,) [m], of tendons along joints.
        site: (sites, 3) [m], in their bodies.
        drive: (nu, 5), see `GAIN` and after.
        rough: (ntendon, n), rows of `tendon_user`, see `scene.integration.layout`.
        gravity: (1, 3) [m/s2].
    """

    place: ndarray
    turn: ndarray
    inertia: ndarray
    joint: ndarray
    tendon: ndarray
    arm: ndarray
    site: ndarray
    drive: ndarray
    rough: ndarray
    gravity: ndarray


def refusals(scene: "build.Scene | AssembledScene") -> Iterator[str]:
    """What a scene has that no derivative is known of."""
    model = scene.model
    kind, (_, frame) = model.actuator_trntype, model.actuator_trnid.T
    frame = frame[(kind == mjtTrn.mjTRN_SITE) & (frame >= 0)]
    elastic = np.hstack([model.tendon_stiffness[:, None], model.tendon_stiffnesspoly]).any(axis=1)
    low, high = model.tendon_lengthspring.T
    has = {
        "several robots": not isinstance(scene, build.Scene),
        f"the integrator {scene.timestep.integrator}": (
            scene.timestep.accuracy is None and scene.timestep.integrator not in STEPPED
        ),
        "joints with limits": model.jnt_limited.any(),
        "ball joints and bodies that move freely": (model.jnt_type != mjtJoint.mjJNT_HINGE).any(),
        "servos with a gain, spools that wind layers and wires that seat": not is_ideal(model),
        "tendons around surfaces": (model.wrap_type > int(mjtWrap.mjWRAP_SITE)).any(),
        "elastic tendons that go slack": (elastic & (low != high)).any(),
        "dampers that are not linear": model.dof_dampingpoly.any()
        or model.tendon_dampingpoly.any(),
        "tendons with damping in steps of MuJoCo's integrators": (
            scene.timestep.accuracy is None and model.tendon_damping.any()
        ),
        "loads in moving frames": model.site_bodyid[frame].any(),
        "joints off their bodies' origins": model.jnt_pos.any(),
    }
    return (what for what, there in has.items() if there)


def plan_of(model: MjModel) -> Plan:
    """What is joined to what in a model that is not refused."""
    _, sites, parts, begin = _parts(model)
    loads = model.actuator_trntype == mjtTrn.mjTRN_SITE
    at, frame = model.actuator_trnid.T
    where = {site: k for k, site in enumerate(sites)}
    places = np.array([-1 - where[s] if load else s for s, load in zip(at, loads, strict=True)])
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited, model.actuator_ctrlrange.T, [[-_HUGE], [_HUGE]])
    return Plan(
        model.body_parentid.copy(),
        model.body_dofadr.copy(),
        model.body_dofnum.copy(),
        runs(model.body_parentid),
        (model.body_mass > 0).astype(np.int8),
        (model.body_quat[:, 0] != 1).astype(np.int8),
        model.jnt_axis.copy(),
        model.site_bodyid[sites],
        begin,
        parts,
        places.astype(np.int32),
        np.where(loads, frame < 0, model.actuator_gear[:, 0]),
        model.actuator_gear.copy(),
        np.stack([low, high]),
        np.flatnonzero(model.actuator_biasprm[:, 1] < 0).astype(np.int32),
        np.flatnonzero(model.tendon_frictionloss > 0).astype(np.int32),
        *_zones(model, begin, model.site_bodyid[sites], parts),
    )


def _parts(model: MjModel) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Which parts are spans, the sites they run through, and the parts of `Plan`."""
    loads = model.actuator_trntype == mjtTrn.mjTRN_SITE
    through = model.wrap_objid[model.wrap_type == mjtWrap.mjWRAP_SITE]
    others = np.append(through, model.actuator_trnid[loads, 0])
    tip = model.site(TIP_SITE).id
    sites = np.append(np.setdiff1d(others, tip), tip)
    begin, parts = [0], []
    for t in range(model.ntendon):
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        for k in wraps:
            if model.wrap_type[k] == mjtWrap.mjWRAP_JOINT:
                parts.append((model.jnt_dofadr[model.wrap_objid[k]], -1))
            elif (
                k + 1 in wraps
                and model.wrap_type[[k, k + 1]].tolist() == [int(mjtWrap.mjWRAP_SITE)] * 2
            ):
                parts.append(tuple(np.searchsorted(sites[:-1], model.wrap_objid[[k, k + 1]])))
        begin.append(len(parts))
    table = np.array(parts, np.int32).reshape(-1, 2)
    return table[:, 1] >= 0, sites, table, np.array(begin, np.int32)


def _zones(
    model: MjModel, begin: ndarray, on: ndarray, parts: ndarray
) -> tuple[ndarray, ndarray, ndarray]:
    """`Plan.zones`, `bends` and `shares`."""
    found, zones, bends, shares = Zones(model), [], [], []
    moved = np.where(parts[:, 1] < 0, parts[:, 0], (_beyond(model) - 1)[on[parts[:, 1]]])
    for drive, count in layout.zones(model):
        tendon, first = model.actuator_trnid[drive, 0], len(zones)
        own = range(begin[tendon], begin[tendon + 1])
        for number, dof in enumerate(found.first[first : first + count].tolist()):
            part = next((k for k in own if moved[k] >= dof), own.start)
            zones.append((drive, part, number == 0))
        for where, zone, later in _bends(model, tendon, count - 1, own.start):
            bends.append((tendon, *where, first + 1 + zone))
            shares.append((1 - later, later if zone + 2 < count else 0.0))
    tables = (zones, 3), (bends, 4)
    return (
        *(np.array(x, np.int32).reshape(-1, columns) for x, columns in tables),
        np.array(shares).reshape(-1, 2),
    )


def _beyond(model: MjModel) -> ndarray:
    """(nbody,), the DOF after the last that moves a body."""
    out = np.zeros(model.nbody, int)
    for b in range(1, model.nbody):
        own = model.body_dofadr[b] + model.body_dofnum[b]
        out[b] = own if model.body_dofnum[b] else out[model.body_parentid[b]]
    return out


def _bends(
    model: MjModel, tendon: int, zones: int, first: int
) -> Iterator[tuple[tuple[int, int], int, float]]:
    """Where a tendon turns, a body and its station or a part and -1; its zone, and how late in it.

    A channel's stations are shared by half, a tendon's guides by how far they are from the next.
    """
    stations = int(model.tendon_user[tendon, layout.STATIONS])
    if stations:
        start, size = model.ten_J_rowadr[tendon], model.ten_J_rownnz[tendon]
        columns = model.ten_J_colind[start : start + size]
        bodies = np.unique(model.dof_bodyid[columns])[-stations:]
        for k, body in enumerate(bodies.tolist()):
            place = layout.COURSE + layout.STATION * k
            yield (body, place), k * zones // stations, 0.5
        return
    guides = model.tendon_num[tendon] - 1
    for k in range(guides):
        zone = k * zones // guides
        start, end = -(-zone * guides // zones), -(-(zone + 1) * guides // zones)
        yield (first + k, -1), zone, (k - start) / (end - start)


def values_of(model: MjModel) -> Values:
    """The numbers of a model."""
    spatial, sites, parts, _ = _parts(model)
    arm = np.zeros(len(parts))
    arm[~spatial] = model.wrap_prm[model.wrap_type == mjtWrap.mjWRAP_JOINT]
    limited = model.actuator_forcelimited.astype(bool)
    force = np.where(limited, model.actuator_forcerange.T, [[-_HUGE], [_HUGE]])
    joints, slack = (model.dof_damping, model.dof_armature), model.tendon_lengthspring[:, 0]
    tendons = model.tendon_damping, model.tendon_frictionloss
    return Values(
        model.body_pos.copy(),
        model.body_quat.copy(),
        _inertias(model),
        np.column_stack([model.qpos_spring, model.jnt_stiffness, model.jnt_stiffnesspoly, *joints]),
        np.column_stack([slack, model.tendon_stiffness, model.tendon_stiffnesspoly, *tendons]),
        arm,
        model.site_pos[sites],
        np.column_stack([model.actuator_gainprm[:, 0], model.actuator_biasprm[:, :2], *force]),
        model.tendon_user.copy(),
        model.opt.gravity[None].copy(),
    )


def _inertias(model: MjModel) -> ndarray:
    """(nbody, 10), see `Values`."""
    out = np.zeros((model.nbody, 10))
    for b in range(model.nbody):
        turn, mass, centre = np.empty(9), model.body_mass[b], model.body_ipos[b]
        mujoco.mju_quat2Mat(turn, model.body_iquat[b])
        turn = turn.reshape(3, 3)
        full = (turn * model.body_inertia[b]) @ turn.T
        full += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        out[b, :6] = full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        out[b, 6:9], out[b, 9] = mass * centre, mass
    return out


def columns_of(plan: Plan) -> int:
    """Number of columns of impulses, see `holding`."""
    return len(plan.wound) + len(plan.rubs) + len(plan.zones)


def flat(values: Values) -> ndarray:
    """All numbers in one row."""
    return np.concatenate([part.ravel() for part in values])


def shaped(row: ndarray, like: Values) -> Values:
    """Views of a row as `flat` makes it."""
    ends = np.cumsum([part.size for part in like])[:-1]
    return Values(*(x.reshape(y.shape) for x, y in zip(np.split(row, ends), like, strict=True)))
