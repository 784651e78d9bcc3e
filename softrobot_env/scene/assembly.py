"""Several robots in one scene, and robots on moving mounts: attached to each other by names.

Every robot, a member, is built as in a scene of its own and attached with its name as prefix:
"finger1/upper_front". What members do not share (postures, curvatures, lengths of tendons) is read
as in their own scenes; positions and motion are those of the one model of all.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import lcm
from typing import TYPE_CHECKING, Any

import numpy as np
from mujoco import MjModel, MjSpec, mjtConDataField, mjtObj, mjtSensor
from numpy import ndarray

from softrobot_env.core.motion import State
from softrobot_env.core.records import Vector3, check_fields, check_unique
from softrobot_env.core.registry import Registry
from softrobot_env.robots import Base, Gripper

from . import contacts
from .appearance import add_camera, add_surroundings
from .build import (
    CompiledModel,
    Scene,
    build_scene,
    choose_for,
    compile_spec,
    is_extrapolated,
    spec_xml,
)
from .chain import BASE_BODY, SEPARATOR
from .config import Camera, SceneConfig, contact_pieces
from .kinematics import Kinematics
from .mount import TURNS, Mount, Prescribed, add_drives, add_mount, followed
from .objects import Box, Contacts, Object
from .resolution import resolved
from .simulation import Inputs, SceneMotion, simulate
from .spec import build_chain, empty_spec
from .statics import finite
from .timestep import LinearChain, Pace, TimestepChoice, linearize

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

#: Name of a member's sensor of the force between it and an object.
FELT = "felt"

#: What the scenes of all members have in common.
_SHARED = ("control_period", "timestep", "integrator")


@dataclass(frozen=True)
class Member:
    """One robot of several.

    Attributes:
        name: Unique name, the prefix of its parts.
        config: Its scene.
        base: Where it is clamped; as its robot says unless given.
        mount: How its base moves, if it does.
    """

    name: str
    config: SceneConfig
    base: Base | None = None
    mount: Mount | None = None

    def __post_init__(self) -> None:
        check_fields(self, f"member {self.name!r}")
        if not self.name or SEPARATOR in self.name:
            raise ValueError(f"a member needs a name without {SEPARATOR!r}, got {self.name!r}")
        if self.config.contacts is not None:
            raise ValueError(f"member {self.name!r}: contacts and objects belong to the assembly")
        own = [part.name for part in (*self.config.markers, *self.config.paths)]
        if self.mount is not None and own:
            raise ValueError(f"member {self.name!r}: {own[0]!r} would move with its mount")
        fixed = [load.name for load in self.config.loads if not load.follows]
        if self.mount is not None and self.mount.turns and fixed:
            raise ValueError(f"member {self.name!r}: load {fixed[0]!r} would turn with its mount")
        if self.mount is not None and self.config.bending == "planar":
            self._refuse_out_of_plane(self.mount)

    def _refuse_out_of_plane(self, mount: Mount) -> None:
        """A planar chain cannot feel what leaves its plane."""
        normal = (self.base or self.config.robot.clamp).axes[:, 1]
        for direction in mount.directions:
            along = abs(normal @ mount.axis(direction))
            if along < 1 - 1e-9 if direction in TURNS else along > 1e-9:
                raise ValueError(
                    f"member {self.name!r}: a mount that moves along {direction!r} leaves the "
                    "plane of a chain with bending='planar'; choose bending='spatial'"
                )

    @property
    def prefix(self) -> str:
        """Of the names of its parts."""
        return self.name + SEPARATOR

    def placed(self, gravity: Vector3 | None, touches: bool = False) -> SceneConfig:
        """Its scene, clamped where it shall be, under a gravity (3,) [m/s2] unless None.

        Where it touches things it has as many pieces as a robot with contacts.
        """
        robot = self.config.robot
        base = self.base or robot.base
        if self.mount is not None and base is None:
            base = Base()
        robot = replace(robot, base=base, gravity=robot.gravity if gravity is None else gravity)
        look = self.config.appearance
        look = None if look is None else replace(look, surroundings=False)  # those of all
        scene = resolved(replace(self.config, robot=robot, appearance=look))
        if touches and self.config.pieces is None:
            scene = replace(scene, pieces=max(scene.n_pieces, contact_pieces(robot)))
        return scene


@dataclass(frozen=True)
class Assembly:
    """Robots of one scene.

    Attributes:
        name: Of them together.
        members: One or more, with the same control period, timestep, integrator and gravity.
        gravity: (3,) [m/s2] of all members; their own unless given.
        contacts: That and how they touch each other and the objects; nothing touches without.
        objects: What they can touch. Free ones have DOFs, after those of the robots.
        cameras: That look at them.
        surroundings: Whether there are lights and a wall behind them.
        felt: An object whose force on each member its sensor `FELT` tells; none without.
        felt_along: Whether such sensors of the shapes of members tell it, too.
    """

    name: str
    members: tuple[Member, ...]
    gravity: Vector3 | None = None
    contacts: Contacts | None = None
    objects: tuple[Object, ...] = ()
    cameras: tuple[Camera, ...] = ()
    surroundings: bool = False
    felt: str | None = None
    felt_along: bool = False

    def __post_init__(self) -> None:
        check_fields(self, f"assembly {self.name!r}")
        if not self.members:
            raise ValueError(f"assembly {self.name!r} needs a member")
        check_unique(self.members, "the assembly's members")
        check_unique(self.objects, "the assembly's objects")
        for name in _SHARED:
            values = {getattr(member.config, name) for member in self.members}
            if len(values) > 1:
                raise ValueError(f"members of {self.name!r} differ in {name}: {sorted(values)}")
        if len({tuple(config.robot.gravity) for config in self.placed}) > 1:
            raise ValueError(
                f"members of {self.name!r} feel different gravity: give one to the assembly"
            )
        if self.objects and self.contacts is None:
            raise ValueError("objects are there to be touched: give contacts=Contacts(), too")
        if self.felt not in (None, *(thing.name for thing in self.objects)):
            raise ValueError(f"assembly {self.name!r}: there is no object {self.felt!r} to feel")
        moving = [member.name for member in self.members if member.mount is not None]
        if moving and not self.is_extrapolated:
            why = "contacts need one of MuJoCo's" if self.contacts else f"not {self.integrator!r}"
            raise ValueError(
                f"member {moving[0]!r}: a moving mount needs our own integrator, {why}"
            )

    @cached_property
    def placed(self) -> tuple[SceneConfig, ...]:
        """The members' scenes as they are built."""
        touches = self.contacts is not None
        return tuple(member.placed(self.gravity, touches) for member in self.members)

    def with_timestep(self, timestep: float | None) -> "Assembly":
        """The same one whose members have a timestep [s], None for the rule's."""
        members = (
            replace(member, config=replace(member.config, timestep=timestep))
            for member in self.members
        )
        return replace(self, members=tuple(members))

    @property
    def control_period(self) -> float:
        """[s]"""
        return self.placed[0].control_period

    @property
    def integrator(self) -> str | None:
        """That was asked for."""
        return self.placed[0].integrator

    @property
    def is_extrapolated(self) -> bool:
        """Whether our own integrator advances the scene."""
        return self.contacts is None and all(map(is_extrapolated, self.placed))


