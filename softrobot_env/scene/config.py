"""What a scene contains. A part that is not listed is not built."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, cos, inf, nan, sin
from typing import Literal

import numpy as np

from softrobot_env.core.records import (
    Positive,
    Record,
    Vector2,
    Vector3,
    check_fields,
    check_unique,
)
from softrobot_env.robots import Base, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.robots.ranges import Pieces

from .objects import Contacts, Object, Rgba
from .quadrature import RULES, HingeLayout, place_between
from .timestep import CONTACT_INTEGRATORS, EXTRAPOLATION

#: How tendons can be driven.
ACTUATIONS = ("tension", "length")

#: How a chain can bend: in the x-z plane only, or in space.
BENDING = ("planar", "spatial")

#: Integrators a scene can use: our own one, and MuJoCo's by their names.
INTEGRATORS = (EXTRAPOLATION, "implicitfast", "discrete", "implicit", "Euler", "RK4")

#: Name of the camera that a visible scene has.
FRONT_CAMERA = "front"

#: Hinge rules of chains that do not twist and of those that do, unless another is wanted.
DEFAULT_RULE, TWISTING_RULE = "balanced2", "coupled2"

#: That of chains that twist and have tendons in channels, whose moments the springs of "coupled2"
#: would spread unevenly: in them tendons press the rod, which takes back what it corrects.
CHANNEL_RULE = "gauss2"

#: How channels can be routed: by hinge angles, or right to second order in the strains.
CHANNELS = ("linear", "exact")

#: That of chains whose pieces end at the guides of their tendons: a span between two guides then
#: shortens, and has moment arms, as an arc does.
GUIDED_RULE = "chord2"

#: Least accuracy over the length, near to what rounding leaves of it.
FINEST = 1e-10

#: Of a chain: MuJoCo nests no more bodies.
MOST_HINGES = 1000

#: Fewest pieces of a robot that touches something, unless said otherwise: contacts along an arc are
#: then within 0.5 % of the exact forces (`softrobot benchmark contacts`).
CONTACT_PIECES = 24

#: Accuracy unless another is wanted.
DEFAULT_SHARE = "0.1%"

_SHORTEST_STEP = 1e-8  # s, below which an episode would take days

_WIDTH_SHOWN, _HEIGHT_SHOWN = 1.9, 1.36  # of the robot's reach
_ELEVATION = 0.6  # rad, from which a robot that bends in space is seen
_HANGING = 0.5  # of its direction that is down


@dataclass(frozen=True)
class Camera(Record):
    """Fixed camera looking along +y at the x-z plane, or from above or below it.

    Attributes:
        name: Unique name.
        center: (x, z) [m] in the middle of the picture.
        height: [m] shown across the line of sight.
        elevation: [rad] above the horizontal from which it looks; negative from below.
    """

    name: str
    center: Vector2
    height: Positive
    elevation: float = 0.0

    @property
    def towards(self) -> Vector3:
        """Unit vector from what is seen to the camera."""
        return 0.0, -cos(self.elevation), sin(self.elevation)

    @property
    def up(self) -> Vector3:
        """Unit vector that points up in the picture; right is +x."""
        return 0.0, sin(self.elevation), cos(self.elevation)


@dataclass(frozen=True)
class Marker(Record):
    """Coloured ball without mass, at `position` (3,) [m], movable as a mocap body."""

    name: str
    position: Vector3
    radius: Positive = 0.008
    rgba: Rgba = (0.85, 0.2, 0.15, 1.0)


@dataclass(frozen=True)
class PathMarker(Record, what="path"):
    """Line through `points` (k, 3) [m]."""

    name: str
    points: tuple[Vector3, ...]
    radius: Positive = 0.0015
    rgba: Rgba = (0.25, 0.25, 0.3, 1.0)


@dataclass(frozen=True)
class TipSensors:
    """Position and velocity of the tip in `sensordata`, evaluated with the kinematics."""


@dataclass(frozen=True)
class Appearance(Record):
    """Visible body: links, visible tendons, wall and lights. Adds no mass and no contacts.

    `surroundings` tells whether wall and lights are there, too.
    """

    link_rgba: Rgba = (0.93, 0.75, 0.45, 1.0)
    tendon_rgba: Rgba = (0.15, 0.3, 0.65, 1.0)
    surroundings: bool = True


@dataclass(frozen=True)
class SceneConfig:
    """A scene: the robot's discretisation and the parts to build.

    Attributes:
        robot: The robot.
        pieces: Pieces the robot is cut into, equal in each section: in total (shared out by
            length, one or more a section), or one number per section. Unless given the robot's
            own, with contacts as many times that as make `CONTACT_PIECES`; of a robot whose file
            says none as many times that as its accuracy at rest asks for (`scene.resolution`),
            which `build_scene` finds.
            A section's end is a piece's end, and a channel's end has to be one.
        rule: Hinge rule, a key of `softrobot_env.scene.quadrature.RULES`; unless given "chord2"
            where tendons run through guides, all at ends of pieces, else for a chain that twists
            "gauss2" with tendons in channels and "coupled2" without, else "balanced2".
        actuation: "tension" (controls are tensions [N]) or "length" (controls are the lengths
            [m] pulled in; tension = stiffness x stretch, never pushing).
        control_period: [s], the timestep divides it.
        timestep: [s], chosen by rule (`scene.timestep`) unless given.
        integrator: One of `INTEGRATORS`, chosen by rule unless given.
        accuracy: Error of any point of the backbone that is wanted, in time and, where pieces
            follow from it, at rest: [m], or a share of the length as text, "0.1%". Only
            "extrapolation" looks at its error in time.
        sensors, cameras, markers, paths, loads, appearance: The optional parts.
        bending: "planar" (in the x-z plane only) or "spatial".
        torsion: Whether a spatial chain twists about its axis too; else it is rigid in torsion.
        contacts: That and how the robot touches itself and the objects; nothing touches without.
        channels: "linear" (tendons in channels pull by hinge angles, the cheapest way) or "exact"
            (their lengths are right to second order in the strains, so that tensions make torsion
            stiffer); unless given exact where a tendon of a chain that twists winds.
        objects: What it can touch. Free ones have DOFs, after those of the robot.
    """

    robot: RobotParams
    pieces: Pieces | tuple[Pieces, ...] | None = None
    rule: str | None = None
    actuation: Literal[ACTUATIONS] = "tension"
    control_period: Positive = 0.01
    timestep: Positive | None = None
    integrator: Literal[INTEGRATORS] | None = None
    sensors: tuple[TipSensors, ...] = ()
    cameras: tuple[Camera, ...] = ()
    markers: tuple[Marker, ...] = ()
    paths: tuple[PathMarker, ...] = ()
    loads: tuple[Load, ...] = ()
    appearance: Appearance | None = None
    bending: Literal[BENDING] = "planar"
    torsion: bool = False
    accuracy: float | str = DEFAULT_SHARE
    contacts: Contacts | None = None
    objects: tuple[Object, ...] = ()
    channels: Literal[CHANNELS] | None = None

    def __post_init__(self) -> None:
        check_fields(self, "scene")
        for name in ("cameras", "markers", "paths", "loads", "objects"):
            check_unique(getattr(self, name), f"the scene's {name}")
        if self.timestep is not None and self.timestep > self.control_period:
            raise ValueError(
                f"timestep must be at most the control period, {self.control_period:g} s, got "
                f"{self.timestep:g} s"
            )
        if self.timestep is not None and self.timestep < _SHORTEST_STEP:
            raise ValueError(
                f"timestep must be at least {_SHORTEST_STEP:g} s, got {self.timestep:g} s"
            )
        if self.torsion and self.bending != "spatial":
            raise ValueError("torsion needs bending='spatial': a planar chain cannot twist")
        _ = self.wanted_accuracy, self.edges
        if self.integrator == EXTRAPOLATION and self.robot.holds:
            raise ValueError(
                f"robot {self.robot.name!r}: integrator {EXTRAPOLATION!r} knows no friction of the "
                "backbone; leave it out, or choose one of MuJoCo's"
            )
        if self.robot.has_capstan_friction and (
            self.contacts is not None
            or self.robot.holds
            or self.integrator not in (None, EXTRAPOLATION)
        ):
            raise ValueError(
                f"robot {self.robot.name!r}: friction_coefficient and feed_line need integrator "
                f"{EXTRAPOLATION!r}, which has no contacts and no bending_friction"
            )
        if self.objects and self.contacts is None:
            raise ValueError("objects are there to be touched: give contacts=Contacts(), too")
        if self.contacts is not None and self.integrator not in (None, *CONTACT_INTEGRATORS):
            raise ValueError(
                f"integrator {self.integrator!r} does not know contacts; leave it out, or choose "
                f"from {', '.join(CONTACT_INTEGRATORS)}"
            )
        if self.n_hinges > MOST_HINGES:
            raise ValueError(
                f"robot {self.robot.name!r}: a chain bends at {MOST_HINGES} stations at most, got "
                f"{self.n_hinges}: give fewer pieces, or take a beam model"
            )

    @property
    def wanted_accuracy(self) -> float:
        """The accuracy [m].

        Raises:
            ValueError: It is neither a positive length nor a share.
        """
        text = str(self.accuracy).strip()
        try:
            share = text.endswith("%")
            value = self.robot.length * float(text[:-1]) / 100 if share else float(text)
        except ValueError:
            value = nan
        least = FINEST * self.robot.length
        if not least <= value < inf or isinstance(self.accuracy, bool):
            raise ValueError(
                f"accuracy must be a length of {least:g} m or more, or a share of the robot's "
                f"length such as '0.1%', got {self.accuracy!r}"
            )
        return value

    @property
    def n_pieces(self) -> int:
        """Number of pieces really used."""
        return len(self.edges) - 1

    @property
    def n_hinges(self) -> int:
        """Number of stations at which it bends; ValueError of an unknown rule."""
        return self.n_pieces * len(RULES.find(self.hinge_rule))

    @cached_property
    def edges(self) -> np.ndarray:
        """Ends (n_pieces + 1,) [m] of the pieces.

        Raises:
            ValueError: The pieces do not fit the robot's sections.
        """
        pieces = self.robot.pieces if self.pieces is None else self.pieces
        if self.pieces is None and self.contacts is not None:
            pieces = contact_pieces(self.robot)
        return self.robot.backbone.cut(pieces)

    @cached_property
    def layout(self) -> HingeLayout:
        """Where its hinges stand; errors as `edges`."""
        return place_between(self.edges, self.hinge_rule, self.robot.backbone)

    @property
    def hinge_rule(self) -> str:
        """The hinge rule really used."""
        if self.rule is not None:
            return self.rule
        if self._guided_by_pieces():
            return GUIDED_RULE
        if not self.torsion:
            return DEFAULT_RULE
        return TWISTING_RULE if all(t.guides for t in self.robot.tendons) else CHANNEL_RULE

    @property
    def exact_channels(self) -> bool:
        """Whether channels are really exact."""
        if self.channels is not None:
            return self.channels == "exact"
        return self.torsion and any(tendon.twists for tendon in self.robot.tendons)

    def _guided_by_pieces(self) -> bool:
        """Whether the robot's tendons run through guides, all of them at ends of pieces."""
        tendons = self.robot.tendons
        if not (tendons and all(tendon.guides for tendon in tendons)):
            return False
        guides = np.unique([station for t in tendons for station in t.stations])
        off = np.abs(self.edges[:, None] - guides).min(axis=0)
        return bool(off.max() <= 1e-9 * self.robot.length)


