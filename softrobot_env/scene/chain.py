"""The backbone: rigid links between elastic joints, with the beam's mass and stiffness.

Each station of the hinge rule gets one joint, which represents a share of the beam:

* planar: a hinge;
* spatial: a universal joint, two hinges in one body;
* spatial with torsion: a ball joint where bending and torsion are equally stiff (Poisson ratio 0)
  and no springs couple the pieces, else three hinges in one body.

MuJoCo's spring of a ball joint acts along the rotation vector, with one stiffness: bending is the
same in all directions. Hinges need the springs of `scene.springs` for that. A linear tendon channel
sums up hinge angles, which a ball joint has none of: a robot with channels gets hinges. So
does one that is not alike in all directions; its hinges' axes are turned to the directions of the
principal stiffnesses.

A universal joint also twists, by half the product of its angles, to the side that the order of its
hinges tells. The order goes hinge, side, side, hinge and so on: the twists of two neighbours
cancel, and the small sideways turn that is left of one pair cancels that of the next.

A head is a body of its own, fixed to the last link, and carries the tip site at its output point;
discs are bodies fixed to theirs. The chain of a robot with a base stands on a body that does not
move. A hinge has the stiffness of the part of the beam that it stands for, a link the mass of its
own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Protocol

import mujoco
import numpy as np
from mujoco import MjModel, MjsBody, MjsJoint, MjSpec, MjsTendon, mjMINVAL, mjtJoint
from numpy import ndarray

from softrobot_env.robots import Head, RobotParams
from softrobot_env.robots.sections import Backbone

from .quadrature import HingeLayout

#: Prefix of the hinges' names -> axis. A positive angle of a "hinge" bends +z towards +x, one of
#: a "side" bends +z towards +y, and a "twist" turns about +z.
HINGE_AXES = {"hinge": (0.0, 1.0, 0.0), "side": (-1.0, 0.0, 0.0), "twist": (0.0, 0.0, 1.0)}

#: Prefix of ball joints' names.
BALL = "ball"

TIP_SITE = "tip"
HEAD_BODY = "head"
BASE_BODY = "base"

#: MuJoCo's friction is a soft constraint: with its default impedance a tendon or joint creeps while
#: it should stick.
_FRICTION_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
_FRICTION_REFERENCE = (0.004, 1.0)  # time constant [s], damping ratio [1]

#: Between the name of one of several robots and the names of its parts.
SEPARATOR = "/"


@dataclass(frozen=True)
class Chain:
    """Bodies of the chain, to hang other parts on.

    Attributes:
        spec: The model under construction.
        layout: Where the hinges stand.
        length: [m] of the robot.
        bodies: World body, or that of the base, then one body per station.
        kinds: What the joint of a station is made of: `BALL`, or keys of `HINGE_AXES`.
        azimuth: [rad] by which the hinges' axes are turned about +z.
    """

    spec: MjSpec
    layout: HingeLayout
    length: float
    bodies: tuple[MjsBody, ...]
    kinds: tuple[str, ...] = ("hinge",)
    azimuth: float = 0.0

    def locate(self, station: float) -> tuple[MjsBody, float]:
        """Body that carries arc length `station` [m], and the height [m] above its origin.

        A station on a hinge belongs to the link above it.

        Raises:
            ValueError: The station is not on the robot.
        """
        if not 0 <= station <= self.length * (1 + 1e-12):
            raise ValueError(f"station must lie in [0, {self.length}] m, got {station}")
        index = int(np.searchsorted(self.layout.stations, station, side="right"))
        origin = self.layout.stations[index - 1] if index else 0.0
        return self.bodies[index], station - origin


def is_swapped(index: int) -> bool:
    """Whether a station has its hinges the other way round: each second one of neighbours has."""
    return index % 4 in (1, 2)


def order_of(kinds: tuple[str, ...], index: int) -> tuple[str, ...]:
    """What a station's joint is made of, from the base outwards; see the module."""
    swapped = ("side", "hinge", *kinds[2:])
    return swapped if len(kinds) > 1 and is_swapped(index) else kinds


def joint_kinds(
    robot: RobotParams, bending: str, torsion: bool, coupled: bool = False
) -> tuple[str, ...]:
    """What the joint of a station is made of, see the module: `BALL`, or keys of `HINGE_AXES`.

    Args:
        robot: The robot.
        bending: "planar" or "spatial".
        torsion: Whether a spatial chain twists.
        coupled: Whether springs couple its pieces, which takes hinges.

    Raises:
        ValueError: A planar chain of a robot that bends out of its plane by itself.
    """
    if bending == "planar":
        if robot.anisotropy or robot.precurvature[1]:
            raise ValueError(
                f"robot {robot.name!r} has anisotropy or precurvature towards y: it needs "
                "bending='spatial'"
            )
        return ("hinge",)
    if not torsion:
        return ("hinge", "side")
    isotropic = robot.is_symmetric and not any(x.poisson_ratio for x in robot.backbone.sections)
    channels = any(not tendon.guides for tendon in robot.tendons)
    return (BALL,) if isotropic and not channels and not coupled else ("hinge", "side", "twist")