@dataclass(frozen=True)
class Part(Kinematics):
    """A member in the scene of all; postures and states that it takes are those of all.

    Attributes:
        member: What was asked for.
        scene: The member alone, standing still.
        model: Of all.
        q, v: Where its joints' positions and velocities stand in those of all.
        u: Where its inputs stand.
        bodies: Numbers in the model of all of its own model's bodies.
    """

    member: Member
    scene: Scene
    model: MjModel
    q: slice
    v: slice
    u: slice
    bodies: ndarray

    def posture(self, q: ndarray) -> ndarray:
        """Its part (nq,) or (T, nq) of postures of all."""
        return np.asarray(q)[..., self.q]

    def numbers(self, bodies: ndarray) -> ndarray:
        """See `Kinematics`."""
        return self.bodies[bodies]


@dataclass(frozen=True)
class AssembledScene(CompiledModel):
    """A compiled scene of several robots.

    Attributes:
        config: What was asked for.
        timestep: Integrator and timestep, and why.
        model: The compiled model of all.
        parts: The members by name.
        pairs: What can touch, and how stiff it is.
    """

    config: Assembly
    timestep: TimestepChoice
    model: MjModel
    parts: dict[str, Part]
    pairs: tuple[contacts.Pair, ...] = ()

    def __getitem__(self, name: str) -> Part:
        """A member by its name."""
        if name not in self.parts:
            raise KeyError(f"no member {name!r}; there are {', '.join(self.parts)}")
        return self.parts[name]

    @property
    def name(self) -> str:
        """The assembly's."""
        return self.config.name

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return sum(part.scene.n_inputs for part in self.parts.values())

    def inputs(self, **members: ndarray) -> ndarray:
        """Inputs (n_inputs,) of all from those of members by name; zero of those left out."""
        u = np.zeros(self.n_inputs)
        for name, values in members.items():
            part = self[name]
            u[part.u] = finite(f"inputs of {name!r}", values, (part.scene.n_inputs,))
        return u

    def equilibrium(
        self,
        u: ndarray | None = None,
        guess: ndarray | None = None,
        load_steps: int = 1,
        check_stability: bool | str = True,
        *,
        gravity: ndarray | None = None,
    ) -> ndarray:
        """Posture (nq,) in equilibrium under inputs u (n_inputs,), mounts as they are at first.

        As `Scene.equilibrium`: robots that do not touch rest each by itself.

        Raises:
            ValueError: As there, or the robots can touch.
            EquilibriumError: As there.
        """
        if self.config.contacts is not None:
            raise ValueError(
                f"{self.name!r} has contacts: no equilibrium is computed, use `simulate`"
            )
        u = np.zeros(self.n_inputs) if u is None else finite("inputs", u, (self.n_inputs,))
        guess = None if guess is None else finite("the guess", guess, (self.model.nq,))
        out = self.model.qpos0.copy()
        for part in self.parts.values():
            near = None if guess is None else guess[part.q]
            out[part.q] = part.scene.equilibrium(
                u[part.u], near, load_steps, check_stability, gravity=gravity
            )
        return out

    def simulate(
        self,
        duration: float,
        u: Inputs = None,
        start: State | None = None,
        *,
        samples: ndarray | float | None = None,
        gravity: ndarray | None = None,
        mounts: Mapping[str, Prescribed] | None = None,
    ) -> SceneMotion:
        """Simulate a motion, as `Scene.simulate`.

        Args:
            duration: [s].
            u: Inputs of the robots.
            start: The straight poses at rest unless given. Mounts start as they move, whatever it
                says of them, and with them the robots' bases.
            samples: As there.
            gravity: (3,) [m/s2] in place of the scene's.
            mounts: Motion of each mount by its member's name; those left out stand still.

        Raises:
            ValueError: As there, or a motion does not fit its mount.
            IntegrationError: As there.
        """
        for part in self.parts.values():
            part.scene.checked_gravity(gravity)
        splines = self._splines(duration, mounts or {})
        u, start = self._mounted(u, self.start() if start is None else start, splines)
        return simulate(self, duration, u, start, samples=samples, gravity=gravity)

    def _splines(
        self, duration: float, motions: Mapping[str, Prescribed]
    ) -> dict[str, "CubicSpline"]:
        """How mounts move, by the names of their members."""
        mounts = {m.name: m.mount for m in self.config.members if m.mount is not None}
        unknown = [name for name in motions if name not in mounts]
        if unknown:
            raise ValueError(
                f"no mount of {unknown[0]!r} moves; those of {', '.join(mounts) or 'none'} do"
            )
        accuracy = self.timestep.accuracy or 0.0
        return {
            name: followed(mounts[name], motion, duration, self.timestep.timestep, accuracy)
            for name, motion in motions.items()
        }

    def _mounted(
        self, u: Inputs, start: State, splines: dict[str, "CubicSpline"]
    ) -> tuple[Inputs, State]:
        """Inputs with the mounts' accelerations, and the start with their motion."""
        own = self.model.nu - self.n_inputs
        if not own:
            return u, start
        drives = _of_time(u, self.n_inputs)
        q, v = start[0].copy(), start[1].copy()
        places = {}
        for name, spline in splines.items():
            mount = self[name].member.mount
            joints = [self.model.joint(f"{name}/mount_{d}") for d in mount.directions]
            for joint, x, rate in zip(joints, spline(0.0), spline(0.0, 1), strict=True):
                q[joint.qposadr], v[joint.dofadr] = x, rate
            places[name] = [self.model.actuator(joint.name).id for joint in joints]

        def controls(time: float) -> ndarray:
            row = np.zeros(self.model.nu)
            row[: self.n_inputs] = drives(time)
            for name, spline in splines.items():
                row[places[name]] = spline(time, 2)
            return row

        return controls, State(q, v)