def contact_pieces(robot: RobotParams) -> int:
    """Pieces of a robot that touches something: as many times its own as make `CONTACT_PIECES`."""
    return robot.pieces * ceil(CONTACT_PIECES / robot.pieces)


def visible(config: SceneConfig, aspect: float = 4 / 3) -> SceneConfig:
    """The same scene with a body to look at and a camera that frames the robot's reach.

    Args:
        config: The scene.
        aspect: Width over height of the pictures to take.
    """
    reach, base = config.robot.reach, config.robot.clamp
    height = reach * max(_HEIGHT_SHOWN, _WIDTH_SHOWN / aspect)
    x, _, z = (base.position + 0.48 * reach * base.axes[:, 2]).tolist()  # about its middle
    elevation = 0.0
    if config.bending == "spatial":  # of one that hangs from below, where its mount hides nothing
        elevation = -_ELEVATION if base.axes[2, 2] < -_HANGING else _ELEVATION
    camera = Camera(FRONT_CAMERA, (x, z), height, elevation)
    return replace(config, appearance=Appearance(), cameras=(camera,))


def attachable(config: SceneConfig) -> SceneConfig:
    """The same scene in the axes of the robot's base, visible, and without anything of the world.

    Attached to a frame of another model the robot is clamped there, along the frame's z. The other
    model's gravity and options then count; alone it moves as the scene does, turned with its base.
    """
    robot = config.robot
    robot = replace(robot, base=Base(), gravity=robot.own_gravity)
    return replace(config, robot=robot, appearance=Appearance(surroundings=False))