def seen_from_hinges(vector: tuple[float, float], azimuth: float) -> tuple[float, float]:
    """(x, y) in the directions of hinges whose axes are turned by `azimuth` [rad]."""
    (x, y), c, s = vector, cos(azimuth), sin(azimuth)
    return x * c + y * s, y * c - x * s


def joint_angles(model: MjModel, qpos: ndarray) -> ndarray:
    """Angles of a chain's joints in postures (..., nq).

    Returns:
        (..., stations, k) [rad]: beta (towards +x), gamma (towards +y) and torsion, as many as the
        chain has. Of a ball joint they are the components of its rotation vector, of hinges their
        angles; divided by a station's weight they are the curvatures. Hinges that bend to two
        sides at once also twist, by half the product of their angles, and the torsion of three
        hinges undoes that.
    """
    joints = _joints(model)
    if BALL in joints:
        quaternions = qpos[..., joints[BALL][:, None] + np.arange(4)]
        turns = np.empty((*quaternions.shape[:-1], 3))
        for place in np.ndindex(turns.shape[:-1]):
            mujoco.mju_quat2Vel(turns[place], quaternions[place], 1.0)
        return turns[..., [1, 0, 2]] * [1, -1, 1]
    angles = np.stack([qpos[..., addresses] for addresses in joints.values()], axis=-1)
    return angles @ _turn(model, len(joints)).T


def posture(model: MjModel, angles: ndarray) -> ndarray:
    """The posture (nq,) with `angles` (stations, k) [rad]: inverse of `joint_angles`."""
    joints, qpos = _joints(model), model.qpos0.copy()
    if BALL in joints:
        turns = angles[:, [1, 0, 2]] * [-1, 1, 1]
        velocity = np.zeros(model.nv)
        velocity.reshape(-1, 3)[:] = turns
        mujoco.mj_integratePos(model, qpos, velocity, 1.0)
    else:
        turned = angles @ _turn(model, angles.shape[1])
        for column, addresses in zip(turned.T, joints.values(), strict=True):
            qpos[addresses] = column
    return qpos


class Built(Protocol):
    """A compiled chain: a `Scene`, or what has these of it."""

    model: MjModel
    layout: HingeLayout


def posture_like(chain: Built, other: Built, qpos: ndarray) -> ndarray:
    """The posture (nq,) of a chain that bends and twists as another one of the robot at `qpos`."""
    angles = joint_angles(other.model, qpos)
    turned = np.append(np.zeros((1, angles.shape[1])), np.cumsum(angles, axis=0), axis=0)
    own, parts = (np.append(0.0, np.cumsum(x.layout.weights)) for x in (chain, other))
    columns = [np.interp(own, parts, column) for column in turned.T]
    return posture(chain.model, np.diff(np.stack(columns, axis=1), axis=0))


