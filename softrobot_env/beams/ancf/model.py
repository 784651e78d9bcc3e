"""Beam in the absolute nodal coordinate formulation (thesis sec. 2.3; Shabana 2011)."""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from warnings import warn

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load, refuse_out_of_plane, seen_from_base

from .. import mechanics
from ..actuation import Actuation
from ..model import BeamModel
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
        bending, director = shapes.element_mass(robot, piece)
        element, position = shapes.places(actuation.point_station, piece, pieces)
        along, weight, points, weights = self._quadrature()
        slopes = shapes.hermite_slopes(along, piece)
        modulus = section.hooke(robot, None if d == 3 else self.plane)
        moments = section.section_moments(robot.outer_radius, robot.inner_radius)
        return dynamics.AncfData(
            n=block * (pieces + 1 - fixed),
            block=block,
            reach=self._reach(actuation, element, position),
            scale=np.tile([robot.length] * d + [1.0] * (d * d), pieces + 1 - fixed),
            actuation=actuation,
            axes=np.array(shapes.AXES[d]),
            pieces=pieces,
            piece=piece,
            clamp=straight[0].ravel() if self.clamped else np.empty(0),
            law=section.SectionLaw(*modulus, tuple(moments), points, weights),
            damping_time=robot.damping_time,
            points=dynamics.ElementPoints(piece, along, piece * weight, slopes),
            mass_bending=bending,
            mass_director=director,
            bending_factor=shapes.mass_factor(bending, 2, pieces, fixed),
            director_factor=shapes.mass_factor(director, 1, pieces, fixed),
            gravity=shapes.gravity_force(robot, bending, d, pieces)[fixed:].ravel(),
            straight=straight[fixed:].ravel(),
            point_element=element,
            point_position=position,
            point_shape=shapes.point_shapes(position, piece, actuation.point_offset, d),
            **shapes.channel_rules(actuation, piece, pieces),
        )

    def _quadrature(self) -> tuple[ndarray, ...]:
        """Points and weights along an element of length 1, and those of the section."""
        d = self.dimension
        ring = (self.robot.outer_radius, self.robot.inner_radius, d == 2)
        if self.quadrature == "exact":
            return *section.legendre(_POINTS), np.empty((0, d)), np.empty(0)
        if self.quadrature == "chebyshev":
            along, rule = section.legendre(_POINTS), section.chebyshev_rule(3, *ring)
        else:
            along = section.legendre(self.quadrature)
            rule = section.legendre_rule(self.quadrature, *ring)
        one = np.ones(len(rule.weights))
        return *along, np.column_stack([one, rule.points])[:, :d].copy(), rule.weights

    def _reach(self, actuation: Actuation, element: ndarray, position: ndarray) -> int:
        """Distance in nodes over which equations depend on coordinates."""
        if actuation.by_length and len(actuation.guided):
            return self.pieces
        reach = 1
        for start, end in pairwise(actuation.first):
            for a, b in pairwise(range(start, end)):
                first = element[a] + (position[a] == 1)
                last = element[b] + (position[b] > 0)
                reach = max(reach, int(last - first))
        return reach

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        return self.data.straight.copy()

    def curvature(self, q: ndarray) -> ndarray:
        """Curvature (pieces, 3) [1/m] about x, y, z of each element.

        The rotation between the sections at its ends, in the frame of the first one and divided
        by the length.
        """
        frames = self._frames(q)
        turn = Rotation.from_matrix(frames[:-1].transpose(0, 2, 1) @ frames[1:])
        return turn.as_rotvec() / self.data.piece

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

    def _frames(self, q: ndarray) -> ndarray:
        """Orientations (pieces + 1, 3, 3) of the sections at the nodes, as `load_axes`."""
        d, nodes = self.dimension, self.pieces + 1
        vectors = np.concatenate([self.data.clamp, q]).reshape(nodes, d + 1, d)
        directors = np.zeros((2, nodes, 3))
        directors[1, :, 1] = 1  # of a planar model
        for k in range(d - 1):
            directors[k][:, list(shapes.AXES[d])] = vectors[:, k + 2]
        normal = np.cross(directors[0], directors[1])
        x = directors[0] / np.linalg.norm(directors[0], axis=1, keepdims=True)
        z = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return np.stack([x, np.cross(z, x), z], axis=2)


mechanics.implement(dynamics.AncfData, dynamics)
