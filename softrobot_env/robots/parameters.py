"""A robot as data: geometry, material, tendons and what it carries.

Frame: the straight robot lies along +z from its clamp at the origin; x and y are lateral.
A planar robot bends in the x-z plane only and positive curvature bends it towards +x.
A robot with a `base` has this frame turned and moved; gravity stays in the world's.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import cos, hypot, inf, pi, sin, sqrt
from pathlib import Path
from typing import Annotated, Any, Literal
from warnings import warn

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import (
    Key,
    Name,
    Record,
    Unit,
    Vector2,
    Vector3,
    check_argument,
    check_fields,
    check_unique,
    placed,
    unwritten,
)

from .ranges import (
    Acceleration,
    Angle,
    Anisotropy,
    Bore,
    Component,
    Curvature,
    DampingTime,
    DeadTime,
    Density,
    Force,
    ForceLimit,
    Gain,
    Inertia,
    Length,
    Mass,
    Modulus,
    Moment,
    Pieces,
    PoissonRatio,
    Position,
    Radius,
    ReflectedMass,
    Speed,
    Station,
    VelocityGain,
)
from .sections import Backbone, Section
from .sensors import Sensor
from .tendons import Tendon
from .variations import varied

__all__ = ["Tendon"]

Gravity = Annotated[tuple[Acceleration, Acceleration, Acceleration], Unit("m/s2")]

#: How tendons can be driven.
DriveKind = Literal["tension", "length"]

#: Smallest positive root of cos(x) cosh(x) = -1: first mode of a clamped-free beam.
_CLAMPED_FREE_ROOT = 1.8751040687119611


@dataclass(frozen=True)
class Drive:
    """How the tendons of a robot are driven.

    Attributes:
        kind: "tension", or "length" by servos that wind up elastic tendons.
        speed: [m/s] at which a length can change; inf unless known.
        travel: [m], pulled in by a full-scale action to either side; the default is in
            `robots.actuation`.
        backlash: [m], width of the servos' dead band.
        gain: [N/m], force per error of the servos' position loop, at the spool, as are all forces
            here. Without a gain, servos have unlimited force and only their speed is limited; with
            one they follow `scene.integration.motors`, and may have the keys below up to
            `command_delay`.
        velocity_gain: [N s/m], force of the loop opposing the motor's speed.
        force_limit: [N], largest force of the motor, which stalls there.
        reflected_mass: [kg], inertia of rotor and gear over the square of the spool's radius.
        gear_friction: [N], dry friction of motor and gear.
        encoder_step: [m], width of an encoder count, within which the loop exerts no force.
        command_delay: [s], dead time from a command to the loop.
        spool_radius: [m], distance from the axis of the spool to the wire at command 0; commands
            are turns times its circumference.
        wire_diameter: [m], thickness that each turn adds to the radius of the spool.
        seating: [m], stretch after which a wire that was slack reaches its full stiffness.
    """

    kind: Annotated[DriveKind, Key("drive")] = "tension"
    speed: Speed = inf
    travel: Annotated[Length | None, Unit("m")] = None
    backlash: Station = 0.0
    gain: Annotated[Gain | None, Unit("N/m")] = None
    velocity_gain: VelocityGain = 0.0
    force_limit: ForceLimit = inf
    reflected_mass: ReflectedMass = 0.0
    gear_friction: Force = 0.0
    encoder_step: Station = 0.0
    command_delay: DeadTime = 0.0
    spool_radius: Annotated[Radius | None, Unit("m")] = None
    wire_diameter: Bore = 0.0
    seating: Station = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "drive")
        given = [f.name for f in fields(self)[1:] if getattr(self, f.name) != f.default]
        if self.kind == "tension" and given:
            raise ValueError(
                f"drive: only tendons driven by length have {', '.join(given)}; this one is driven "
                "by tension"
            )
        forced = [name for name in given if name in _OF_FORCE]
        if self.gain is None and forced:
            raise ValueError(f"drive: {', '.join(forced)} belong to servos with a gain: give one")
        if self.wire_diameter and self.spool_radius is None:
            raise ValueError("drive: a wire_diameter needs a spool_radius, on which it winds")

    @property
    def late(self) -> float:
        """Dead time and lag [s] of servos in a slow motion."""
        return self.command_delay + (0.0 if self.gain is None else self.velocity_gain / self.gain)

    @property
    def layers(self) -> float:
        """[1/m], a of the length x + a x^2 that a servo winds on its spool by a command x."""
        if not self.wire_diameter:
            return 0.0
        return self.wire_diameter / (4 * pi * self.spool_radius**2)

    @property
    def most_let_out(self) -> float:
        """Length [m] commanded from 0 until the wire lies on half the spool's radius."""
        return 1 / (4 * self.layers) if self.layers else inf

    @property
    def is_ideal(self) -> bool:
        """Whether servos have any force, spools one radius and wires one stiffness."""
        return self.gain is None and not self.layers and not self.seating


