"""Contacts as parts of a scene: a skin of the robot, things that stand or lie about, and forces.

The skin is one capsule a link with the radius at its middle; discs and head have shapes of their
own. Which shapes may touch is said by a list of pairs: nothing else in the scene collides.

A contact is a spring and a damper. Its force at depth r is K r + B v, and its friction follows
Coulomb's law. MuJoCo has accelerations in the place of forces: a row of impedance d with the mean
inverse mass A of the two bodies acts as a spring, a damper, and a mass d / ((1 - d) A) between
them. With solref = (-w^2, -2 zeta w), w^2 = K A (1 - d), its stiffness is K and its damping ratio
zeta, whatever d is. So d is free: `LEAST_IMPEDANCE` where the timestep h resolves the spring, and
where w h would pass `RESOLVED`, or lighter bodies would chatter (`_DAMPED`), as large as slows it
down to that. This mass is an error that shrinks with h; forces at rest have none of it. MuJoCo's
`discrete` has another A, which depends on the timestep, and so another stiffness: it is not taken
for contacts.

Surfaces are known by the names of their geoms, so that chains which were put into one spec with a
prefix can be paired as well as one alone: `add_skin`, then `connect`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import hypot, inf, pi, sqrt
from warnings import warn

import mujoco
import numpy as np
from mujoco import (
    MjData,
    MjModel,
    MjOption,
    MjsBody,
    MjSpec,
    mjtCone,
    mjtDisableBit,
    mjtGeom,
    mjtJacobian,
    mjtSolver,
)
from numpy import ndarray

from softrobot_env.robots import RobotParams
from softrobot_env.robots.sections import Section

from .chain import HEAD_BODY, Chain
from .objects import Contacts, G, Object

#: First MuJoCo whose Newton solver factorises sparse matrices right, and from how many DOFs on it
#: takes them by itself.
_MENDED, _SPARSE = 4_000_001, 60

#: Name of the backbone among those that touch.
BACKBONE = "backbone"

#: Impedance d of a contact that the timestep resolves, and the largest that is taken.
LEAST_IMPEDANCE, MOST_IMPEDANCE = 0.1, 0.999

#: Largest d that the rule's timestep leaves to contacts whose stiffness was asked for, and largest
#: d to which those of the robot's material are softened.
ACCURATE_IMPEDANCE, DEFAULT_IMPEDANCE = 0.7, 0.9

#: Largest w h [1] of a contact's spring. From 0.8 on a critically damped one is unstable, and A,
#: which is a mean over directions, may be a third of what counts.
RESOLVED = 0.35

#: Largest product of timestep and rate 2 zeta w / d at which a contact of bodies that are far
#: lighter than A says takes speed: from 2 on they chatter.
_DAMPED = 1.2

#: Largest product of timestep and the rate at which friction stops a motion: beyond, it would
#: reverse it, and from 2 on it chatters.
_STOPPED = 1.0

#: How much shorter the timestep is for each unit of friction [1]. A rough thing that is pushed from
#: behind is pressed on harder by its own friction, and touches that are barely resolved set it
#: rattling: 100 times the material's stiffness with friction 1 was 17 % of the length off without
#: this (`softrobot benchmark contacts`, an arm that pushes a ball).
_ROUGH = 4.0

#: Depth of a free object under its own weight, where nothing else gives, over its size [1].
_OBJECT_DEPTH = 5e-3

#: What the first of a geom's user numbers says it is.
_LINK, _PART = 1, 2

#: Of a capsule, over its radius: shorter ones are left to their neighbours.
_SHORTEST = 1e-6

_SKIN = "skin{}"
_OBJECT_GEOM = "{}_shape"


@dataclass(frozen=True)
class Surface:
    """A shape that can touch others.

    Attributes:
        geom: Its name in the spec.
        owner: What it belongs to, for people: a part of a robot, or an object.
        friction: Coefficient [1]; None leaves it to the other one.
        stiffness: [N/m] of its skin; infinite of objects.
        robot: Number of the robot it belongs to, 0 of one alone; None of objects.
        span: [m], arc lengths between which it lies on its robot.
        radius: [m] around the backbone.
        halves: Whether it meets others in two points at once, each of half the stiffness.
        weight: [N/m], what a free object weighs over the depth it sinks in by that.
        fixed: Whether it cannot move.
    """

    geom: str
    owner: str
    friction: float | None
    stiffness: float = inf
    robot: int | None = None
    span: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.0
    halves: bool = False
    weight: float = 0.0
    fixed: bool = False

    def within(self, prefix: str, robot: int) -> "Surface":
        """The same one after its spec was attached with a prefix, as robot of another number."""
        number = None if self.robot is None else robot
        return replace(self, geom=prefix + self.geom, owner=prefix + self.owner, robot=number)


@dataclass(frozen=True)
class Pair:
    """Two surfaces that can touch.

    Attributes:
        name: Of the pair in the spec.
        stiffness: [N/m].
        damping_ratio: [1].
        friction: Coefficient [1].
        asked: Whether the user gave the stiffness.
        stopping: See `Contacts`.
    """

    name: str
    stiffness: float
    damping_ratio: float
    friction: float
    asked: bool
    stopping: float = 1.0


@dataclass(frozen=True)
class Touch:
    """A point in which two surfaces press on each other.

    Attributes:
        first, second: What touches: "backbone", "head", "disc0", ... or an object's name. The
            first belongs to a robot unless two objects touch.
        stations: Arc lengths [m] on the robots' backbones; None of an object.
        point: (3,) [m] in the world.
        force: (3,) [N] on the first; the second feels the opposite.
        depth: [m], negative of a gap.
    """

    first: str
    second: str
    stations: tuple[float | None, float | None]
    point: ndarray
    force: ndarray
    depth: float


# ---------------------------------------------------------------- shapes


def add_skin(chain: Chain, robot: RobotParams, contacts: Contacts) -> list[Surface]:
    """Add the shapes of a robot to its chain.

    The tip is round: its last capsule ends where the backbone does. Discs and head are covered with
    the robot's skin.

    Raises:
        ValueError: The robot is shorter than its radius at the tip.
    """
    tip_radius, out = robot.backbone.outer_radius(robot.length), []
    if robot.length <= tip_radius:
        raise ValueError(
            f"robot {robot.name!r}: contacts need a robot longer than its radius of {tip_radius} m"
        )

    def part(name: str, kind: str, size: Sequence[float], station: float, height: float) -> None:
        radius, half = size[0] if kind == "CYLINDER" else hypot(*size[:2]), size[-1]
        span = station - half, station + half
        stiffness = 2 * radius * _skin_stiffness(robot, station, contacts)
        out.append(Surface(f"{name}_skin", name, None, stiffness, 0, span, radius))
        user = [_PART, sum(span) / 2, 0, 0]
        _add_shape(chain.spec.body(name), out[-1].geom, kind, size, height, user)

    bounds = pairwise([0.0, *chain.layout.stations, robot.length])
    for index, (body, (start, end)) in enumerate(zip(chain.bodies, bounds, strict=True)):
        end = min(end, robot.length - tip_radius)
        if end - start > _SHORTEST * tip_radius:
            middle, half = (start + end) / 2, (end - start) / 2
            radius, name = robot.backbone.outer_radius(middle), _SKIN.format(index)
            stiffness = _skin_stiffness(robot, middle, contacts) * (end - start)
            link = Surface(name, BACKBONE, None, stiffness, 0, (start, end), radius)
            out.append(replace(link, fixed=index == 0))
            _add_shape(body, name, "CAPSULE", [radius, half], half, [_LINK, start, start, end])
    for index, disc in enumerate(robot.discs):
        part(f"disc{index}", "CYLINDER", disc.cylinder, disc.station, 0)
    if robot.head is not None:
        part(HEAD_BODY, "BOX", robot.head.half_sizes, robot.length, robot.head.centre)
    return out


def _add_shape(
    body: MjsBody,
    name: str,
    kind: str,
    size: Sequence[float],
    height: float,
    stations: Sequence[float],
) -> None:
    """Geom that touches by pairs alone. Its user numbers tell the stations on it."""
    shape, place = getattr(mjtGeom, f"mjGEOM_{kind}"), [0, 0, height]
    size = [*size, 0][:3]
    geom = body.add_geom(name=name, type=shape, size=size, pos=place, userdata=stations)
    geom.mass, geom.contype, geom.conaffinity = 0, 0, 0
    geom.group = 3  # which viewers do not show


def _skin_stiffness(robot: RobotParams, station: float, contacts: Contacts) -> float:
    """[N/m2]"""
    if contacts.stiffness is not None:
        return contacts.stiffness
    return material_stiffness(robot.backbone.sections[robot.backbone.index(station)])


def material_stiffness(section: Section) -> float:
    """Stiffness [N/m2] of a cylinder of a section's material on a flat, see `Contacts`."""
    return pi / 4 * section.youngs_modulus / (1 - section.poisson_ratio**2)