def _of_time(u: Inputs, count: int) -> Callable[[float], ndarray]:
    """Inputs (count,) as a function of the time [s].

    Raises:
        ValueError: They are rows for control periods, which a function of time cannot jump between.
    """
    if callable(u):
        return u
    if u is not None and np.ndim(u) > 1:
        raise ValueError("with moving mounts inputs are constant, or a function of time")
    values = np.zeros(count) if u is None else finite("inputs", u, (count,))
    return lambda time: values


def build_assembly(assembly: Assembly) -> AssembledScene:
    """Build and compile a scene of several robots.

    Raises:
        ValueError: As `build_scene`.

    Warns:
        TimestepWarning: See `scene.timestep.choose_timestep`.
    """
    alone = [build_scene(config) for config in assembly.placed]
    spec, pairs = _attached(assembly)
    model, choice = compile_spec(spec, pairs, partial(_mujocos, assembly, alone, pairs))
    if assembly.is_extrapolated:
        choice = _strictest([scene.timestep for scene in alone])
    return AssembledScene(assembly, choice, model, _parts(assembly, alone, model), tuple(pairs))


def assembly_xml(assembly: Assembly) -> str:
    """The scene as MJCF, ready for any MuJoCo viewer."""
    alone = [build_scene(config) for config in assembly.placed]
    spec, pairs = _attached(assembly)
    return spec_xml(spec, pairs, partial(_mujocos, assembly, alone, pairs))


