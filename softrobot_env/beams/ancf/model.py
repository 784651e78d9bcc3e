"""Beam in the absolute nodal coordinate formulation (thesis sec. 2.3; Shabana 2011)."""

from collections.abc import Sequence
from functools import cached_property
from math import ceil
from typing import Any
from warnings import warn

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load, refuse_out_of_plane, seen_from_base

from .. import mechanics
from ..actuation import Actuation, channel_samples
from ..model import BeamModel, in_pieces
from . import dynamics, section, shapes

#: Laws of a planar model.
PLANES = ("stress", "strain")
_LOCKED = 0.01  # stiffening from which on it is worth a warning
#: Integration along an element is exact: stress times strain has degree 8.
_POINTS = 5


class LockingWarning(UserWarning):
    """A model is too stiff because its elements cannot bend without stretching."""


class ANCF(BeamModel):
    """Elastic continuum beam: stretch, shear, bending, torsion and deformation of the sections.

    Coordinates come in blocks, one per node: r, r_,1, r_,2 (, r_,3), each with d components. For
    dimension 3 these are world (x, y, z), 12 per node; for dimension 2 world (x, z), 6 per node.
    X1 runs along the robot, X2 and X3 are world x and y in the straight pose.

    The St. Venant-Kirchhoff law couples the stretch of the fibres to the section, which can only
    deform uniformly in itself: with a Poisson ratio other than 0, bending is too stiff however
    fine the discretisation (Poisson locking).

    Few elements of a slender robot are too stiff as well (membrane locking). An element of length
    h that bends by the angle t keeps its ends and their slopes, and its cubic stretches by
    t^2 (x^2 - x + 1/6) / 2 in between, x = X1 / h, which a rod that only bends does not. With the
    area A and the second moment I of the section a moment then is EI k (1 + A h^4 k^2 / (360 I))
    at the curvature k: four times less with 1.4 times the elements. `locking` gives it, and
    `equilibrium` and `simulate` warn where it is more than a hundredth.
    """

    def __init__(
        self,
        robot: RobotParams,
        pieces: int | None = None,
        *,
        dimension: int = 3,
        plane: str = "stress",
        quadrature: str | int = "exact",
        clamped: bool = True,
        loads: Sequence[Load] = (),
        drive: str = "tension",
    ) -> None:
        """Model of a robot.

        Args:
            robot, pieces, loads, drive: As in `BeamModel`; the pieces are the elements.
            dimension: 3, or 2 for motion in the x-z plane.
            plane: Law of a planar model, "stress" or "strain".
            quadrature: Volume integrals of the stresses: "exact" with moments of the section in
                closed form; "chebyshev" with 5 x 3 x 3 points, exact too; or an order n for the
                thesis' n x n x n Gauss-Legendre rule (2.68). One factor less for dimension 2.
            clamped: Whether the first node is fixed; else the rod is free.

        Raises:
            ValueError: An option is not one of these, something acts across a planar model, or the
                robot has several or tapered sections, discs, or channels that are not straight.
        """
        robot.require_uniform("ANCF")
        winding = [t.name for t in robot.tendons if not (t.guides or t.is_straight)]
        if winding or robot.discs:
            what = f"channels that are not straight ({', '.join(winding)})" if winding else "discs"
            raise ValueError(
                f"robot {robot.name!r}: ANCF knows no {what}; take PCC, CosseratRod or the MuJoCo "
                "chain"
            )
        if dimension not in (2, 3):
            raise ValueError(f"dimension must be 2 or 3, got {dimension!r}")
        if plane not in PLANES:
            raise ValueError(f"unknown plane {plane!r}; choose from {', '.join(PLANES)}")
        order = isinstance(quadrature, int | np.integer) and quadrature >= 1
        if not order and quadrature not in ("exact", "chebyshev"):
            raise ValueError(
                f"quadrature must be 'exact', 'chebyshev' or an order from 1 on, got {quadrature!r}"
            )
        if not -1 < robot.poisson_ratio < 0.5:
            raise ValueError(
                f"the Poisson ratio must lie between -1 and 0.5, got {robot.poisson_ratio}"
            )
        if dimension == 2:
            seen = seen_from_base(robot, loads)
            refuse_out_of_plane(
                "ANCF of dimension 2", "dimension 3", seen, robot.own_gravity, robot.tendons
            )
        self.dimension, self.plane = int(dimension), plane
        self.quadrature = int(quadrature) if order else quadrature
        self.clamped = bool(clamped)
        super().__init__(robot, pieces, loads, drive)

    def _data(self, actuation: Actuation) -> dynamics.AncfData:
        robot, pieces, d = self.robot, self.pieces, self.dimension
        piece, block, fixed = robot.length / pieces, (d + 1) * d, int(self.clamped)
        straight = shapes.straight_vectors(d, piece, pieces)
        element, position = self._place(actuation.point_station)
        channels = channel_samples(robot, actuation, self.edges)
        entered, inside = self._place(channels.station)
        along, weight, moments = self._quadrature()
        mass = shapes.element_mass(robot, piece, d)
        whole, free = shapes.whole_mass(mass, d, pieces), slice(fixed * (d + 1), None)
        falling = np.zeros_like(straight)
        falling[:, 0] = np.array(robot.own_gravity)[list(shapes.AXES[d])]
        gravity = (whole @ falling.reshape(-1, d))[free]
        reach = actuation.reach(element + (position == 1), element + (position > 0))
        if actuation.by_length and len(actuation.straight):
            reach = pieces
        return dynamics.AncfData(
            n=block * (pieces + 1 - fixed),
            block=block,
            reach=max(1, reach),
            scale=np.tile([robot.length] * d + [1.0] * (d * d), pieces + 1 - fixed),
            actuation=actuation._replace(sampled=channels.tendon, sample_size=channels.size),
            axes=np.array(shapes.AXES[d]),
            pieces=pieces,
            piece=piece,
            clamp=straight[0].ravel() if self.clamped else np.empty(0),
            law=section.SectionLaw(*section.hooke(robot, None if d == 3 else self.plane), *moments),
            damping_time=robot.damping_time,
            position=along,
            weight=piece * weight,
            slope=shapes.Shapes(along, piece, d).hermite_slope,
            mass=mass,
            mass_factor=shapes.mass_factor(whole[free, free], d + 3),
            gravity=gravity.ravel(),
            straight=straight[fixed:].ravel(),
            element=element,
            points=shapes.Shapes(position, piece, d).points(actuation.point_offset),
            entered=entered,
            tangents=shapes.Shapes(inside, piece, d).tangents(channels.place),
        )

    def _place(self, stations: ndarray) -> tuple[ndarray, ndarray]:
        """Element (k,) and X1 / piece (k,) of stations (k,) [m]."""
        at = in_pieces(stations, self.edges)
        element = np.minimum(at.astype(int), self.pieces - 1)
        return element, at - element

    def _quadrature(self) -> tuple[ndarray, ndarray, section.Moments]:
        """Points and weights along an element of length 1, and moments of the section."""
        radii = self.robot.outer_radius, self.robot.inner_radius
        if self.quadrature == "exact":
            return *section.legendre(_POINTS), section.section_moments(*radii)
        if self.quadrature == "chebyshev":
            rule = section.chebyshev_rule(3, *radii)
            return *section.legendre(_POINTS), section.moments_by(rule)
        rule = section.legendre_rule(self.quadrature, *radii)
        return *section.legendre(self.quadrature), section.moments_by(rule)

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        return self.data.straight.copy()

    def curvature(self, q: ndarray) -> ndarray:
        """Curvature (pieces, 3) [1/m] about x, y, z of each element.

        The rotation between the sections at its ends, in the frame of the first one and divided
        by the length.
        """
        points, frames = np.empty((self.pieces + 1, 3)), np.empty((self.pieces + 1, 3, 3))
        mechanics.locate(self._nodes, self._vector(q), points, frames)
        turn = Rotation.from_matrix(frames[:-1].transpose(0, 2, 1) @ frames[1:])
        return turn.as_rotvec() / self.data.piece

    @cached_property
    def _nodes(self) -> Any:
        """Data of the model whose points are the nodes."""
        return self.probe(self.edges)

    def twist(self, q: ndarray) -> float:
        """Torsion angle [rad] from the first section to the last, the sum over the elements."""
        return float(self.data.piece * self.curvature(q)[:, 2].sum())

    def locking(self, q: ndarray) -> float:
        """Share [1] by which bending to q (n,) is too stiff: A h^4 k^2 / (360 I), k^2 the mean.

        An upper bound for `quadrature` 1 and 2, which leave out most of the stretch.
        """
        bending = self.curvature(q)[:, :2] ** 2
        slenderness = self.robot.area * self.data.piece**2 / self.robot.second_moment
        bend = self.data.piece**2 * float(bending.sum(axis=1).mean())
        return slenderness * bend / 360

    def warn_of(self, q: ndarray) -> None:
        """Warn that the elements lock in bending to q (n,), if they do."""
        share = self.locking(q)
        if share > _LOCKED:
            enough = ceil(self.pieces * (share / _LOCKED) ** 0.25)
            warn(
                f"ANCF with {self.pieces} elements locks on robot {self.robot.name!r}: it bends up "
                f"to {share:.1%} too stiffly; take {enough} or more elements, or PCC or "
                "CosseratRod, which do not lock",
                LockingWarning,
                stacklevel=3,
            )


mechanics.implement(dynamics.AncfData, dynamics)