def mean_curvature(model: MjModel, layout: HingeLayout, pieces: int) -> ndarray:
    """Matrix (n, nv) [1/m] from the hinge angles of a chain to mean curvatures of pieces.

    Each of them is made of equally many of the chain's own. Rows are the pieces of a planar chain;
    of a spatial one beta (towards +x) and gamma (towards +y), and torsion where it twists, piece by
    piece. The mean of a piece is the angle of its hinges over its length.

    Raises:
        ValueError: The chain has ball joints, or its own pieces do not divide these.
    """
    joints = _joints(model)
    if "hinge" not in joints or layout.pieces % pieces:
        raise ValueError(
            f"need a chain of hinges, and a multiple of {pieces} pieces, got joints "
            f"{', '.join(joints)} and {layout.pieces} pieces"
        )
    kinds = list(joints)
    turn, together = _turn(model, len(kinds)), layout.pieces // pieces
    sizes = np.diff(layout.edges[::together])
    matrix = np.zeros((pieces, len(kinds), model.nv))
    for station, piece in enumerate(layout.piece // together):
        for column, kind in enumerate(kinds):
            matrix[piece, :, joints[kind][station]] = turn[:, column] / sizes[piece]
    return matrix.reshape(-1, model.nv)


def station_strain(model: MjModel, layout: HingeLayout, qpos: ndarray) -> ndarray:
    """Beta, gamma and torsion (n, stations, 3) [1/m] of the parts that stations stand for.

    Args:
        model: Of the chain.
        layout: Where its stations are; the parts lie one behind the other, as long as its weights.
        qpos: (n, nq) postures.
    """
    strain, angles = np.zeros((len(qpos), len(layout.weights), 3)), joint_angles(model, qpos)
    strain[..., : angles.shape[-1]] = angles
    return strain / layout.weights[:, None]


def _turn(model: MjModel, size: int) -> ndarray:
    """(size, size) from angles about a chain's own hinge axes to beta, gamma (and torsion)."""
    matrix = np.eye(size)
    if size > 1:
        sine, cosine = -model.joint("hinge0").axis[0], model.joint("hinge0").axis[1]
        matrix[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return matrix


def _joints(model: MjModel) -> dict[str, ndarray]:
    """Addresses (stations,) in `qpos` of the joints by kind, in the order of the kinds."""
    addresses = {model.joint(i).name: model.jnt_qposadr[i] for i in range(model.njnt)}
    kinds = [kind for kind in (*HINGE_AXES, BALL) if f"{kind}0" in addresses]
    free = np.count_nonzero(model.jnt_type == mjtJoint.mjJNT_FREE)  # objects
    stations = range((len(addresses) - free) // len(kinds))
    return {kind: np.array([addresses[f"{kind}{i}"] for i in stations]) for kind in kinds}


def add_chain(
    spec: MjSpec, robot: RobotParams, layout: HingeLayout, kinds: tuple[str, ...] = ("hinge",)
) -> Chain:
    """Add the links, their joints made of `kinds`, the head and the tip site to an empty spec."""
    azimuth = robot.stiff_azimuth if robot.anisotropy else 0.0
    bodies = [_add_base(spec, robot)]
    stations = np.concatenate(([0.0], layout.stations, [robot.length]))
    joints, inertias = _joint_stiffness(robot, layout, kinds), _inertias(robot, stations[1:])
    sections = robot.backbone.sections
    holding = [sections[i].bending_friction for i in robot.backbone.index(layout.stations)]
    for index, weight in enumerate(layout.weights):
        origin = stations[index + 1] - stations[index]
        body = bodies[-1].add_body(name=f"link{index}", pos=[0, 0, origin])
        _set_link_inertia(body, robot, stations[index + 2] - stations[index + 1], inertias[index])
        for kind in order_of(kinds, index):
            joint = _add_joint(body, f"{kind}{index}", kind, robot, weight, azimuth)
            joint.stiffness[0] = stiffness = joints[kind][index]
            joint.damping[0] = joints["damping_time"][index] * stiffness
            if holding[index] and kind != "twist":
                rub(joint, holding[index])
        bodies.append(body)
    chain = Chain(spec, layout, robot.length, tuple(bodies), kinds, azimuth)
    _add_tip(chain, robot.head)
    for index, disc in enumerate(robot.discs):  # after all links, whose numbers they must not shift
        link, height = chain.locate(disc.station)
        body = link.add_body(name=f"disc{index}", pos=[0, 0, height])
        set_inertia(body, disc.mass, 0, disc.inertia)
    return chain


def rub(part: MjsJoint | MjsTendon, friction: float) -> None:
    """Dry friction [N or N m] of a tendon or joint.

    That of a tendon acts whatever the tension, on slack ones too, which it can push;
    `tangent.RubbingForces` tells where that is not so.
    """
    part.frictionloss = friction
    part.solimp_friction, part.solref_friction = _FRICTION_IMPEDANCE, _FRICTION_REFERENCE


def _add_base(spec: MjSpec, robot: RobotParams) -> MjsBody:
    """The body on which the chain stands."""
    if robot.base is None:
        return spec.worldbody
    body = spec.worldbody.add_body(name=BASE_BODY, pos=robot.base.position)
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, robot.base.axes.ravel())
    body.quat = turn
    return body


def station_stiffness(backbone: Backbone, layout: HingeLayout) -> tuple[ndarray, ndarray]:
    """EI and GJ (stations,) [N m2] of uniform parts of beam that yield as those of stations."""
    bending, torsion = backbone.bending(layout.stations), backbone.torsion(layout.stations)
    tapers = backbone.tapers(layout.stations)
    if not tapers.any():
        return bending, torsion
    parts = np.append(0.0, np.cumsum(layout.weights))
    whole = np.where(tapers, backbone.in_series(backbone.bending, parts), bending)
    return whole, torsion * (whole / bending)


def _joint_stiffness(
    robot: RobotParams, layout: HingeLayout, kinds: tuple[str, ...]
) -> dict[str, list[float]]:
    """Stiffness of the stations' joints [N m] by kind, and their damping time [s]."""
    backbone, half = robot.backbone, robot.anisotropy / 2
    bending, torsion = station_stiffness(backbone, layout)
    towards = bending * (1 + half) / layout.weights
    found = {"hinge": towards, BALL: towards, "side": bending * (1 - half) / layout.weights}
    if "twist" in kinds:
        found["twist"] = torsion / layout.weights
    found["damping_time"] = backbone.damping_time(layout.stations)
    return {name: values.tolist() for name, values in found.items()}


def _add_tip(chain: Chain, head: Head | None) -> None:
    """The tip site at the end of the chain, or at the output point of the head on it."""
    body, height = chain.locate(chain.length)
    if head is not None:
        body = body.add_body(name=HEAD_BODY, pos=[0, 0, height])
        set_inertia(body, head.mass, head.centre, head.inertia)
        height = head.output
    body.add_site(name=TIP_SITE, pos=[0, 0, height], size=[1e-3, 0, 0])


def _inertias(robot: RobotParams, edges: ndarray) -> ndarray:
    """Of links between edges (links, 4): mass, height of its centre, and lateral and axial inertia.

    The latter two are about the centre of mass.
    """
    backbone = robot.backbone

    def densities(s: ndarray) -> ndarray:
        height = s - edges[np.searchsorted(edges[1:-1], s)]
        mass = backbone.mass(s)
        return np.stack([mass, mass * height, mass * height**2, backbone.rotary(s)])

    mass, first, second, rotary = backbone.integrals(densities, edges)
    centre = first / mass
    return np.column_stack([mass, centre, second - first * centre + rotary, 2 * rotary])


def set_inertia(body: MjsBody, mass: float, centre: float, inertia: Sequence[float]) -> None:
    """Mass [kg], height [m] of its centre above the body, and inertia (3,) [kg m2] about that."""
    # Not given, MuJoCo would take the body's own place once more for the centre.
    body.mass, body.ipos, body.inertia = mass, [0, 0, centre], inertia
    body.explicitinertial = True


def _set_link_inertia(body: MjsBody, robot: RobotParams, length: float, inertia: ndarray) -> None:
    """Mass and inertia of a part of `length` [m] of the backbone, a row of `_inertias`.

    Raises:
        ValueError: They are smaller than what MuJoCo takes.
    """
    mass, centre, lateral, axial = inertia.tolist()
    set_inertia(body, mass, centre, [lateral, lateral, axial])
    least = min(mass, lateral, axial)
    if least < mjMINVAL:
        raise ValueError(
            f"robot {robot.name!r}: a link of {length:.3g} m has a mass of {mass:.3g} kg and "
            f"inertias down to {min(lateral, axial):.3g} kg m2, MuJoCo takes {mjMINVAL:g} "
            "or more: take fewer pieces, a denser or thicker robot, or a beam model"
        )


def _add_joint(
    body: MjsBody, name: str, kind: str, robot: RobotParams, weight: float, azimuth: float
) -> MjsJoint:
    """Joint of `weight` [m] of beam, its axis turned by azimuth."""
    if kind == BALL:
        return body.add_joint(name=name, type=mjtJoint.mjJNT_BALL)
    x, y, z = HINGE_AXES[kind]
    if azimuth:  # else rounding would bring -0.0 into the exported scenes
        x, y = x * cos(azimuth) - y * sin(azimuth), x * sin(azimuth) + y * cos(azimuth)
    joint = body.add_joint(name=name, type=mjtJoint.mjJNT_HINGE, axis=(x, y, z))
    along, across = seen_from_hinges(robot.precurvature, azimuth)
    joint.springref = weight * {"hinge": along, "side": across, "twist": 0.0}[kind]
    return joint


def backbone_lengths(model: MjModel) -> ndarray:
    """Length (nv,) [m] of the link that the last DOF of each body moves; the others have none."""
    lengths = np.zeros(model.nv)
    for site in map(model.site, range(model.nsite)):
        if site.name.rpartition(SEPARATOR)[2] != TIP_SITE:
            continue
        beyond, body = float(np.linalg.norm(site.pos)), int(site.bodyid[0])
        while body:
            if model.body_dofnum[body]:
                lengths[model.body_dofadr[body] + model.body_dofnum[body] - 1] = beyond
                beyond = 0.0
            beyond += float(np.linalg.norm(model.body_pos[body]))
            body = int(model.body_parentid[body])
    return lengths