def _add_object(spec: MjSpec, thing: Object) -> Surface:
    body = spec.worldbody.add_body(name=thing.name, pos=thing.position, quat=thing.quaternion)
    surface = Surface(
        _OBJECT_GEOM.format(thing.name),
        thing.name,
        thing.friction,
        halves=thing.has_faces,
        fixed=not thing.is_free,
    )
    kind, size = getattr(mjtGeom, thing.geom_type), thing.geom_size
    geom = body.add_geom(name=surface.geom, type=kind, size=size, rgba=thing.rgba)
    geom.contype = geom.conaffinity = 0
    if surface.fixed:
        return surface
    body.add_freejoint(name=f"{thing.name}_free")
    geom.mass = mass = thing.total_mass
    return replace(surface, weight=mass * G / (_OBJECT_DEPTH * thing.extent))


# ---------------------------------------------------------------- pairs


def connect(
    spec: MjSpec, surfaces: Sequence[Surface], objects: Iterable[Object], contacts: Contacts
) -> list[Pair]:
    """Add objects to a spec, after all chains, and let surfaces touch each other and them.

    Robots touch objects and other robots, and themselves if asked. Of one robot those are left out
    whose distance along the backbone is less than half a turn of the tightest bend, as nearer ones
    overlap in a straight robot, too.
    """
    _prepare(spec.option, contacts)
    quality = spec.visual.quality
    quality.numslices, quality.numstacks = max(quality.numslices, 28), max(quality.numstacks, 16)
    things = [_add_object(spec, thing) for thing in objects]  # the DOFs of free ones come last
    return [
        _add_pair(spec, one, other, contacts)
        for one, other in combinations([*surfaces, *things], 2)
        if _may_touch(one, other, contacts)
    ]


