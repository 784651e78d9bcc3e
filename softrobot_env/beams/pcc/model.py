"""Piecewise constant curvature (PCC) model of ch. 2.1 of the thesis."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import reference, structure
from softrobot_env.core.registry import Registry
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load, refuse_out_of_plane, refuse_torsion, seen_from_base

from .. import mechanics
from ..actuation import Actuation, channel_samples
from ..model import BeamModel, in_pieces
from . import dynamics

#: Number of coordinates per piece by the choice of `axes`.
AXES = Registry("axes", {"planar": 1, "spatial": 2, "torsion": 3})
#: Named distributions of the inertia.
INERTIAS = ("lumped", "distributed")
#: Arc length [m], mass [kg] and moments of inertia (xx, yy, zz) [kg m2] of a rigid body.
Station = tuple[float, float, tuple[float, float, float]]

_GAUSS_POINTS = 4
#: Smallest ratio of the mass matrix' eigenvalues, in units of which a coordinate has inertia.
_SINGULAR = 1e-12


@structure
class PccData(NamedTuple):
    """Data of the kernels; coordinates are blocks (beta, gamma, tau) [1/m] of the pieces.

    Attributes:
        n, block, reach, scale, actuation: As in `mechanics`.
        pieces: Number of pieces.
        length: (pieces,) [m].
        bending, twisting: (pieces,) [N m3], l EI and l GJ.
        damping_time: (pieces,) [s].
        gravity: (3,) [m/s2].
        first: (2, pieces + 1) first body and first point of a piece.
        bodies: (k, 5) place within the piece (0 to 1), mass [kg] and principal moments of
            inertia [kg m2] of the bodies, ordered by piece. The last of each piece is at its end.
        points: (n_points, 4) place within the piece, that in the cross-section [m] and number of
            the points of the actuation, ordered by piece.
        first_sample: (pieces + 1,) first sample of a piece.
        places: (n_samples, 4) place in the cross-section [m] of a channel, and its slope [1].
    """

    n: int
    block: int
    reach: int
    scale: ndarray
    actuation: Actuation
    pieces: int
    length: ndarray
    bending: ndarray
    twisting: ndarray
    damping_time: ndarray
    gravity: ndarray
    first: ndarray
    bodies: ndarray
    points: ndarray
    first_sample: ndarray
    places: ndarray


class PCC(BeamModel):
    """Pieces of constant curvature without shear and extension.

    Coordinates are the curvatures beta (bending towards +x) and gamma (towards +y) and the
    torsion tau of the pieces [1/m], piece by piece. In pieces without torsion this is the model
    of thesis (2.4) to (2.15), with the audit's corrections and without its singularity; pieces
    with torsion are exact helices. The elastic moments are EI (beta + mu beta'), likewise gamma,
    and GJ (tau + mu tau'); a tapered piece has the stiffness by which a constant moment bends it
    as much. Along channels of any route the integrals over a piece are taken by Gauss points.

    Args:
        robot, pieces, loads, drive: As in `BeamModel`.
        axes: "planar" (beta), "spatial" (beta and gamma) or "torsion" (beta, gamma and tau).
        inertia: "lumped" (discs at the ends of the pieces by the trapezoidal rule, so the last
            has half a piece's mass: audit), "distributed" (the integrals over the pieces, by
            Gauss quadrature), or rigid bodies at given arc lengths, such as the subpieces of
            thesis sec. 5.2, which replace the mass of the backbone.

    Raises:
        ValueError: An unknown option, something acts in a direction that the axes lack, or rigid
            bodies are off the robot, of negative inertia, or too few to give every coordinate
            inertia.
    """

    def __init__(
        self,
        robot: RobotParams,
        pieces: int | None = None,
        *,
        axes: str = "spatial",
        inertia: str | Sequence[Station] = "lumped",
        loads: Sequence[Load] = (),
        drive: str = "tension",
    ) -> None:
        AXES.find(axes)
        seen = seen_from_base(robot, loads)
        if axes == "planar":
            wanted = "'spatial' or 'torsion'"
            refuse_out_of_plane(
                "PCC with axes 'planar'", wanted, seen, robot.own_gravity, robot.tendons
            )
        elif axes == "spatial":
            refuse_torsion("PCC with axes 'spatial'", "'torsion'", seen, robot.tendons)
        self.axes, self.inertia = axes, inertia
        super().__init__(robot, pieces, loads, drive)

    def _data(self, actuation: Actuation) -> PccData:
        robot, pieces = self.robot, self.pieces
        block, backbone, edges = AXES[self.axes], robot.backbone, self.edges
        length = np.diff(edges)
        piece, fraction = _place(actuation.point_station, edges)
        order = np.argsort(piece, kind="stable")
        points = np.column_stack([fraction, actuation.point_offset, np.arange(len(piece))])
        first, bodies = _bodies(robot, edges, self.inertia)
        samples = channel_samples(robot, actuation, edges, edges)
        data = PccData(
            n=block * pieces,
            block=block,
            reach=pieces,
            scale=np.full(block * pieces, 1 / robot.length),
            actuation=actuation._replace(sampled=samples.tendon, sample_size=samples.size),
            pieces=pieces,
            length=length,
            bending=length * backbone.in_series(backbone.bending, edges),
            twisting=length * backbone.in_series(backbone.torsion, edges),
            damping_time=backbone.damping(backbone.bending, edges),
            gravity=np.array(robot.own_gravity, float),
            first=np.stack([first, np.searchsorted(piece[order], np.arange(pieces + 1))]),
            bodies=bodies,
            points=points[order],
            first_sample=np.searchsorted(samples.station, edges),
            places=samples.place,
        )
        if not isinstance(self.inertia, str):
            _check_definite(data)
        return data

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        return np.zeros(self.pieces * AXES[self.axes])

    def curvature(self, q: ndarray) -> ndarray:
        """Curvature (pieces, 3) [1/m]: kx = -gamma, ky = beta and torsion."""
        q = np.reshape(q, (self.pieces, -1))
        strain = np.zeros((self.pieces, 3), q.dtype)
        block = q.shape[1]
        strain[:, [1, 0, 2][:block]] = q * [1, -1, 1][:block]
        return strain


def _place(stations: ndarray, edges: ndarray) -> tuple[ndarray, ndarray]:
    """Piece and fraction of stations [m]; a joint belongs to the piece before it."""
    at = in_pieces(stations, edges)
    piece = np.maximum(np.ceil(at).astype(int) - 1, 0)
    return piece, at - piece


def _bodies(
    robot: RobotParams, edges: ndarray, inertia: str | Sequence[Station]
) -> tuple[ndarray, ndarray]:
    """Fields `first` and `bodies` of `PccData`."""
    pieces, length = len(edges) - 1, np.diff(edges)
    ends = np.column_stack([edges[1:], np.zeros((pieces, 4))])
    inner = np.empty((0, 5))
    if not isinstance(inertia, str):
        check_stations(robot, inertia)
        rows = [(s, mass, *moments) for s, mass, moments in inertia]
        inner = np.array(rows, float).reshape(-1, 5)
    elif inertia == "distributed":
        x, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        places = (edges[:-1, None] + length[:, None] * (x + 1) / 2).ravel()
        shares = (length[:, None] * w / 2).ravel()
        each = _inertias(robot.backbone.mass(places), robot.backbone.rotary(places))
        inner = np.column_stack([places, shares[:, None] * each])
    elif inertia == "lumped":
        backbone = robot.backbone
        whole = _inertias(*(backbone.integrals(x, edges) for x in (backbone.mass, backbone.rotary)))
        ends[:, 1:] = (whole + np.append(whole[1:], np.zeros((1, 4)), axis=0)) / 2
    else:
        raise ValueError(
            f"unknown inertia {inertia!r}; choose from {', '.join(INERTIAS)} or give stations"
        )
    if isinstance(inertia, str):
        discs = [(disc.station, disc.mass, *disc.inertia) for disc in robot.discs]
        inner = np.concatenate([inner, np.array(discs, float).reshape(-1, 5)])
    bodies = np.concatenate([inner, ends])
    index, bodies[:, 0] = _place(bodies[:, 0], edges)
    order = np.argsort(index, kind="stable")  # ends stay last in their pieces
    return np.searchsorted(index[order], np.arange(pieces + 1)), bodies[order]


def _inertias(mass: ndarray, rotary: ndarray) -> ndarray:
    """Mass and moments of inertia (k, 4) of thin discs, given those about a diameter (k,)."""
    return np.column_stack([mass, rotary, rotary, 2 * rotary])


def check_stations(robot: RobotParams, stations: Sequence[Station]) -> None:
    """Raise ValueError for a rigid body off the robot or of negative or infinite inertia."""
    for s, mass, moments in stations:
        if not 0 <= s <= robot.length * (1 + 1e-12):
            raise ValueError(f"inertia at {s} m is off the robot, 0 to {robot.length} m")
        if len(moments) != 3 or not all(0 <= x < inf for x in (mass, *moments)):
            raise ValueError(
                "inertia needs a finite mass and three moments of inertia, zero or more, got "
                f"{mass} kg and {moments} kg m2"
            )


def _check_definite(data: PccData) -> None:
    """Raise ValueError if a coordinate has no inertia in the straight pose."""
    mass = np.empty((data.n, data.n))
    dynamics.mass_and_momenta(reference(data), np.zeros(data.n), mass)
    size = np.sqrt(np.diag(mass))
    if not np.all(size > 0) or (np.linalg.eigvalsh(mass / np.outer(size, size))[0] < _SINGULAR):
        raise ValueError(
            f"the given inertia leaves some of {data.n} coordinates without inertia; give more "
            "stations, up to the last piece, or fewer pieces"
        )


mechanics.implement(PccData, dynamics)