#: What servos with a gain have alone.
_OF_FORCE = (
    "velocity_gain", "force_limit", "reflected_mass", "gear_friction", "encoder_step",
    "command_delay",
)  # fmt: skip


@dataclass(frozen=True)
class Head:
    """Rigid body on the end of the backbone.

    Attributes:
        mass: [kg].
        centre: [m], height of its centre of mass above the end of the backbone.
        inertia: (3,) [kg m2] about its centre, along x, y and z.
        output: [m], height above the end of the backbone of the point whose position tasks refer
            to.
    """

    mass: Mass
    centre: Station
    inertia: Annotated[tuple[Inertia, Inertia, Inertia], Unit("kg m2")]
    output: Station

    def __post_init__(self) -> None:
        check_fields(self, "head")
        _check_inertia("head", self.inertia)

    @property
    def half_sizes(self) -> Vector3:
        """Half the sizes [m] of the uniform block of its inertia, of 1 mm or more."""
        whole = sum(self.inertia)
        return tuple(sqrt(max(1.5 / self.mass * (whole - 2 * x), 1e-6)) for x in self.inertia)


@dataclass(frozen=True)
class Disc:
    """Rigid disc round the backbone, which turns with the cross-section at its middle.

    Attributes:
        station: [m], arc length of its centre of mass, which lies on the neutral fibre.
        mass: [kg].
        inertia: (3,) [kg m2] about its centre, along x, y and z.
    """

    station: Station
    mass: Mass
    inertia: Annotated[tuple[Inertia, Inertia, Inertia], Unit("kg m2")]

    def __post_init__(self) -> None:
        check_fields(self, "disc")
        _check_inertia("disc", self.inertia)

    @property
    def cylinder(self) -> Vector2:
        """Radius and half the thickness [m] of the uniform disc of its inertia, 1 mm or more."""
        lateral, _, axial = self.inertia
        half = sqrt(max(3 * (lateral - axial / 2) / self.mass, 1e-6))
        return sqrt(2 * axial / self.mass), half

    @classmethod
    def uniform(cls, station: float, mass: float, radius: float, thickness: float) -> "Disc":
        """A homogeneous cylinder of a radius and thickness [m]."""
        lateral = mass * (3 * radius**2 + thickness**2) / 12
        return cls(station, mass, (lateral, lateral, mass * radius**2 / 2))