def _attached(assembly: Assembly) -> tuple[MjSpec, list[contacts.Pair]]:
    """One spec of all members, and what can touch."""
    friction = any(config.robot.has_friction for config in assembly.placed)
    spec = empty_spec(assembly.name, assembly.placed[0].robot.gravity, friction=friction)
    surfaces = []
    for number, (member, config) in enumerate(zip(assembly.members, assembly.placed, strict=True)):
        chain = build_chain(config)
        if assembly.contacts is not None:
            skin = contacts.add_skin(chain, config.robot, assembly.contacts)
            surfaces += [surface.within(member.prefix, number) for surface in skin]
        chain.spec.option.disableflags = spec.option.disableflags  # those of all count
        if member.mount is None:
            frame = spec.worldbody.add_frame()
        else:
            frame = add_mount(spec, member.prefix, member.mount, config.robot)
        spec.attach(chain.spec, prefix=member.prefix, frame=frame)
    for member in assembly.members:
        if member.mount is not None:
            add_drives(spec, member.prefix, member.mount)
    for camera in assembly.cameras:
        add_camera(spec, camera)
    if assembly.surroundings:
        ends = []  # of what the straight robots take, with some room
        for config in assembly.placed:
            base, width = config.robot.clamp, 2 * config.robot.backbone.widest
            tip = np.array(base.position) + config.robot.reach * base.axes[:, 2]
            ends += [x + side * width for x in (np.array(base.position), tip) for side in (-1, 1)]
        low, high = np.min(ends, axis=0), np.max(ends, axis=0)
        size = float(np.max(high - low))
        add_surroundings(spec, size, float(high[1]) + size)
    if assembly.contacts is None:
        return spec, []
    pairs = contacts.connect(spec, surfaces, assembly.objects, assembly.contacts)
    if assembly.felt is not None:
        _feel_all(spec, assembly, surfaces)
    return spec, pairs


def felt_by(geom: str) -> str:
    """Name of the sensor of the force of a shape on what is felt."""
    return f"{geom}{SEPARATOR}{FELT}"


def _feel_all(spec: MjSpec, assembly: Assembly, surfaces: Sequence[contacts.Surface]) -> None:
    """Sensors of what members, and their shapes if wanted, do to an object."""
    force, net = 1 << int(mjtConDataField.mjCONDATA_FORCE), 3

    def feel(name: str, kind: mjtObj, part: str) -> None:
        """Sensor of the sum (3,) [N], in world axes, of the forces of a part on the object."""
        spec.add_sensor(
            name=name,
            type=mjtSensor.mjSENS_CONTACT,
            objtype=kind,
            objname=part,
            reftype=mjtObj.mjOBJ_BODY,
            refname=assembly.felt,
            intprm=[force, net, 1],
        )

    for member in assembly.members:
        prefix = member.prefix
        first = spec.body(f"{prefix}{BASE_BODY}") or spec.body(f"{prefix}link0")
        feel(prefix + FELT, mjtObj.mjOBJ_XBODY, first.name)
    for surface in surfaces if assembly.felt_along else ():
        feel(felt_by(surface.geom), mjtObj.mjOBJ_GEOM, surface.geom)