def _may_touch(one: Surface, other: Surface, contacts: Contacts) -> bool:
    if one.fixed and other.fixed:
        return False
    if one.robot is None or other.robot is None:
        return True
    if one.robot != other.robot:
        return contacts.between_robots
    gap = max(one.span[0], other.span[0]) - min(one.span[1], other.span[1])
    return contacts.self_contact and gap >= pi / 2 * (one.radius + other.radius)


def _add_pair(spec: MjSpec, one: Surface, other: Surface, contacts: Contacts) -> Pair:
    given = [x.friction for x in (one, other) if x.friction is not None]
    friction = max(given, default=contacts.friction)
    name = f"{one.geom}~{other.geom}"
    pair = spec.add_pair(name=name, geomname1=one.geom, geomname2=other.geom)
    pair.condim = 3 if friction > 0 else 1
    pair.friction = [max(friction, 1e-5), max(friction, 1e-5), 0.005, 1e-4, 1e-4]
    compliance = 1 / one.stiffness + 1 / other.stiffness
    stiffness = 1 / compliance if compliance else max(one.weight, other.weight)
    if one.halves or other.halves:
        stiffness /= 2
    asked = bool(compliance) and contacts.stiffness is not None
    return Pair(name, stiffness, contacts.damping_ratio, friction, asked, contacts.stopping)


def _prepare(option: MjOption, contacts: Contacts) -> None:
    """Settings of MuJoCo's solver for contacts."""
    option.disableflags = int(option.disableflags) & ~int(
        mjtDisableBit.mjDSBL_CONTACT | mjtDisableBit.mjDSBL_CONSTRAINT
    )
    option.solver = mjtSolver.mjSOL_NEWTON
    mended = mujoco.mj_version() >= _MENDED
    option.jacobian = mjtJacobian.mjJAC_AUTO if mended else mjtJacobian.mjJAC_DENSE
    option.cone = mjtCone.mjCONE_ELLIPTIC
    option.impratio = contacts.sideways
    option.tolerance = 1e-10


def warn_of_solver(model: MjModel) -> None:
    """Say that contacts are solved by dense matrices where sparse ones would be faster."""
    if model.opt.jacobian == mjtJacobian.mjJAC_DENSE and model.nv >= _SPARSE:
        warn(
            f"contacts are solved with dense matrices, as MuJoCo {mujoco.mj_versionString()} errs "
            "with sparse ones: `pip install --no-deps mujoco-core==4.0.1` mends it",
            stacklevel=3,
        )


def longest_step(model: MjModel, pairs: Sequence[Pair]) -> float:
    """Timestep [s] that resolves contacts whose stiffness was asked for; inf without any."""
    smooth = (
        RESOLVED / sqrt(_square(model, x) * (1 - ACCURATE_IMPEDANCE)) / (1 + _ROUGH * x.friction)
        for x in pairs
        if x.asked
    )
    return min(smooth, default=inf)