@dataclass(frozen=True)
class Base:
    """Where a robot is clamped and how it points.

    Attributes:
        position: (3,) [m] of the clamp in the world.
        direction: (3,) from the clamp along the straight robot, of any length. The smallest turn
            from +z leads to it; for (0, 0, -1), hanging, half a turn about y, so that +x becomes
            -x and a planar robot stays in the x-z plane.
        roll: [rad] about the robot's axis after that, from its x towards its y.
    """

    position: Annotated[tuple[Position, Position, Position], Unit("m")] = (0.0, 0.0, 0.0)
    direction: tuple[Component, Component, Component] = (0.0, 0.0, 1.0)
    roll: Angle = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "base")
        if not hypot(*self.direction) >= 1e-6:
            raise ValueError("base: direction must not be zero, it has a length of 1e-6 at least")

    @cached_property
    def axes(self) -> ndarray:
        """(3, 3), its columns are the robot's axes x, y and z in the world."""
        x, y, z = (value / hypot(*self.direction) for value in self.direction)
        if hypot(x, y) > 1e-15:
            along, across = x / hypot(x, y), y / hypot(x, y)
        else:
            along, across = 1.0, 0.0
        less = z - 1
        turn = np.array(
            [
                [1 + less * along**2, less * along * across, x],
                [less * along * across, 1 + less * across**2, y],
                [-x, -y, z],
            ]
        )
        # Pi is rounded: what is left of a cosine or sine that vanishes would leave the plane.
        c, s = (x if abs(x) > 1e-15 else 0.0 for x in (cos(self.roll), sin(self.roll)))
        return turn @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _check_inertia(what: str, inertia: Vector3) -> None:
    if 2 * max(inertia) > sum(inertia) * (1 + 1e-9):
        raise ValueError(
            f"{what}: no body has a moment of inertia above the sum of the other two, got "
            f"{inertia} kg m2"
        )


#: What a robot says itself or through its sections.
_OF_SECTION = (
    "outer_radius",
    "inner_radius",
    "youngs_modulus",
    "density",
    "damping_time",
    "poisson_ratio",
    "bending_friction",
)
_FLAT = ("length", "pieces", *_OF_SECTION)


