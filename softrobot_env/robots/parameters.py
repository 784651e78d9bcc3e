"""A robot as data: geometry, material, tendons and what it carries.

Frame: the straight robot lies along +z from its clamp at the origin; x and y are lateral.
A planar robot bends in the x-z plane only and positive curvature bends it towards +x.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, hypot, inf, pi, sin, sqrt
from numbers import Real
from typing import Annotated

import numpy as np

from softrobot_env.fields import NotNegative, Positive, Range, check_fields, check_unique

#: What `RobotParams.vary` varies, with the values that change nothing: factors [1] on parameters of
#: the robot, and a friction [N].
NEUTRAL: dict[str, float] = {
    "youngs_modulus": 1.0,
    "density": 1.0,
    "damping_time": 1.0,
    "tendon_radius": 1.0,
    "tendon_friction": 0.0,
}
VARIABLE = tuple(NEUTRAL)

#: Largest of them, and one over the smallest where none may be zero.
_MOST = 1e6

#: Those that may be zero.
MAY_VANISH = ("damping_time", "tendon_friction")

#: Smallest positive root of cos(x) cosh(x) = -1: first mode of a clamped-free beam.
_CLAMPED_FREE_ROOT = 1.8751040687119611

#: Of an isotropic material, by thermodynamics, [1].
_PoissonRatio = Annotated[float, Range("in (-1, 0.5]", lambda nu: -1 < nu <= 0.5)]


#: Number of pieces of a robot or scene; the most are far more than memory serves.
Pieces = Annotated[int, Range("a whole number from 1 to 10000", lambda n: 1 <= n <= 10_000)]


@dataclass(frozen=True)
class Tendon:
    """A tendon at a constant offset from the neutral fibre, anchored at arc length `end`.

    Attributes:
        name: Unique name.
        offset: (2,) [m], position (x, y) of the tendon in the cross-section.
        end: [m], arc length at which the tendon is anchored.
        group: Tendons of one group oppose each other (a pair, or three at 120 degrees).
        tension_limit: [N], largest tension; also the full scale of an action.
        guides: [m], increasing arc lengths of the guide discs between base and `end`.
            Empty means a continuous channel: the limit of infinitely many guides, with
            constant lever arm (the thesis' B(y) of sec. 6.2.2).
        stiffness: [N/m] between drive and robot; it matters only to tendons driven by length,
            which need a finite one.
        pretension: [N], smallest tension kept in the tendon.
        friction: [N], largest dry (Coulomb) friction between tendon and robot; of a slack tendon
            as well.
    """

    name: str
    offset: tuple[float, float]
    end: Positive
    group: int
    tension_limit: Positive
    guides: tuple[float, ...] = ()
    stiffness: Annotated[float, Range("positive, or inf", lambda x: x > 0)] = inf
    pretension: float = 0.0
    friction: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self, f"tendon {self.name!r}")
        if not self.tension_limit > self.pretension >= 0:
            raise ValueError(
                f"tendon {self.name!r}: need 0 <= pretension < tension_limit, got "
                f"{self.pretension} and {self.tension_limit} N"
            )
        stations = (0.0, *self.guides, self.end)
        if any(b <= a for a, b in pairwise(stations)):
            raise ValueError(
                f"tendon {self.name!r}: guides must increase strictly between 0 and end, "
                f"got guides {self.guides} and end {self.end} m"
            )

    def vary(self, radius: float, friction: float) -> "Tendon":
        """The tendon at `radius` [1] times its distance from the fibre, rubbing more [N]."""
        offset = tuple(radius * x for x in self.offset)
        return replace(self, offset=offset, friction=self.friction + friction)

    def turned(self, angle: float, scale: float = 1.0) -> "Tendon":
        """The tendon turned about the fibre by `angle` [rad], `scale` [1] times as far from it."""
        x, y = self.offset
        c, s = scale * cos(angle), scale * sin(angle)
        return replace(self, offset=(x * c - y * s, x * s + y * c))


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

    mass: Positive
    centre: NotNegative
    inertia: tuple[Positive, Positive, Positive]
    output: NotNegative

    def __post_init__(self) -> None:
        check_fields(self, "head")
        if 2 * max(self.inertia) > sum(self.inertia) * (1 + 1e-9):
            raise ValueError(
                "head: no body has a moment of inertia above the sum of the other two, got "
                f"{self.inertia} kg m2"
            )


@dataclass(frozen=True)
class RobotParams:
    """A soft robot as a uniform circular beam with tendons; SI units.

    Attributes:
        name: Key in `ROBOTS`.
        length: [m] of the flexible backbone.
        outer_radius, inner_radius: [m] of the ring cross-section (inner 0: solid).
        youngs_modulus: [Pa].
        density: [kg/m3].
        damping_time: mu [s] of stiffness-proportional damping D = mu K; 0 is undamped.
        pieces: Number of equal pieces of the thesis' discretisation; curvature is
            reported per piece.
        poisson_ratio: [1], in (-1, 0.5].
        tendons: Tendons, ordered by group.
        gravity: (3,) [m/s2].
        head: Rigid body on the tip, if any.
        anisotropy: Difference of the bending stiffnesses [1]: it is EI (1 + anisotropy / 2) towards
            `stiff_azimuth` and EI (1 - anisotropy / 2) across.
        stiff_azimuth: [rad] from +x towards +y.
        precurvature: (2,) [1/m] towards +x and +y, of the robot when nothing acts on it.
    """

    name: str
    length: Positive
    outer_radius: Positive
    inner_radius: NotNegative
    youngs_modulus: Positive
    density: Positive
    damping_time: NotNegative
    pieces: Pieces
    poisson_ratio: _PoissonRatio = 0.0
    tendons: tuple[Tendon, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    head: Head | None = None
    anisotropy: Annotated[float, Range("in [0, 2)", lambda x: 0 <= x < 2)] = 0.0
    stiff_azimuth: float = 0.0
    precurvature: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_fields(self, f"robot {self.name!r}")
        check_unique([t.name for t in self.tendons], f"robot {self.name!r}: tendons")
        if not self.inner_radius < self.outer_radius:
            raise ValueError(f"robot {self.name!r}: need 0 <= inner_radius < outer_radius")
        for name in ("mass", "bending_stiffness"):
            if not 0 < _or_infinite(self, name) < inf:
                raise ValueError(
                    f"robot {self.name!r}: its {name} would be {_or_infinite(self, name):g} in "
                    "floating point: give sizes and material of a real robot"
                )
        if any(t.end > self.length * (1 + 1e-12) for t in self.tendons):
            raise ValueError(f"robot {self.name!r}: a tendon ends beyond the robot's length")
        if not hypot(*self.precurvature) < self.curvature_limit:
            raise ValueError(
                f"robot {self.name!r}: precurvature must stay below {self.curvature_limit:g} 1/m"
            )

    @property
    def area(self) -> float:
        """Cross-section area A [m2]."""
        return pi * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def second_moment(self) -> float:
        """Second moment of area I about a lateral axis [m4]."""
        return pi / 4 * (self.outer_radius**4 - self.inner_radius**4)

    @property
    def bending_stiffness(self) -> float:
        """EI [N m2]."""
        return self.youngs_modulus * self.second_moment

    @property
    def torsional_stiffness(self) -> float:
        """GJ [N m2]; for a circular section J = 2 I."""
        return self.bending_stiffness / (1 + self.poisson_ratio)

    @property
    def mass_per_length(self) -> float:
        """Rho A [kg/m]."""
        return self.density * self.area

    @property
    def mass(self) -> float:
        """Mass of the backbone [kg]."""
        return self.mass_per_length * self.length

    @property
    def first_frequency(self) -> float:
        """First undamped bending frequency [Hz] of the Euler-Bernoulli beam, (2.75)."""
        wave = (_CLAMPED_FREE_ROOT / self.length) ** 2
        return wave * sqrt(self.bending_stiffness / self.mass_per_length) / (2 * pi)

    @property
    def reach(self) -> float:
        """Distance [m] of the tip from the base when straight; with a head, of its output point."""
        return self.length if self.head is None else self.length + self.head.output

    @property
    def principal_stiffnesses(self) -> tuple[float, float]:
        """Bending stiffnesses [N m2] towards `stiff_azimuth` and across."""
        half = self.anisotropy / 2
        return self.bending_stiffness * (1 + half), self.bending_stiffness * (1 - half)

    @property
    def is_symmetric(self) -> bool:
        """Whether it is straight and bends alike to all sides."""
        return self.anisotropy == 0 and not any(self.precurvature)

    @property
    def rubs(self) -> bool:
        """Whether any tendon has dry friction."""
        return any(tendon.friction > 0 for tendon in self.tendons)

    @property
    def curvature_limit(self) -> float:
        """Curvature [1/m] at which the inner side of the bend would fold: 1 / outer_radius."""
        return 1 / self.outer_radius

    def vary(self, **scales: float) -> "RobotParams":
        """The same robot with some parameters multiplied by factors, and with tendon friction.

        Args:
            **scales: Value by name, one of `VARIABLE`: `tendon_friction` [N] adds to the dry
                friction of every tendon, the others are factors [1]. A varied Young's modulus
                keeps the damping time mu, hence scales D with K (sec. 6.6.3). The tendon radius
                is the distance of all tendons from the neutral fibre.

        Raises:
            ValueError: Unknown name, or a value that is not finite and positive; only friction and
                damping time may vanish.
        """
        for name, scale in scales.items():
            if name not in VARIABLE:
                raise ValueError(f"cannot vary {name!r}; choose from {', '.join(VARIABLE)}")
            check_number(name, scale, name in MAY_VANISH)
        values = {name: float(scale) for name, scale in scales.items()}
        radius = values.pop("tendon_radius", NEUTRAL["tendon_radius"])
        friction = values.pop("tendon_friction", NEUTRAL["tendon_friction"])
        return replace(
            self,
            tendons=tuple(tendon.vary(radius, friction) for tendon in self.tendons),
            **{name: getattr(self, name) * factor for name, factor in values.items()},
        )


def _or_infinite(robot: RobotParams, name: str) -> float:
    """A property of the robot, inf where it is too large for a float."""
    try:
        return getattr(robot, name)
    except OverflowError:
        return inf


def check_number(name: str, value: object, may_vanish: bool) -> None:
    """Raise ValueError unless a value is within 1e-6 and 1e6, or from zero where it may vanish."""
    number = as_number(value)
    if number is None or not (0 < number < inf or (may_vanish and number == 0)):
        least = "zero or more" if may_vanish else "positive"
        raise ValueError(f"value of {name!r} must be finite and {least}, got {value!r}")
    if number > _MOST or (number < 1 / _MOST and not may_vanish):
        raise ValueError(f"value of {name!r} must lie in {1 / _MOST:g} to {_MOST:g}, got {value!r}")


def as_number(value: object) -> float | None:
    """The value as a float, None if it is no number (nor text, nor a truth value)."""
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else None


def centerline(robot: RobotParams, curvature: np.ndarray, points: int = 10) -> np.ndarray:
    """Shape of a planar robot made of equal constant-curvature pieces.

    Args:
        robot: The robot; only its length is used.
        curvature: (n_pieces,) [1/m] from the base to the tip.
        points: Number of points per piece after its start.

    Returns:
        (1 + points * n_pieces, 3) [m], starting at the base.
    """
    curvature = np.asarray(curvature, dtype=float)
    piece = robot.length / len(curvature)
    # Half-angle form of an arc's chord: exact, and smooth where the curvature vanishes.
    half = np.repeat(curvature, points) * piece / points / 2
    tangent = np.concatenate(([0.0], np.cumsum(2 * half)))[:-1] + half
    chord = piece / points * np.sinc(half / pi)
    steps = np.stack([np.sin(tangent), np.zeros_like(tangent), np.cos(tangent)], axis=1)
    return np.concatenate((np.zeros((1, 3)), np.cumsum(chord[:, None] * steps, axis=0)))
