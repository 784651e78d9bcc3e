"""Tendons and their routes through a robot: straight, helical, converging, or by via-points."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import cos, hypot, inf, pi, sin
from typing import Annotated

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Key, Name, Unit, Vector2, check_fields

from .ranges import (
    BendAngle,
    Force,
    FrictionCoefficient,
    Group,
    Length,
    Place,
    Station,
    Stiffness,
    Tension,
    Turns,
)

#: Gauss points and weights [1] of a span between two via-points.
_NODES, _SHARES = (x / 2 for x in np.polynomial.legendre.leggauss(8))


@dataclass(frozen=True)
class FeedLine:
    """What a tendon runs through between its drive and the robot, such as a Bowden sheath.

    Its compliance is part of the tendon's `stiffness`, which covers everything between drive and
    robot.

    Attributes:
        bend_angle: [rad], total angle by which it bends, in any direction.
        friction_coefficient: [1], as of `Tendon`.
    """

    bend_angle: BendAngle
    friction_coefficient: FrictionCoefficient

    def __post_init__(self) -> None:
        check_fields(self, "feed line")

    @property
    def exponent(self) -> float:
        """Logarithm [1] of the ratio of tensions at its ends while it slides."""
        return self.friction_coefficient * self.bend_angle


@dataclass(frozen=True)
class Tendon:
    """A tendon at a distance from the neutral fibre, anchored at arc length `end`.

    Its position in the cross-section is `offset` at the base, and everywhere unless `route` or
    `turns` are given: between the points of a route the offset is linear in the arc length, as a
    tendon runs through drilled holes or from disc to disc (a spline would overshoot its points and
    could leave the body), and all of it turns about the fibre at a constant rate. In the straight
    robot the route without turns is a chain of straight lines, the one with turns alone a helix.

    Attributes:
        name: Unique name.
        offset: (2,) [m], position (x, y) of the tendon in the cross-section at the base.
        end: [m], arc length at which the tendon is anchored.
        group: Tendons of one group oppose each other (a pair, or three at 120 degrees).
        tension_limit: [N], largest tension; also the full scale of an action.
        guides: [m], increasing arc lengths of the guide discs between base and `end`.
            Empty means a continuous channel: the limit of infinitely many guides, with
            constant moment arm (the thesis' B(y) of sec. 6.2.2).
        stiffness: [N/m] between drive and robot; it only matters for tendons driven by length,
            which need a finite value.
        pretension: [N], smallest tension kept in the tendon.
        friction: [N], largest dry (Coulomb) friction between tendon and robot; it also
            acts on a slack tendon, as it represents other friction in the robot. At rest it is at
            most the tension where sections have `bending_friction`.
        friction_coefficient: [1], mu of friction proportional to the force with which the tendon
            presses on its channel or guides: sliding around an angle a changes its tension by
            exp(-mu a).
        feed_line: Between drive and robot; without one there is no friction there.
        route: Via-points (s, x, y) [m] after the base: arc length and position in the
            cross-section, the last one at `end`. Guides need no via-points.
        turns: Full turns [1] about the fibre from the base to `end`, from +x towards +y.
    """

    name: Name
    offset: Annotated[tuple[Place, Place], Unit("m")]
    end: Length
    group: Group
    tension_limit: Tension
    guides: Annotated[tuple[Station, ...], Unit("m")] = ()
    stiffness: Stiffness = inf
    pretension: Force = 0.0
    friction: Force = 0.0
    route: Annotated[tuple[tuple[Station, Place, Place], ...], Unit("m")] = ()
    turns: Annotated[Turns, Key("helix_turns")] = 0.0
    friction_coefficient: FrictionCoefficient = 0.0
    feed_line: FeedLine | None = None

    def __post_init__(self) -> None:
        check_fields(self, f"tendon {self.name!r}")
        if not self.pretension < self.tension_limit:
            raise ValueError(
                f"tendon {self.name!r}: need pretension < tension_limit, got {self.pretension} and "
                f"{self.tension_limit} N"
            )
        if any(b <= a for a, b in pairwise(self.stations)):
            raise ValueError(
                f"tendon {self.name!r}: guides must increase strictly between 0 and end, "
                f"got guides {self.guides} and end {self.end} m"
            )
        via = (0.0, *(point[0] for point in self.route))
        off = abs(via[-1] - self.end) > 1e-9 * self.end
        if self.route and (off or any(b <= a for a, b in pairwise(via))):
            raise ValueError(
                f"tendon {self.name!r}: the stations of its route must increase strictly from "
                f"beyond 0 to its end at {self.end} m, got {', '.join(map(str, via[1:]))}"
            )

    @property
    def has_capstan_friction(self) -> bool:
        """Whether friction grows with its tension, in the robot or in the feed line."""
        return self.friction_coefficient > 0 or bool(self.feed_line and self.feed_line.exponent)

    @property
    def stations(self) -> tuple[float, ...]:
        """[m] of base, guides and end."""
        return (0.0, *self.guides, self.end)

    @cached_property
    def knots(self) -> ndarray:
        """(k, 3) [m]: arc length and position before turning, which is linear in between."""
        first = (0.0, *self.offset)
        return np.array([first, *(self.route or ((self.end, *self.offset),))], float)

    @cached_property
    def is_straight(self) -> bool:
        """Whether it has the same place in all cross-sections."""
        return self.turns == 0 and all(point[1:] == self.offset for point in self.route)

    @property
    def leaves_plane(self) -> bool:
        """Whether it lies outside the x-z plane of the straight robot anywhere."""
        return bool(self.knots[:, 2].any() or (self.turns and self.farthest))

    @property
    def twists(self) -> bool:
        """Whether its pull has a moment about the fibre in the straight robot."""
        if self.is_straight:
            return False
        if self.guides:
            at = self.at(np.array(self.stations))
        elif self.turns:
            return bool(np.any(self.knots[:, 1:]))
        else:
            at = self.knots[:, 1:]
        area = at[:-1, 0] * at[1:, 1] - at[:-1, 1] * at[1:, 0]
        return bool(np.any(np.abs(area) > 1e-12 * max(self.farthest**2, 1e-300)))

    @property
    def farthest(self) -> float:
        """Largest distance [m] from the fibre."""
        return float(np.hypot(*self.knots[:, 1:].T).max())

    def at(self, s: ndarray) -> ndarray:
        """Position (..., 2) [m] in the cross-section at arc lengths (...,) [m]."""
        return self.course(s)[0]

    def slope(self, s: ndarray) -> ndarray:
        """Its derivative (..., 2) [1] by the arc length; at a via-point that towards the tip."""
        return self.course(s)[1]

    def course(self, s: ndarray) -> tuple[ndarray, ndarray]:
        """Both of these."""
        s, knots = np.asarray(s, float), self.knots
        if self.is_straight:
            place = np.empty((*s.shape, 2))
            place[...] = self.offset
            return place, np.zeros((*s.shape, 2))
        low = np.clip(np.searchsorted(knots[:, 0], s, side="right") - 1, 0, len(knots) - 2)
        change = (knots[low + 1, 1:] - knots[low, 1:]) / np.diff(knots[:, 0])[low][..., None]
        place = knots[low, 1:] + change * (s - knots[low, 0])[..., None]
        return self.wound(s, place, change)

    def wound(self, s: ndarray, place: ndarray, change: ndarray) -> tuple[ndarray, ndarray]:
        """Places and slopes (..., 2) of the route at arc lengths (...,) [m] with its turns."""
        if not self.turns:
            return place, change
        rate = 2 * pi * self.turns / self.end
        c, q = np.cos(rate * s), np.sin(rate * s)
        change = change + rate * np.stack([-place[..., 1], place[..., 0]], axis=-1)
        return _turned(place, c, q), _turned(change, c, q)

    def fine(self, edges: ndarray) -> tuple[ndarray, ndarray]:
        """Gauss points and weights (k, n) [m] for integrals between edges (k + 1,) [m].

        Via-points have to be among the edges.
        """
        size = np.diff(edges)[:, None]
        return edges[:-1, None] + size * (0.5 + _NODES), size * _SHARES

    @property
    def straight_length(self) -> float:
        """[m], inside the straight robot: through its guides, or along its channel."""
        if self.is_straight:
            return self.end
        if self.guides:
            points = np.column_stack([self.at(np.array(self.stations)), self.stations])
            return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        s, weight = self.fine(self.knots[:, 0])
        return float(np.sum(weight * np.sqrt(1 + np.sum(self.slope(s) ** 2, axis=-1))))

    def vary(self, radius: float, friction: float, coefficient: float) -> "Tendon":
        """The tendon at `radius` [1] times its distance from the fibre, rubbing more [N, 1]."""
        return replace(
            self._mapped(radius, 0.0),
            friction=self.friction + friction,
            friction_coefficient=self.friction_coefficient + coefficient,
        )

    def turned(self, angle: float, scale: float = 1.0, name: str | None = None) -> "Tendon":
        """The tendon turned about the fibre by `angle` [rad], `scale` [1] times as far from it.

        Quarter turns are exact; the turned tendon may have another name.
        """
        # Pi is rounded: what is left of a cosine or sine that vanishes would leave the plane.
        c, s = (x if abs(x) > 1e-15 else 0.0 for x in (cos(angle), sin(angle)))
        turned = self._mapped(scale * c, scale * s)
        return turned if name is None else replace(turned, name=name)

    def _mapped(self, c: float, s: float) -> "Tendon":
        """The tendon with all its places (x, y) at (c x - s y, s x + c y)."""

        def moved(x: float, y: float) -> Vector2:
            return (x * c - y * s, x * s + y * c) if s else (x * c, y * c)

        route = tuple((station, *moved(x, y)) for station, x, y in self.route)
        return replace(self, offset=moved(*self.offset), route=route)

    def mean_square(self) -> float:
        """Mean over its length of the squared distance [m2] from the fibre."""
        if self.is_straight:
            return hypot(*self.offset) ** 2
        s, weight = self.fine(self.knots[:, 0])
        return float(np.sum(weight * np.sum(self.at(s) ** 2, axis=-1))) / self.end


def _turned(xy: ndarray, c: ndarray, s: ndarray) -> ndarray:
    """Vectors (..., 2) turned by angles with cosines and sines (...,)."""
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)
