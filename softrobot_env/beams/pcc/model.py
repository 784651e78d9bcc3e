"""Piecewise constant curvature (PCC) model of ch. 2.1 of the thesis."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from softrobot_env.beams import mechanics
from softrobot_env.beams.actuation import Actuation
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.numerics.compilation import reference, structure
from softrobot_env.beams.pcc import actuation, dynamics
from softrobot_env.registries import Registry
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load, refuse_out_of_plane, refuse_torsion

#: Number of coordinates per piece by the choice of `axes`.
AXES = Registry("axes", {"planar": 1, "spatial": 2, "torsion": 3})
#: Named distributions of the inertia.
INERTIAS = ("lumped", "distributed")
#: Arc length [m], mass [kg] and moments of inertia (xx, yy, zz) [kg m2] of a rigid body.
Station = tuple[float, float, tuple[float, float, float]]

_GAUSS_POINTS = 4
#: Fraction of a piece within which a place counts as the end of the piece before it.
_SNAP = 1e-9
#: Smallest ratio of the mass matrix' eigenvalues, in units of which a coordinate has inertia.
_SINGULAR = 1e-12


@structure
class PccData(NamedTuple):
    """Data of the kernels; coordinates are blocks (beta, gamma, tau) [1/m] of the pieces.

    Attributes:
        n, block, reach, scale, actuation: As in `mechanics`.
        pieces: Number of pieces.
        length: [m] of a piece.
        bending, twisting: [N m3], l EI and l GJ.
        damping_time: [s].
        gravity: (3,) [m/s2].
        first: (2, pieces + 1) first body and first point of a piece.
        bodies: (k, 5) place within the piece (0 to 1), mass [kg] and principal moments of
            inertia [kg m2] of the bodies, ordered by piece. The last of each piece is at its end.
        points: (n_points, 4) place within the piece, that in the cross-section [m] and number of
            the points of the actuation, ordered by piece.
        channels: (n_channels, 3) end, in pieces, and place in the cross-section [m].
    """

    n: int
    block: int
    reach: int
    scale: np.ndarray
    actuation: Actuation
    pieces: int
    length: float
    bending: float
    twisting: float
    damping_time: float
    gravity: np.ndarray
    first: np.ndarray
    bodies: np.ndarray
    points: np.ndarray
    channels: np.ndarray


class PCC(BeamModel):
    """Pieces of constant curvature without shear and extension.

    Coordinates are the curvatures beta (bending towards +x) and gamma (towards +y) and the
    torsion tau of the pieces [1/m], piece by piece. In pieces without torsion this is the model
    of thesis (2.4) to (2.15), with the audit's corrections and without its singularity; pieces
    with torsion are exact helices. The elastic moments are EI (beta + mu beta'), likewise gamma,
    and GJ (tau + mu tau').

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
        if axes == "planar":
            refuse_out_of_plane(
                "PCC with axes 'planar'",
                "'spatial' or 'torsion'",
                loads,
                robot.gravity,
                robot.tendons,
            )
        elif axes == "spatial":
            refuse_torsion("PCC with axes 'spatial'", "'torsion'", loads)
        self.axes, self.inertia = axes, inertia
        super().__init__(robot, pieces, loads, drive)

    def _data(self, actuation: Actuation) -> PccData:
        robot, pieces = self.robot, self.pieces
        block, length = AXES[self.axes], robot.length / pieces
        piece, fraction = _place(actuation.point_station / length, pieces)
        order = np.argsort(piece, kind="stable")
        points = np.column_stack([fraction, actuation.point_offset, np.arange(len(piece))])
        first, bodies = _bodies(robot, pieces, self.inertia)
        data = PccData(
            n=block * pieces,
            block=block,
            reach=pieces,
            scale=np.full(block * pieces, 1 / robot.length),
            actuation=actuation,
            pieces=pieces,
            length=length,
            bending=length * robot.bending_stiffness,
            twisting=length * robot.torsional_stiffness,
            damping_time=float(robot.damping_time),
            gravity=np.array(robot.gravity, dtype=float),
            first=np.stack([first, np.searchsorted(piece[order], np.arange(pieces + 1))]),
            bodies=bodies,
            points=points[order],
            channels=np.column_stack([actuation.channel_end / length, actuation.channel_offset]),
        )
        if not isinstance(self.inertia, str):
            _check_definite(data)
        return data

    def rest(self) -> np.ndarray:
        """Coordinates (n,) of the straight pose."""
        return np.zeros(self.pieces * AXES[self.axes])

    def curvature(self, q: np.ndarray) -> np.ndarray:
        """Curvature (pieces, 3) [1/m]: kx = -gamma, ky = beta and torsion."""
        q = np.reshape(q, (self.pieces, -1))
        strain = np.zeros((self.pieces, 3), q.dtype)
        strain[:, 1] = q[:, 0]
        if q.shape[1] > 1:
            strain[:, 0] = -q[:, 1]
        if q.shape[1] > 2:
            strain[:, 2] = q[:, 2]
        return strain


def _place(places: np.ndarray, pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Piece and fraction of places given in pieces; a joint belongs to the piece before it."""
    piece = np.clip(np.ceil(places - _SNAP) - 1, 0, pieces - 1).astype(int)
    return piece, places - piece


def _bodies(
    robot: RobotParams, pieces: int, inertia: str | Sequence[Station]
) -> tuple[np.ndarray, np.ndarray]:
    """Fields `first` and `bodies` of `PccData`."""
    length = robot.length / pieces
    # Mass and moments of inertia of a piece.
    piece = length * robot.mass_per_length * np.array([1.0, 0.0, 0.0, 0.0])
    piece[1:] = length * robot.density * robot.second_moment * np.array([1.0, 1.0, 2.0])
    ends = np.column_stack([np.arange(1.0, pieces + 1), np.zeros((pieces, 4))])
    inner = np.empty((0, 5))
    if not isinstance(inertia, str):
        inner = _given(robot, pieces, inertia)
    elif inertia == "distributed":
        x, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        places = (np.arange(pieces)[:, None] + (x + 1) / 2).ravel()
        inner = np.column_stack([places, np.outer(np.tile(w / 2, pieces), piece)])
    elif inertia == "lumped":
        ends[:, 1:] = piece
        ends[-1, 1:] /= 2
    else:
        raise ValueError(
            f"unknown inertia {inertia!r}; choose from {', '.join(INERTIAS)} or give stations"
        )
    bodies = np.concatenate([inner, ends])
    index, fraction = _place(bodies[:, 0], pieces)
    order = np.argsort(index, kind="stable")  # ends stay last in their pieces
    bodies[:, 0] = fraction
    return np.searchsorted(index[order], np.arange(pieces + 1)), bodies[order]


def _given(robot: RobotParams, pieces: int, stations: Sequence[Station]) -> np.ndarray:
    """Place in pieces, mass and moments of inertia (k, 5) of given bodies."""
    check_stations(robot, stations)
    rows = [(s * pieces / robot.length, mass, *moments) for s, mass, moments in stations]
    return np.array(rows, dtype=float).reshape(-1, 5)


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
    dynamics.mass_matrix(reference(data), np.zeros(data.n), mass)
    size = np.sqrt(np.diag(mass))
    if not np.all(size > 0) or (np.linalg.eigvalsh(mass / np.outer(size, size))[0] < _SINGULAR):
        raise ValueError(
            f"the given inertia leaves some of {data.n} coordinates without inertia; give more "
            "stations, up to the last piece, or fewer pieces"
        )


mechanics.implement(PccData, dynamics, actuation)
