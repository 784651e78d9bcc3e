"""What a robot can touch, as data: the properties of contacts, and objects."""

from dataclasses import dataclass
from math import cos, pi, prod, sin
from typing import ClassVar

import numpy as np

from softrobot_env.core.records import NotNegative, Positive, Record, Share, Vector3, check_fields

#: [m/s2], by which the weight of an object is judged.
G = 9.81

Rgba = tuple[Share, Share, Share, Share]


@dataclass(frozen=True)
class Contacts(Record):
    """That a robot can touch: itself if wanted, objects, and other robots.

    Attributes:
        stiffness: [N/m2], of the skin: force per depth and length of backbone in contact. A link
            touches with its own length. Unless given, that of a cylinder of the robot's material
            on a flat, pi / 4 E / (1 - nu^2) (Popov, Contact Mechanics and Friction), or as much
            of it as the timestep can do.
        damping_ratio: [1] of a contact; 1 does not bounce.
        friction: Coulomb's coefficient [1], with objects that have none of their own.
        self_contact: Whether the robot touches itself.
        between_robots: Whether robots of one scene touch each other; each of n links can touch
            every other one's, so leave it out where they cannot meet.
        stopping: Rate at which friction stops a motion, over a contact's frequency w [1], as far as
            the timestep resolves it. MuJoCo's friction parts two bodies by friction times rate /
            w^2 times their sliding velocity: large is inaccurate where much slides fast. Small is
            where w is slowed down by a long timestep, and things creep on.
        sideways: How much stiffer contacts are against sliding than against depth [1]. Less makes
            MuJoCo's solver converge sooner, and lets things creep.
    """

    stiffness: Positive | None = None
    damping_ratio: NotNegative = 1.0
    friction: NotNegative = 0.5
    self_contact: bool = False
    between_robots: bool = True
    stopping: Positive = 1.0
    sideways: Positive = 1e4

    name: ClassVar[str] = "contacts"


@dataclass(frozen=True, kw_only=True)
class Object:
    """A rigid thing; one with a mass or density is free to move, any other stands still.

    Attributes:
        name: Unique name.
        position: (3,) [m] of its centre.
        turn: (3,) [rad], rotation vector from the axes of its shape to those of the world.
        friction: Coefficient [1]; that of `Contacts` unless given. Of two objects the larger.
        mass: [kg].
        density: [kg/m3].
        rgba: Its colour.
    """

    name: str
    position: Vector3 = (0.0, 0.0, 0.0)
    turn: Vector3 = (0.0, 0.0, 0.0)
    friction: NotNegative | None = None
    mass: Positive | None = None
    density: Positive | None = None
    rgba: Rgba = (0.45, 0.55, 0.6, 1.0)

    has_faces: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_fields(self, f"object {self.name!r}")
        if self.mass is not None and self.density is not None:
            raise ValueError(f"object {self.name!r}: give its mass or its density, not both")

    @property
    def is_free(self) -> bool:
        """Whether it moves."""
        return self.mass is not None or self.density is not None

    @property
    def geom_type(self) -> str:
        """MuJoCo's name of its shape."""
        return f"mjGEOM_{type(self).__name__.upper()}"

    @property
    def quaternion(self) -> list[float]:
        """(4,), real part first."""
        angle = float(np.linalg.norm(self.turn))
        half = sin(angle / 2) / angle if angle else 0.5
        return [cos(angle / 2), *(half * x for x in self.turn)]

    @property
    def geom_size(self) -> list[float]:
        """(3,) [m], as MuJoCo has it: half sizes and radii."""
        return [*self._sizes(), 0.0, 0.0][:3]

    @property
    def total_mass(self) -> float:
        """[kg]"""
        return self.density * self._volume() if self.mass is None else self.mass

    @property
    def extent(self) -> float:
        """Half the smallest size [m]."""
        return min(self._sizes())

    def _sizes(self) -> tuple[float, ...]:
        raise NotImplementedError

    def _volume(self) -> float:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Sphere(Object):
    """Ball of a radius [m]."""

    radius: Positive

    def _sizes(self) -> tuple[float, ...]:
        return (self.radius,)

    def _volume(self) -> float:
        return 4 / 3 * pi * self.radius**3


@dataclass(frozen=True, kw_only=True)
class Cylinder(Object):
    """Cylinder of a radius and length [m] along its own z."""

    radius: Positive
    length: Positive

    def _sizes(self) -> tuple[float, ...]:
        return self.radius, self.length / 2

    def _volume(self) -> float:
        return pi * self.radius**2 * self.length


@dataclass(frozen=True, kw_only=True)
class Capsule(Cylinder):
    """Cylinder with half a ball on each end. MuJoCo finds its contacts in closed form."""

    @property
    def extent(self) -> float:
        """Its radius [m]."""
        return self.radius

    def _volume(self) -> float:
        return pi * self.radius**2 * (self.length + 4 / 3 * self.radius)


@dataclass(frozen=True, kw_only=True)
class Ellipsoid(Object):
    """Ellipsoid of semi-axes (3,) [m] along its own axes; one of them large: an oval cylinder."""

    semi_axes: tuple[Positive, Positive, Positive]

    def _sizes(self) -> tuple[float, ...]:
        return self.semi_axes

    def _volume(self) -> float:
        return 4 / 3 * pi * prod(self.semi_axes)


@dataclass(frozen=True, kw_only=True)
class Box(Object):
    """Box of a size (3,) [m] along its own axes."""

    size: tuple[Positive, Positive, Positive]
    has_faces: ClassVar[bool] = True

    def _sizes(self) -> tuple[float, ...]:
        return tuple(x / 2 for x in self.size)

    def _volume(self) -> float:
        return prod(self.size)


@dataclass(frozen=True, kw_only=True)
class Ground(Object):
    """Half-space below `position`, its surface across its own z."""

    rgba: Rgba = (0.8, 0.82, 0.85, 1.0)
    geom_type: ClassVar[str] = "mjGEOM_PLANE"
    has_faces: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.is_free:
            raise ValueError(f"ground {self.name!r} stands still: it has no mass or density")

    def _sizes(self) -> tuple[float, ...]:
        return 1.0, 1.0, 0.05  # as it is shown