def tune(
    model: MjModel, pairs: Sequence[Pair], timestep: float, least: float = LEAST_IMPEDANCE
) -> float:
    """Give pairs their stiffness and damping at a timestep [s], as the module tells.

    Args:
        model: The compiled scene.
        pairs: Pairs that it has.
        timestep: [s].
        least: Least impedance [1].

    Returns:
        The smallest ratio of a pair's stiffness to what was to be had: the robot's material may
        be stiffer than the timestep can do. It is 1 if none is.

    Raises:
        ValueError: A stiffness that was asked for is more than the timestep can do.
    """
    softest, fastest = 1.0, (RESOLVED / timestep) ** 2
    for pair in pairs:
        square = _square(model, pair)
        most = fastest / (1 - (MOST_IMPEDANCE if pair.asked else DEFAULT_IMPEDANCE))
        if pair.asked and square > most:
            excess = square / most
            raise ValueError(
                f"contacts {pair.name!r} of {pair.stiffness:.3g} N/m are too stiff for a timestep "
                f"of {timestep:.3g} s: give Contacts(stiffness=...) {excess:.3g} times smaller, or "
                f"a timestep of {timestep / sqrt(excess):.2g} s"
            )
        softest = min(softest, most / square)
        square = min(square, most)
        x = 2 * pair.damping_ratio * timestep * sqrt(square) / _DAMPED
        steady = x * (sqrt(x**2 + 4) - x) / 2  # d = x sqrt(1 - d)
        impedance = max(least, steady, 1 - fastest / square)
        number, frequency = model.pair(pair.name).id, sqrt(square * (1 - impedance))
        model.pair_solref[number] = -(frequency**2), -2 * pair.damping_ratio * frequency
        model.pair_solimp[number] = impedance, impedance, 1e-3, 0.5, 2
        # Friction has no spring: the first of these has no effect.
        rate = min(pair.stopping * impedance * frequency, _STOPPED / timestep)
        model.pair_solreffriction[number] = -1.0, -rate
    return softest


def write(spec: MjSpec, model: MjModel, pairs: Sequence[Pair]) -> None:
    """Give the pairs of a spec what `tune` gave those of its model."""
    by_name = {pair.name: pair for pair in spec.pairs}
    for pair in pairs:
        number = model.pair(pair.name).id
        for field in ("solref", "solimp", "solreffriction"):
            setattr(by_name[pair.name], field, getattr(model, f"pair_{field}")[number])


def _square(model: MjModel, pair: Pair) -> float:
    """K A [1/s2] of a pair, A being what MuJoCo takes for the inverse mass [1/kg] of two bodies."""
    number = model.pair(pair.name).id
    geoms = model.pair_geom1[number], model.pair_geom2[number]
    inverse = sum(model.body_invweight0[model.geom_bodyid[g], 0] for g in geoms)
    return pair.stiffness * float(inverse)


# ---------------------------------------------------------------- read-outs


def touches(model: MjModel, data: MjData) -> tuple[Touch, ...]:
    """All contacts of a state of which the accelerations are known (`mj_forward`)."""
    return tuple(
        _touch(model, data, number)
        for number in range(data.ncon)
        if data.contact[number].efc_address >= 0
    )


def _touch(model: MjModel, data: MjData, number: int) -> Touch:
    contact, wrench = data.contact[number], np.empty(6)
    mujoco.mj_contactForce(model, data, number, wrench)
    # MuJoCo's is the force on its second geom, along the rows of the frame.
    force = contact.frame.reshape(3, 3).T @ wrench[:3]
    point, geoms = contact.pos.copy(), [int(g) for g in contact.geom]
    stations = [_station(model, data, geom, point) for geom in geoms]
    names = [_owner(model, geom) for geom in geoms]
    if stations[0] is None and stations[1] is not None:
        names, stations, force = names[::-1], stations[::-1], -force
    return Touch(*names, tuple(stations), point, -force, -float(contact.dist))


def _owner(model: MjModel, geom: int) -> str:
    """Name of what a geom belongs to, with the prefix of its robot."""
    if _kind(model, geom) == _LINK:
        return model.geom(geom).name.rstrip("0123456789").removesuffix("skin") + BACKBONE
    return model.body(model.geom_bodyid[geom]).name


def links_of(model: MjModel, prefix: str = "") -> dict[str, tuple[float, float]]:
    """Names of the links' geoms of a robot in a spec of several, with their arc lengths [m]."""
    out = {}
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if _kind(model, geom) == _LINK and name.startswith(prefix):
            _, _, low, high = model.geom_user[geom, :4].tolist()
            out[name] = low, high
    return out


def _kind(model: MjModel, geom: int) -> int:
    return int(model.geom_user[geom, 0]) if model.nuser_geom else 0


def _station(model: MjModel, data: MjData, geom: int, point: ndarray) -> float | None:
    """Arc length [m] of the backbone next to a point, None if the geom is no robot's."""
    kind = _kind(model, geom)
    if not kind:
        return None
    start, low, high = model.geom_user[geom, 1:4]
    if kind == _PART:
        return float(start)
    body = model.geom_bodyid[geom]
    height = data.xmat[body].reshape(3, 3)[:, 2] @ (point - data.xpos[body])
    return float(np.clip(start + height, low, high))