def _parts(assembly: Assembly, alone: list[Scene], model: MjModel) -> dict[str, Part]:
    parts, first = {}, 0
    for member, scene in zip(assembly.members, alone, strict=True):
        own = scene.model
        joint = model.joint(member.prefix + own.joint(0).name)
        q, v = int(joint.qposadr[0]), int(joint.dofadr[0])
        inputs, first = slice(first, first + own.nu), first + own.nu
        names = [own.body(number).name for number in range(1, own.nbody)]
        bodies = np.array([0, *(model.body(member.prefix + name).id for name in names)])
        place = slice(q, q + own.nq), slice(v, v + own.nv), inputs
        parts[member.name] = Part(member, scene, model, *place, bodies)
    return parts


def _mujocos(
    assembly: Assembly, alone: list[Scene], pairs: list[contacts.Pair], model: MjModel
) -> TimestepChoice:
    """What MuJoCo's own steps of the model take, as `build_scene` has it."""
    chain, parts = linearize(model), _parts(assembly, alone, model).values()
    dofs = np.concatenate([np.arange(model.nv)[part.v] for part in parts])  # not the mounts'
    own = np.ix_(dofs, dofs)
    chain = LinearChain(chain.mass[own], chain.stiffness[own], chain.damping[own], chain.driven)
    longest = None if assembly.contacts is None else contacts.longest_step(model, pairs)
    return choose_for(assembly.placed, chain, longest, assembly.is_extrapolated)


def _strictest(choices: list[TimestepChoice]) -> TimestepChoice:
    """The choice of our own integrator that suits all."""
    shortest = min(choices, key=lambda choice: choice.timestep)
    accuracy = min(choice.accuracy for choice in choices)
    reason = f"steps are as long as {1e3 * accuracy:.3g} mm allow, at most "
    return replace(
        shortest,
        accuracy=accuracy,
        pace=Pace(*(min(each) for each in zip(*(c.pace for c in choices), strict=True))),
        first_period=max(choice.first_period for choice in choices),
        reason=f"{reason}{1e3 * shortest.timestep:.3g} ms",
    )


# ---------------------------------------------------------------- grippers

#: Name of the palm among objects.
PALM = "palm"

#: How fingers touch. They bend in planes of their own, and do not meet.
CONTACTS = Contacts(friction=0.8, between_robots=False)


@dataclass(frozen=True)
class Resolution:
    """How finely a gripper is simulated.

    Attributes:
        name: Key in `FINENESS`.
        pieces: Of a finger, over those of its robot; as many as a robot with contacts has if None.
        longer: Timestep over the rule's for contacts [1].
        contacts: How fingers touch.
    """

    name: str
    pieces: int | None
    longer: float
    contacts: Contacts

    def pieces_of(self, gripper: Gripper) -> int | None:
        """Pieces of each finger; None by the rule."""
        if self.pieces is None:
            return None
        return self.pieces * lcm(*(finger.robot.pieces for finger in gripper.fingers))


#: By the rule; and as quick as keeps bends within those of fingers' sensors, on average.
FINENESS = Registry(
    "fineness",
    {
        "rule": Resolution("rule", None, 1.0, CONTACTS),
        "quick": Resolution("quick", 2, 16.0, replace(CONTACTS, stopping=5.0, sideways=30.0)),
    },
)

#: Hinges of fingers: one in the middle of a piece, which with many pieces is enough.
RULE = "midpoint"

_PALM_RGBA = (0.35, 0.37, 0.4, 1.0)


def gripper_scene(
    gripper: Gripper,
    objects: Sequence[Object] = (),
    *,
    contacts: Contacts = CONTACTS,
    felt_along: bool = False,
    cameras: tuple[Camera, ...] = (),
    **finger: Any,
) -> Assembly:
    """A gripper and what it grips; `build_assembly` builds it.

    Args:
        gripper: The gripper.
        objects: What it touches, beside its palm.
        contacts: How they touch.
        felt_along: Whether the force of each link on the last object is reported, too.
        cameras: That look at it.
        **finger: Of the scene of each finger, see `SceneConfig`: pieces, timestep, appearance.
    """
    finger = {"rule": RULE, "control_period": 0.02} | finger
    palm = []
    if gripper.palm is not None:
        place = (0.0, 0.0, -gripper.palm[2] / 2)
        palm = [Box(name=PALM, size=gripper.palm, position=place, rgba=_PALM_RGBA)]
    members = (
        Member(one.name, SceneConfig(one.robot, **finger), one.base) for one in gripper.fingers
    )
    return Assembly(
        gripper.name,
        tuple(members),
        gravity=gripper.gravity,
        contacts=contacts,
        objects=(*palm, *objects),
        cameras=cameras,
        surroundings=bool(cameras),
        felt=objects[-1].name if objects else None,
        felt_along=felt_along,
    )
