"""Sections of a backbone in series, and its geometry and stiffness as functions of arc length."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Annotated

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Unit, Vector2, check_fields

from .ranges import (
    THINNEST,
    Bore,
    DampingTime,
    Density,
    Length,
    Modulus,
    Moment,
    Pieces,
    PoissonRatio,
    Radius,
)

#: A function of arc lengths (k,) [m] with values (k,), or many of them, (..., k).
OfStation = Callable[[ndarray], ndarray]

#: Of Gauss: the squares and fourth powers of linear radii, times squares of the place, are exact.
_POINTS = 8
_NODES, _SHARES = (x / 2 for x in np.polynomial.legendre.leggauss(_POINTS))


@dataclass(frozen=True)
class Section:
    """A part of a backbone: a straight ring cross-section of one material, or one that tapers.

    Attributes:
        length: [m].
        outer_radius: [m], one value, or those at its base and tip: linear in between.
        youngs_modulus: [Pa].
        density: [kg/m3].
        damping_time: mu [s] of stiffness-proportional damping D = mu K; 0 is undamped.
        pieces: Number of equal pieces it is cut into.
        inner_radius: [m], as the outer one; 0 is solid.
        poisson_ratio: [1], in (-1, 0.5].
        bending_friction: [N m], largest moment by which dry friction of the backbone resists a
            change of its curvature: hysteresis of a superelastic wire, or friction of a wire in
            its discs. It keeps a released robot bent. In motion MuJoCo applies it about each
            hinge axis, so that it is up to 1.4 times as large in directions between them.
    """

    length: Length
    outer_radius: Annotated[Radius | tuple[Radius, Radius], Unit("m")]
    youngs_modulus: Modulus
    density: Density
    damping_time: DampingTime
    pieces: Pieces
    inner_radius: Annotated[Bore | tuple[Bore, Bore], Unit("m")] = 0.0
    poisson_ratio: PoissonRatio = 0.0
    bending_friction: Moment = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "section")
        for inner, outer in zip(self.inner_radii, self.outer_radii, strict=True):
            if not inner <= (1 - THINNEST) * outer:
                raise ValueError("section: need 0 <= inner_radius < outer_radius at base and tip")

    @property
    def outer_radii(self) -> Vector2:
        """[m] at base and tip."""
        return _pair(self.outer_radius)

    @property
    def inner_radii(self) -> Vector2:
        """[m] at base and tip."""
        return _pair(self.inner_radius)

    @property
    def is_uniform(self) -> bool:
        """Whether it has the same cross-section everywhere."""
        return len({*self.outer_radii}) == 1 and len({*self.inner_radii}) == 1

    def vary(self, **factors: float) -> "Section":
        """The section with some of its numbers multiplied by factors [1]."""
        return replace(self, **{name: getattr(self, name) * x for name, x in factors.items()})


def _pair(radius: float | Vector2) -> Vector2:
    return radius if isinstance(radius, tuple) else (radius, radius)


class Backbone:
    """Sections in series. Functions of arc lengths s (k,) [m] give (k,) values.

    Where two sections meet, they are those of the one nearer to the base.

    Attributes:
        sections: The sections, from the base to the tip.
        ends: (n + 1,) [m], where they start and end.
    """

    def __init__(self, sections: Sequence[Section]) -> None:
        self.sections = tuple(sections)
        self.ends = np.concatenate(([0.0], np.cumsum([x.length for x in self.sections])))

    @cached_property
    def _numbers(self) -> dict[str, ndarray]:
        """(n,) by name, radii (n, 2)."""
        names = ("youngs_modulus", "density", "damping_time", "poisson_ratio")
        names += ("outer_radii", "inner_radii")
        return {n: np.array([getattr(x, n) for x in self.sections], float) for n in names}

    @cached_property
    def _tapers(self) -> bool:
        return not all(section.is_uniform for section in self.sections)

    def index(self, s: ndarray) -> ndarray:
        """Number (k,) of the section at s."""
        return np.searchsorted(self.ends[1:-1], s, side="left")

    def tapers(self, s: ndarray) -> ndarray:
        """Whether (k,) the section at s tapers."""
        return np.array([not x.is_uniform for x in self.sections])[self.index(s)]

    def _of_material(self, name: str, s: ndarray) -> ndarray:
        return self._numbers[name][self.index(s)]

    def _radius(self, name: str, s: ndarray) -> ndarray:
        index, radii = self.index(s), self._numbers[name]
        first, last = radii[index].T
        if not self._tapers:
            return first
        share = (s - self.ends[index]) / (self.ends[index + 1] - self.ends[index])
        return first + (last - first) * share

    def outer_radius(self, s: ndarray) -> ndarray:
        """[m]"""
        return self._radius("outer_radii", s)

    def inner_radius(self, s: ndarray) -> ndarray:
        """[m]"""
        return self._radius("inner_radii", s)

    @property
    def widest(self) -> float:
        """Largest outer radius [m]."""
        return float(self._numbers["outer_radii"].max())

    def area(self, s: ndarray) -> ndarray:
        """Cross-section area A [m2]."""
        return pi * (self.outer_radius(s) ** 2 - self.inner_radius(s) ** 2)

    def second_moment(self, s: ndarray) -> ndarray:
        """Second moment of area I about a lateral axis [m4]."""
        return pi / 4 * (self.outer_radius(s) ** 4 - self.inner_radius(s) ** 4)

    def bending(self, s: ndarray) -> ndarray:
        """EI [N m2]."""
        return self._of_material("youngs_modulus", s) * self.second_moment(s)

    def torsion(self, s: ndarray) -> ndarray:
        """GJ [N m2], J = 2 I."""
        return self.bending(s) / (1 + self._of_material("poisson_ratio", s))

    def axial(self, s: ndarray) -> ndarray:
        """EA [N]."""
        return self._of_material("youngs_modulus", s) * self.area(s)

    def shear(self, s: ndarray) -> ndarray:
        """GA [N]."""
        return self.axial(s) / (2 * (1 + self._of_material("poisson_ratio", s)))

    def mass(self, s: ndarray) -> ndarray:
        """Rho A [kg/m]."""
        return self._of_material("density", s) * self.area(s)

    def rotary(self, s: ndarray) -> ndarray:
        """Rho I [kg m]."""
        return self._of_material("density", s) * self.second_moment(s)

    def damping_time(self, s: ndarray) -> ndarray:
        """Mu [s]."""
        return self._of_material("damping_time", s)

    def integrals(self, of: OfStation, edges: ndarray) -> ndarray:
        """Integrals (..., k) of a function between consecutive edges (k + 1,) [m], increasing.

        By Gauss points between all edges and ends of sections, which it may jump at. The function
        may have many values, (..., n) at n places.
        """
        inside = self.ends[1:-1]
        cuts = edges
        if len(inside):
            cuts = np.union1d(edges, inside[(inside > edges[0]) & (inside < edges[-1])])
        sizes = cuts[1:] - cuts[:-1]
        s = (cuts[:-1] + sizes / 2)[:, None] + sizes[:, None] * _NODES
        values = of(s.ravel())
        parts = sizes * (values.reshape(*values.shape[:-1], *s.shape) @ _SHARES)
        if len(cuts) == len(edges):
            return parts
        return np.add.reduceat(parts, np.searchsorted(cuts, edges[:-1]), axis=-1)

    def in_series(self, stiffness: OfStation, edges: ndarray) -> ndarray:
        """Stiffness (k,) of uniform pieces between edges that yield as much as the backbone.

        Under the same force or moment everywhere: the size over the integral of 1 / stiffness.
        """
        return np.diff(edges) / self.integrals(lambda s: 1 / stiffness(s), edges)

    def damping(self, stiffness: OfStation, edges: ndarray) -> ndarray:
        """Damping time (k,) [s] of such pieces, from the power lost in them."""
        if len({x.damping_time for x in self.sections}) == 1:
            return np.full(len(edges) - 1, float(self.sections[0].damping_time))
        lost = self.integrals(lambda s: self.damping_time(s) / stiffness(s), edges)
        return lost / self.integrals(lambda s: 1 / stiffness(s), edges)

    def cut(self, pieces: int | Sequence[int]) -> ndarray:
        """Ends (n + 1,) [m] of pieces: equal ones in each section, whose ends are piece ends.

        Args:
            pieces: In total, shared out by length with one or more a section, or of each section.

        Raises:
            ValueError: Fewer pieces than sections, or not as many numbers as sections.
        """
        counts = self._counts(pieces)
        parts = [
            start + (end - start) / n * np.arange(n)
            for start, end, n in zip(self.ends[:-1], self.ends[1:], counts, strict=True)
        ]
        return np.concatenate([*parts, self.ends[-1:]])

    def _counts(self, pieces: int | Sequence[int]) -> list[int]:
        n = len(self.sections)
        if isinstance(pieces, Sequence):
            if len(pieces) != n:
                raise ValueError(f"need pieces of {n} sections, got {tuple(pieces)}")
            return list(pieces)
        if pieces < n:
            raise ValueError(f"need a piece for each of {n} sections, got {pieces}")
        own = [x.pieces for x in self.sections]
        if pieces % sum(own) == 0:
            return [pieces // sum(own) * x for x in own]
        counts = [1] * n
        lengths = np.diff(self.ends)
        for _ in range(pieces - n):  # to the section with the longest pieces
            counts[int(np.argmax(lengths / counts))] += 1
        return counts