@dataclass(frozen=True)
class RobotParams:
    """A soft robot as a circular beam with tendons; SI units.

    A uniform beam is said by length, radii, material and pieces. Any other has `sections` instead:
    its length and pieces are then the sums over them, and the other numbers of the first are None
    (a single section that does not taper is the uniform beam and becomes it). `backbone` has the
    properties of both as functions of the arc length.

    Attributes:
        name: Key in `ROBOTS`.
        length: [m] of the flexible backbone.
        outer_radius, inner_radius: [m] of the ring cross-section (inner 0: solid).
        youngs_modulus: [Pa].
        density: [kg/m3].
        damping_time: mu [s] of stiffness-proportional damping D = mu K; 0 is undamped.
        pieces: Number of pieces of the thesis' discretisation, equal in each section; curvature
            is reported per piece.
        poisson_ratio: [1], in (-1, 0.5].
        bending_friction: [N m], dry friction of the backbone against bending, see `Section`; None
            is none.
        tendons: Tendons, ordered by group.
        gravity: (3,) [m/s2].
        head: Rigid body on the tip, if any.
        anisotropy: Difference of the bending stiffnesses [1]: it is EI (1 + anisotropy / 2) towards
            `stiff_azimuth` and EI (1 - anisotropy / 2) across, in all sections.
        stiff_azimuth: [rad] from +x towards +y.
        precurvature: (2,) [1/m] towards +x and +y, of the robot when nothing acts on it.
        sections: From the base to the tip, see above.
        discs: Rigid discs on the backbone.
        base: Where the robot is clamped; at the world's origin along +z unless given.
        drive: How its tendons are driven.
        sensors: Curvature sensors on it; what they read is the observable `sensors`.
        adaptive_pieces: Whether chains have as many times its pieces as their accuracy asks for: of
            files that do not say `pieces`.
        file: That describes it, None of others; beside it lie its trained artifacts. Robots of
            different files may be equal.
        hardware: Table `[hardware]` of the file as it is written, what drives the real one; see
            `softrobot_env.hardware.registry`.
    """

    name: Name
    length: Length = unwritten(None)
    outer_radius: Radius = unwritten(None)
    inner_radius: Bore = unwritten(None)
    youngs_modulus: Modulus = unwritten(None)
    density: Density = unwritten(None)
    damping_time: DampingTime = unwritten(None)
    pieces: Pieces = unwritten(None)
    poisson_ratio: PoissonRatio = unwritten(None)
    bending_friction: Moment | None = unwritten(None)
    tendons: Annotated[tuple[Tendon, ...], Key("tendon")] = ()
    gravity: Gravity = (0.0, 0.0, 0.0)
    head: Head | None = None
    anisotropy: Anisotropy = 0.0
    stiff_azimuth: Angle = 0.0
    precurvature: Annotated[tuple[Curvature, Curvature], Unit("1/m")] = (0.0, 0.0)
    sections: Annotated[tuple[Section, ...], Key("section")] = ()
    discs: Annotated[tuple[Disc, ...], Key("disc")] = ()
    base: Base | None = None
    drive: Drive = unwritten(Drive())
    sensors: Annotated[tuple[Sensor, ...], Key("sensor")] = ()
    adaptive_pieces: bool = unwritten(False)
    file: Path | None = unwritten(None, compare=False, repr=False)
    hardware: dict[str, Any] | None = unwritten(None, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_argument(f"robot {self.name!r}: sections", self.sections, tuple[Section, ...])
        if self.sections:
            self._adopt_sections()
        if not self.sections and self.poisson_ratio is None:
            self._set("poisson_ratio", 0.0)
        check_fields(self, f"robot {self.name!r}", but=_OF_SECTION if self.sections else ())
        check_unique(self.tendons, f"robot {self.name!r}: tendons")
        check_unique(self.sensors, f"robot {self.name!r}: sensors")
        with placed(f"robot {self.name!r}"):
            _ = self.backbone  # which checks sections
        _check_places(self)
        stiff = [t.name for t in self.tendons if not t.stiffness < inf]
        if self.drive.kind == "length" and stiff:
            raise ValueError(
                f"robot {self.name!r}: tendons driven by length need a finite stiffness, unlike "
                f"{', '.join(stiff)}"
            )
        most = min((self.most_pulled(tendon) for tendon in self.tendons), default=inf)
        if self.drive.travel is not None and self.drive.travel > most:
            raise ValueError(
                f"robot {self.name!r}: travel must be at most {most:.3g} m, which folds the robot "
                f"at full tension, got {self.drive.travel:g} m"
            )
        lengths = (min(pi * t.farthest, self.most_pulled(t)) for t in self.tendons)
        longest = self.drive.travel or max(lengths, default=0.0)
        if not longest <= self.drive.most_let_out:
            raise ValueError(
                f"robot {self.name!r}: servos let out up to {longest:.3g} m, and have no more than "
                f"{self.drive.most_let_out:.3g} m on a spool_radius of {self.drive.spool_radius:g} "
                "m: take a larger one, or a thinner wire"
            )
        if self.hardware == {}:
            raise ValueError(f"robot {self.name!r}: hardware must be a table that is not empty")
        if not hypot(*self.precurvature) < self.curvature_limit:
            raise ValueError(
                f"robot {self.name!r}: precurvature must stay below {self.curvature_limit:g} 1/m"
            )

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _adopt_sections(self) -> None:
        """Take length and pieces from the sections, or all from one that does not taper."""
        self._set("sections", tuple(self.sections))
        given = [name for name in _OF_SECTION if getattr(self, name) is not None]
        if given:
            raise ValueError(
                f"robot {self.name!r} has sections, which say its {', '.join(given)}: give one or "
                "the other (`with_sections` replaces sections)"
            )
        for name in ("length", "pieces"):
            total = sum(getattr(section, name) for section in self.sections)
            if getattr(self, name) not in (None, total):
                raise ValueError(
                    f"robot {self.name!r}: the {name} of its sections is {total:g} together, not "
                    f"{getattr(self, name)} (`with_sections` replaces sections)"
                )
            self._set(name, total)
        if len(self.sections) == 1 and self.sections[0].is_uniform:
            (one,) = self.sections
            for name in _OF_SECTION:
                self._set(name, getattr(one, name))
            self._set("bending_friction", one.bending_friction or None)
            self._set("outer_radius", one.outer_radii[0])
            self._set("inner_radius", one.inner_radii[0])
            self._set("sections", ())

    def with_sections(self, *sections: Section) -> "RobotParams":
        """The same robot with a backbone of other sections."""
        return replace(self, **dict.fromkeys(_FLAT), sections=sections)

    @cached_property
    def backbone(self) -> Backbone:
        """Its sections, and their properties as functions of the arc length."""
        if self.sections:
            return Backbone(self.sections)
        given = {name: getattr(self, name) for name in _FLAT}
        return Backbone([Section(**{n: value for n, value in given.items() if value is not None})])

    @property
    def is_uniform(self) -> bool:
        """Whether its cross-sections are alike, so that `bending_stiffness` and the like exist."""
        return not self.sections

    def require_uniform(self, what: str) -> None:
        """Raise ValueError, naming what does so, if it needs a uniform backbone."""
        if not self.is_uniform:
            raise ValueError(
                f"{what} needs a backbone of one section that does not taper; robot "
                f"{self.name!r} has {len(self.sections)} section(s): use its `backbone`, or take "
                "the MuJoCo chain, PCC or CosseratRod"
            )

    def require_plane(self, what: str) -> None:
        """Raise ValueError if its base turns its x-z plane out of the world's, where `what` is."""
        if self.is_planar and not self.moves_in_xz:
            raise ValueError(
                f"{what} is measured in the world's x-z plane; the base of robot {self.name!r} "
                "turns its own plane out of it: give a direction (x, 0, z) and no roll"
            )

    def stations(self, stations: ndarray, offsets: ndarray | None = None) -> ndarray:
        """Stations (k,) [m] of points of the robot, with offsets (k, 2) [m] in the section.

        Raises:
            ValueError: A point is off the robot, or the shapes do not fit.
        """
        stations = np.atleast_1d(np.asarray(stations, float))
        on = (stations >= 0) & (stations <= self.length * (1 + 1e-12))
        if not np.all(on):
            raise ValueError(
                f"stations must lie between 0 and {self.length} m, got {stations[~on]}"
            )
        if offsets is not None and np.shape(offsets) != (len(stations), 2):
            raise ValueError(
                f"offsets must have shape ({len(stations)}, 2), got {np.shape(offsets)}"
            )
        return stations

    @property
    def clamp(self) -> Base:
        """Its base; that at the world's origin along +z unless it has one."""
        return self.base or Base()

    @property
    def own_gravity(self) -> Vector3:
        """Gravity (3,) [m/s2] along the robot's own axes at its base."""
        return self.seen(self.gravity)

    def seen(self, vector: Vector3) -> Vector3:
        """A vector (3,) of the world along the robot's own axes at its base."""
        if self.base is None:
            return vector
        return tuple((np.asarray(vector, float) @ self.base.axes).tolist())

    @property
    def area(self) -> float:
        """Cross-section area A [m2]."""
        self.require_uniform("area")
        return pi * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def second_moment(self) -> float:
        """Second moment of area I about a lateral axis [m4]."""
        self.require_uniform("second_moment")
        return pi / 4 * (self.outer_radius**4 - self.inner_radius**4)

    @property
    def bending_stiffness(self) -> float:
        """EI [N m2]."""
        self.require_uniform("bending_stiffness")
        return self.youngs_modulus * self.second_moment

    @property
    def torsional_stiffness(self) -> float:
        """GJ [N m2]; for a circular section J = 2 I."""
        self.require_uniform("torsional_stiffness")
        return self.bending_stiffness / (1 + self.poisson_ratio)

    @property
    def mass_per_length(self) -> float:
        """Rho A [kg/m]."""
        self.require_uniform("mass_per_length")
        return self.density * self.area

    @property
    def mass(self) -> float:
        """Mass of the backbone [kg]."""
        if self.sections:
            return float(self.backbone.integrals(self.backbone.mass, self.backbone.ends).sum())
        return self.mass_per_length * self.length

    @property
    def first_frequency(self) -> float:
        """First undamped bending frequency [Hz] of the Euler-Bernoulli beam, (2.75)."""
        self.require_uniform("first_frequency")
        wave = (_CLAMPED_FREE_ROOT / self.length) ** 2
        return wave * sqrt(self.bending_stiffness / self.mass_per_length) / (2 * pi)

    @property
    def reach(self) -> float:
        """Distance [m] of the tip from the base when straight; with a head, of its output point."""
        return self.length if self.head is None else self.length + self.head.output

    @property
    def is_symmetric(self) -> bool:
        """Whether it is straight and bends alike to all sides."""
        return self.anisotropy == 0 and not any(self.precurvature)

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons."""
        return tuple(t.name for t in self.tendons)

    def of_tendons(self, name: str) -> ndarray:
        """What each tendon has by a name, such as "stiffness", (n_tendons, ...)."""
        return np.array([getattr(t, name) for t in self.tendons], float)

    @property
    def is_planar(self) -> bool:
        """Whether nothing of it, nor its weight, leaves the x-z plane at its base."""
        crossing = any(t.leaves_plane for t in self.tendons) or self.own_gravity[1]
        return self.is_symmetric and not crossing

    @property
    def moves_in_xz(self) -> bool:
        """Whether it is planar, and its plane is the world's x-z plane."""
        return self.is_planar and bool(np.abs(self.clamp.axes[1, [0, 2]]).max() <= 1e-12)

    @property
    def twists(self) -> bool:
        """Whether a tendon pulls with a moment about the fibre."""
        return any(tendon.twists for tendon in self.tendons)

    @property
    def has_friction(self) -> bool:
        """Whether any tendon, or the backbone, has dry friction."""
        rubbing = any(tendon.friction > 0 for tendon in self.tendons)
        return self.holds or rubbing or self.has_capstan_friction

    @property
    def has_capstan_friction(self) -> bool:
        """Whether any tendon has friction that grows with its tension."""
        return any(tendon.has_capstan_friction for tendon in self.tendons)

    @property
    def most_exponents(self) -> ndarray:
        """(n_tendons,) [1], logarithms of ratios of tension along tendons of a folded robot."""
        bent = self.curvature_limit * self.of_tendons("end")
        feed = [t.feed_line.exponent if t.feed_line else 0.0 for t in self.tendons]
        return self.of_tendons("friction_coefficient") * bent + feed

    @property
    def rubs(self) -> bool:
        """Old name of `has_friction`."""
        warn("RobotParams.rubs is has_friction now", DeprecationWarning, stacklevel=2)
        return self.has_friction

    @property
    def holds(self) -> bool:
        """Whether the backbone has dry friction, which keeps bends."""
        return any(section.bending_friction > 0 for section in self.backbone.sections)

    @property
    def curvature_limit(self) -> float:
        """Curvature [1/m] at which the inner side of the bend would fold: 1 / outer_radius."""
        return 1 / (self.backbone.widest if self.sections else self.outer_radius)

    def most_pulled(self, tendon: Tendon) -> float:
        """Length [m] of a tendon that can be pulled in, or let out, of the straight robot.

        The robot is then bent until its inner side folds, and the tendon is at its limit.
        """
        bent = self.curvature_limit * tendon.end * tendon.farthest
        return bent + tendon.tension_limit / tendon.stiffness

    def vary(self, **values: float) -> "RobotParams":
        """The same robot with some parameters varied.

        Args:
            **values: By names out of `variations.VARIATIONS`, as there: factors [1], of
                `tendon_friction` [N] what is added for every tendon. The tendon radius is the
                distance of all tendons from the neutral fibre. All sections vary alike.

        Raises:
            ValueError: An unknown name or a value out of range; the message names what is allowed.
        """
        return varied(self, values)


def _check_places(robot: RobotParams) -> None:
    """Refuse tendons, sensors and discs that are off the robot."""
    places = [(f"tendon {tendon.name!r} ends", tendon.end) for tendon in robot.tendons]
    places += [(f"sensor {sensor.name!r} ends", sensor.end) for sensor in robot.sensors]
    places += [("a disc is", disc.station) for disc in robot.discs]
    for what, station in places:
        if station > robot.length * (1 + 1e-12):
            raise ValueError(
                f"robot {robot.name!r}: {what} at {station} m, off the robot, 0 to {robot.length} m"
            )


def centerline(robot: RobotParams, curvature: ndarray, points: int = 10) -> ndarray:
    """Shape of a planar robot made of equal constant-curvature pieces.

    Args:
        robot: The robot; only its length is used.
        curvature: (n_pieces,) [1/m] from the base to the tip, of equal pieces.
        points: Number of points per piece after its start.

    Returns:
        (1 + points * n_pieces, 3) [m], starting at the base.
    """
    curvature = np.asarray(curvature, float)
    piece = robot.length / len(curvature)
    # Half-angle form of an arc's chord: exact, and smooth where the curvature vanishes.
    half = np.repeat(curvature, points) * piece / points / 2
    tangent = np.concatenate(([0.0], np.cumsum(2 * half)))[:-1] + half
    chord = piece / points * np.sinc(half / pi)
    steps = np.stack([np.sin(tangent), np.zeros_like(tangent), np.cos(tangent)], axis=1)
    return np.concatenate((np.zeros((1, 3)), np.cumsum(chord[:, None] * steps, axis=0)))


# ---------------------------------------------------------------- grippers
@dataclass(frozen=True)
class Finger(Record):
    """A robot that is a finger.

    Attributes:
        name: Unique name.
        robot: The robot.
        base: Where it is clamped; its own x axis points towards the object.
    """

    name: Name
    robot: RobotParams
    base: Base


@dataclass(frozen=True)
class Gripper:
    """Fingers round a palm.

    Attributes:
        name: Key in `GRIPPERS`.
        fingers: One or more.
        gravity: (3,) [m/s2].
        palm: Sizes (3,) [m] of a block below z = 0; None if there is no palm.
        file: That describes it, None of others.
    """

    name: Name
    fingers: Annotated[tuple[Finger, ...], Key("finger")]
    gravity: Gravity = (0.0, 0.0, 0.0)
    palm: Annotated[tuple[Length, Length, Length] | None, Unit("m")] = None
    file: Path | None = unwritten(None, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self, f"gripper {self.name!r}")
        if not self.fingers:
            raise ValueError(f"gripper {self.name!r} needs a finger")
        check_unique(self.fingers, f"gripper {self.name!r}: fingers")
        for finger in self.fingers:
            if not finger.robot.tendons or finger.robot.drive.kind != "tension":
                raise ValueError(
                    f"gripper {self.name!r}: finger {finger.name!r} needs tendons that are driven "
                    "by tension"
                )

    @cached_property
    def tension_limits(self) -> ndarray:
        """(n,) [N], of all tendons, finger by finger."""
        return np.array([t.tension_limit for f in self.fingers for t in f.robot.tendons])

    def seat(self, radius: float) -> float:
        """Height [m] at which a round thing of a radius [m] above the middle touches first.

        Its axis lies across the planes in which the fingers bend. It touches the lines along which
        the straight fingers lie, or the palm.
        """
        heights = [0.0 if self.palm is None else radius]
        for finger in self.fingers:
            inward = finger.base.axes[:, 0]
            away = radius + float(finger.robot.backbone.widest)
            if inward[2] > 0:
                beyond = away + inward[:2] @ np.array(finger.base.position[:2])
                heights.append(finger.base.position[2] + float(beyond / inward[2]))
        return max(heights)
