"""A robot's statics as a function of unknown parameters, with exact derivatives.

It uses constant-curvature pieces, two or more between the ends of tendons and sections, instead of
the MuJoCo chain: a row takes 0.2 ms instead of some 5. The result is written as a robot file and a
header, and confirmed there by the chain.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import atan2, ceil, degrees
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import masses_at
from softrobot_env.core.processes import one_blas_thread
from softrobot_env.recordings import Header, Recording
from softrobot_env.recordings.header import Commands
from softrobot_env.robots import Base, RobotParams, Section, Tendon
from softrobot_env.robots.actuation import with_balance

from . import kernels, unknowns
from .kernels import TINY, Body, Layout
from .unknowns import HOLDS, RUBS, START_COEFFICIENT, Fact, Turned, Unknowns

_PIECES = 6  # at least, for the whole robot
_CHANNEL = 1000  # spans of a continuous channel in a piece
_LOOSE = 2e-5  # m
_GIVE = 0.01  # rad, bend of the whole robot at which friction of its backbone is fully developed
_TOLERANCE = 1e-9  # of the imbalance, relative to the moment that bends the robot by a radian


@dataclass(frozen=True)
class Simulated:
    """Simulated rows.

    Attributes:
        error: (t, k, 3) [m] simulated minus recorded markers, along the robot's axes; NaN where
            they were not measured.
        slopes: (t, k, 3, p) derivatives by the parameters; p is zero without derivatives.
        turns: (t, 3 n) [rad] of the pieces.
        found: (t,) bool, whether an equilibrium was found.
        markers: (t, k, 3) [m] simulated, along the robot's axes.
    """

    error: ndarray
    slopes: ndarray
    turns: ndarray
    found: ndarray
    markers: ndarray


class StaticModel:
    """A robot and a recording of it at rest.

    Attributes:
        robot, recording: As given; the recording's columns belong to known tendons.
        unknowns: The parameters.
        points: (t, k, 3) [m], recorded markers along the robot's axes at its base.
        spatial: Whether the robot leaves its plane.
        layout: Its pieces.
        stretches: First piece after each end of a section or tendon.
    """

    def __init__(
        self,
        robot: RobotParams,
        recording: Recording,
        turned: Turned = "as said",
        pieces: int | None = None,
        known: Sequence[str] = (),
    ) -> None:
        """Build the arrays.

        Args:
            robot: The robot of the file.
            recording: Of rows at rest, with known tendons.
            turned: How the recording's axes may be rotated relative to the robot's.
            pieces: Least total number; by default six, and two between ends of sections or tendons.
            known: Kinds of parameters that are exact in the file. Otherwise friction and backlash
                have at least the initial values of a search.

        Raises:
            ValueError: The model does not support something that the robot has, or the recording
                has no markers.
        """
        _check(robot, recording)
        self.robot, self.recording = robot, recording
        self._controls = np.ascontiguousarray(recording.controls(robot))
        self._gravity = np.array(robot.own_gravity)
        self._by_length = recording.drive(robot) == "length"
        self._axes, self._base = robot.clamp.axes, np.array(robot.clamp.position)
        self.points = self._own(recording.markers)
        self.spatial = not robot.is_planar
        how = {"turned": turned, "spatial": self.spatial, "by_length": self._by_length}
        self.unknowns = Unknowns(tuple(unknowns.groups(robot, recording, **how)))
        travel = float(np.ptp(recording.commands, axis=0).max())
        self._friction = robot.of_tendons("friction")
        if "tendon_friction" not in known:
            self._friction = unknowns.start_friction(robot, travel, self._by_length)
        self._backlash = robot.drive.backlash / 2 if self._by_length else 0.0
        if self._by_length and "backlash" not in known:
            self._backlash = unknowns.start_backlash(robot, travel)
        self._holding = np.array([s.bending_friction for s in robot.backbone.sections])
        if HOLDS not in known:
            self._holding = unknowns.start_bending_friction(robot)
        self._rubbing = robot.of_tendons("friction_coefficient")
        if RUBS not in known and not self._rubbing.any():
            self._rubbing = np.full(len(robot.tendons), START_COEFFICIENT)
        lines = [t.feed_line for t in robot.tendons]
        self._feed = np.array([line.exponent if line else 0.0 for line in lines])
        self._lay(pieces)
        self._usual = len(self.layout.sizes)

    def finer(self) -> "StaticModel":
        """The same model with pieces half as long; chains of its results keep their resolution."""
        other = copy(self)
        other._lay(2 * len(self.layout.sizes))
        return other

    def with_facts(self, *facts: Fact) -> "StaticModel":
        """The same model with additional information about its parameters."""
        other = copy(self)
        other.unknowns = replace(self.unknowns, facts=facts)
        return other

    def on(self, recording: Recording, gravity: ndarray | None = None) -> "StaticModel":
        """The same model for another recording, with gravity (3,) [m/s2] along the robot's axes."""
        other = copy(self)
        other.recording, other._controls = recording, recording.controls(self.robot)
        other.points = self._own(recording.markers)
        if gravity is not None:
            other._gravity = gravity
        return other

    def _own(self, markers: ndarray) -> ndarray:
        """Markers (t, k, 3) [m] along the robot's axes; NaN where not measured."""
        lost = np.isnan(markers)
        points = (np.where(lost, 0.0, markers) - self._base) @ self._axes
        points[lost @ (np.abs(self._axes) > 1e-9)] = np.nan
        return points

    def _lay(self, pieces: int | None) -> None:
        robot, markers = self.robot, self.recording.header.marker
        stations = [m.station_m for m in markers if m.station_m is not None]
        ends = [*robot.backbone.ends, *robot.of_tendons("end"), *stations]
        ends = np.unique(np.round(ends, 12))
        ends = ends[(ends >= 0) & (ends <= robot.length * (1 + 1e-12))]
        least, total = (2, _PIECES) if pieces is None else (1, pieces)
        pieces = max(least, ceil(total / (len(ends) - 1)))
        parts = [a + (b - a) / pieces * np.arange(pieces) for a, b in pairwise(ends)]
        edges = np.concatenate([*parts, ends[-1:]])
        self._edges, sizes = edges, np.diff(edges)
        self.stretches = pieces * np.arange(len(ends) - 1)
        tendons = robot.tendons
        last = np.abs(edges - robot.of_tendons("end")[:, None]).argmin(axis=1)
        spans = np.full((len(tendons), len(sizes)), float(_CHANNEL))
        for k, tendon in enumerate(tendons):
            if tendon.guides:
                spans[k] = _spans(np.array(tendon.stations), edges)
        places = [edges[-1] if m.station_m is None else m.station_m for m in markers]
        nodes = np.array([int(np.argmin(np.abs(edges - place))) for place in places])
        give = _GIVE * sizes / robot.length
        apart = bool(self._holding.any())
        along = bool(self._rubbing.any() or self._feed.any())
        self.layout = Layout(sizes, spans, last, self._by_length, nodes, _LOOSE, give, apart, along)
        backbone = robot.backbone
        self._bending = backbone.in_series(backbone.bending, edges) / sizes
        self._torsion = backbone.in_series(backbone.torsion, edges) / sizes
        self._section = backbone.index(edges[:-1] + sizes / 2)
        self._mass = masses_at(robot, edges)
        self._scale = float(self._bending.min())

    # ------------------------------------------------------------------ parameters to arrays

    def body(self, x: ndarray) -> Body:
        """The model's arrays for parameters (p,), real or complex."""
        robot, take = self.robot, partial(self.unknowns.take, x)
        soft = np.exp(take("youngs_modulus"))[self._section]
        unlike, across = self._unlike(x)
        # Bends towards x and y are turns about y and -x.
        xx, xy, yy = 1 + unlike, across, 1 - unlike
        bend = self._bending * soft
        stiffness = np.stack([bend * yy, -bend * xy, bend * xx, self._torsion * soft], axis=1)
        more = take("precurvature")
        toward_x, toward_y = robot.precurvature[0] + more[0], robot.precurvature[1] + more[-1]
        sizes = self.layout.sizes
        rest = np.stack([-toward_y * sizes, toward_x * sizes], axis=1)
        angle, radius = take("tendon_angle"), np.exp(take("tendon_radius"))
        c, s = np.cos(angle) * radius, np.sin(angle) * radius
        a, b = robot.of_tendons("offset").T
        place = np.stack([c * a - s * b, s * a + c * b], axis=1)
        spring = np.ones(len(a), x.dtype)
        if self._by_length:
            spring = robot.of_tendons("stiffness") * np.exp(take("tendon_stiffness"))
        pre = robot.of_tendons("pretension") + take("pretension")
        friction = self._friction * np.exp(take("tendon_friction"))
        heavy = np.exp(take("mass")[0])
        head = robot.head
        over = np.array([0.0, 0.0]) if head is None else np.array([head.mass, head.centre])
        gravity = self._turn(x, "gravity_tilt").T @ self._gravity
        straight = self._edges[self.layout.last] + x[:1].sum() * 0
        return Body(
            stiffness,
            rest,
            place,
            spring,
            pre,
            friction,
            straight,
            self._mass * heavy,
            over * np.array([heavy, 1.0]),
            gravity,
            self._backlash * np.exp(take("backlash")[0]) * np.ones(len(a)),
            self._offsets(x),
            (self._holding * np.exp(take("bending_friction")))[self._section],
            self._rubbing * np.exp(take(RUBS)),
            self._feed + x[:1].sum() * 0,
        )

    def _unlike(self, x: ndarray) -> ndarray:
        """(2,) half of the anisotropy: along x minus along y, and along the diagonals."""
        robot = self.robot
        filed = robot.anisotropy / 2 * np.exp(2j * robot.stiff_azimuth)
        return np.array([filed.real, filed.imag]) + self.unknowns.take(x, "anisotropy") / 2

    def _offsets(self, x: ndarray) -> ndarray:
        """(k, 3) [m] of the markers along the axes at their nodes, a head's height included."""
        markers = self.recording.header.marker
        known = np.array([m.offset_m for m in markers], float)
        if self.robot.head is not None:
            known[[m.station_m is None for m in markers], 2] += self.robot.head.output
        return known + self._three(self.unknowns.take(x, "marker_offset"))

    def _three(self, values: ndarray) -> ndarray:
        """(k, 3) coordinates from the unknown ones, x and z for a planar robot."""
        if self.spatial:
            return values.reshape(-1, 3)
        pairs = values.reshape(-1, 2)
        return np.stack([pairs[:, 0], pairs[:, 0] * 0, pairs[:, 1]], axis=1)

    def _turn(self, x: ndarray, name: str) -> ndarray:
        """(3, 3) rotation by the parameters of a kind: about x, y and z, x and y, or y."""
        found = self.unknowns.take(x, name)
        vector = np.zeros(3, x.dtype)
        if len(found) == 1:
            vector[1] = found[0]
        else:
            vector[: len(found)] = found
        return rotation(vector)

    def _shift(self, x: ndarray) -> ndarray:
        return self._three(self.unknowns.take(x, "frame_shift"))[0]

    # ------------------------------------------------------------------ simulation

    @one_blas_thread()
    def simulate(
        self, x: ndarray, free: ndarray | None = None, has_friction: bool = True
    ) -> Simulated:
        """Markers and errors for parameters x (p,).

        Args:
            x: Parameters.
            free: (p,) bool, parameters to differentiate by; by default none.
            has_friction: Whether tendons have friction, and servos backlash.
        """
        by = np.zeros(0, int) if free is None else np.flatnonzero(free)
        steps = x.astype(complex) + TINY * 1j * np.eye(len(x))[by]
        moves_frame = self.unknowns.moves_frame[by]
        body = _real(self._acting(x, has_friction))
        many = _many([self._acting(y, has_friction) for y in steps[~moves_frame]], body)
        rows, n, k = len(self._controls), len(self.layout.sizes), len(self.layout.nodes)
        found = kernels.Rows(
            controls=np.ascontiguousarray(self._controls),
            begins=self.recording.begins,
            turns=np.zeros((rows, 3 * n)),
            markers=np.zeros((rows, k, 3)),
            slopes=np.zeros((rows, k, 3, len(many.gravity))),
            found=np.ones(rows, bool),
        )
        room = kernels.scratch(n, len(body.spring))
        kernels.follow(self.layout, body, many, found, _TOLERANCE * self._scale, room)
        slopes = np.zeros((rows, k, 3, len(by)))
        slopes[..., ~moves_frame] = found.slopes
        for index in np.flatnonzero(moves_frame):
            slopes[..., index] = -np.nan_to_num(self._placed(steps[index]).imag) / TINY
        error = found.markers - self._placed(x)
        return Simulated(error, slopes, found.turns, found.found, found.markers)

    def _acting(self, x: ndarray, has_friction: bool) -> Body:
        """The arrays for parameters (p,), optionally without friction and backlash."""
        body = self.body(x)
        if has_friction:
            return body
        names = ("friction", "holding", "backlash", "rubbing", "feed")
        none = {name: 0 * getattr(body, name) for name in names}
        return body._replace(**none)

    def place_frame(self, x: ndarray, vector: ndarray, shift: ndarray) -> None:
        """Set parameters x (p,) of the frame: rotation vector (3,) [rad] and shift (3,) [m]."""
        axes = [0, 1, 2] if self.spatial else [0, 2]
        x[self.unknowns.place("frame_turn")] = vector if self.spatial else vector[1:2]
        x[self.unknowns.place("frame_shift")] = shift[axes]

    def _placed(self, x: ndarray) -> ndarray:
        """Recorded points (t, k, 3) along the robot's axes."""
        points = self.points
        if not np.isnan(points).all(axis=(0, 1)).any():  # turns need all coordinates
            points = points @ self._turn(x, "frame_turn").T
        return points + self._shift(x)

    # ------------------------------------------------------------------ results

    def robot_of(self, x: ndarray) -> RobotParams:
        """The robot with parameters x (p,)."""
        robot, body = self.robot, _real(self.body(x))
        heavy = float(np.exp(self.unknowns.take(x, "mass")[0]))
        bend = np.array(robot.precurvature) + self.unknowns.take(x, "precurvature")
        unlike, drive = complex(*self._unlike(x)), robot.drive
        if self._by_length and drive.kind == "length":
            drive = replace(drive, backlash=2 * float(body.backlash[0]))
        found = replace(
            robot.with_sections(*self._sections_of(x, heavy)),
            tendons=self._tendons_of(x, body),
            drive=drive,
            precurvature=tuple(bend.tolist()),
            anisotropy=2 * abs(unlike),
            stiff_azimuth=float(np.angle(unlike)) / 2,
            head=None if robot.head is None else _heavier(robot.head, heavy),
            discs=tuple(_heavier(disc, heavy) for disc in robot.discs),
            base=self._base_of(x),
            file=None,
        )
        return with_balance(found)

    def _tendons_of(self, x: ndarray, body: Body) -> tuple[Tendon, ...]:
        found = []
        angle = np.broadcast_to(self.unknowns.take(x, "tendon_angle"), len(body.spring))
        radius = np.exp(self.unknowns.take(x, "tendon_radius"))
        for k, tendon in enumerate(self.robot.tendons):
            moved = tendon.turned(float(angle[k]), float(radius[k]))
            changes = {"friction": float(body.friction[k])}
            changes["friction_coefficient"] = float(body.rubbing[k])
            if self._by_length:
                changes["stiffness"] = float(body.spring[k])
                most = 0.9 * tendon.tension_limit
                changes["pretension"] = float(np.clip(body.pretension[k], 0.0, most))
            found.append(replace(moved, **changes))
        return tuple(found)

    def _sections_of(self, x: ndarray, heavy: float) -> list[Section]:
        """Sections, whose chain has this model's usual resolution."""
        sections = self.robot.backbone.sections
        soft = np.exp(self.unknowns.take(x, "youngs_modulus"))
        held = self._holding * np.exp(self.unknowns.take(x, HOLDS))
        finer = max(1, ceil(self._usual / self.robot.pieces))
        return [
            replace(
                section.vary(youngs_modulus=float(e), density=heavy),
                bending_friction=float(most),
                pieces=finer * section.pieces,
            )
            for section, e, most in zip(sections, soft, held, strict=True)
        ]

    def _base_axes(self, x: ndarray) -> ndarray:
        return self._axes @ self._turn(x, "gravity_tilt")

    def _base_of(self, x: ndarray) -> Base | None:
        if not self.unknowns.take(x, "gravity_tilt").any():
            return self.robot.base
        axes = self._base_axes(x)
        plain = Base(direction=tuple(axes[:, 2].tolist())).axes.T @ axes
        roll = atan2(plain[1, 0], plain[0, 0])
        return Base(tuple(self._base.tolist()), tuple(axes[:, 2].tolist()), roll)

    def header_of(self, x: ndarray, header: Header) -> Header:
        """The recording's header with frame, markers, factors and zeros of parameters x (p,)."""
        axes = self._base_axes(x)
        turn = axes @ self._turn(x, "frame_turn") @ self._axes.T
        frame = header.frame
        shift = turn @ (np.array(frame.shift_m) - self._base) + axes @ self._shift(x) + self._base
        # A zero rotation must stay zero: a coordinate that was not measured cannot be rotated.
        vector = turn_vector(turn @ rotation(np.radians(frame.turn_deg)))
        turned = [degrees(v) if abs(v) > 1e-12 else 0.0 for v in vector]
        frame = replace(frame, turn_deg=tuple(turned), shift_m=tuple(shift.tolist()))
        extra = self._three(self.unknowns.take(x, "marker_offset"))
        markers = tuple(
            replace(m, offset_m=tuple((np.array(m.offset_m) + e).tolist()))
            for m, e in zip(header.marker, extra, strict=True)
        )
        return replace(header, frame=frame, marker=markers, commands=self._commands(x, header))

    def _commands(self, x: ndarray, header: Header) -> Commands:
        commands = header.commands
        if not self._by_length or commands.kind != "length":
            return commands
        names = self.robot.tendon_names
        whose = [names.index(name) for name in (self.recording.tendons or commands.columns)]
        body = _real(self.body(x))
        written = np.array([t.pretension for t in self.robot_of(x).tendons])
        pulled = (body.pretension - written) / body.spring
        zeros = np.array(commands.zeros or (0.0,) * len(whose)) + pulled[whose]
        return replace(commands, zeros=tuple(zeros.tolist()) if zeros.any() else None)


def rotation(vector: ndarray) -> ndarray:
    """(3, 3) rotation by a vector (3,) [rad], real or complex."""
    x = (vector * vector).sum()
    if abs(x) < 1e-8:
        a, b = 1 - x / 6 * (1 - x / 20), 0.5 - x / 24
    else:
        t = np.sqrt(x)
        a, b = np.sin(t) / t, (1 - np.cos(t)) / x
    zero = x * 0
    cross = np.array(
        [
            [zero, -vector[2], vector[1]],
            [vector[2], zero, -vector[0]],
            [-vector[1], vector[0], zero],
        ]
    )
    return np.eye(3) + a * cross + b * cross @ cross


def turn_vector(matrix: ndarray) -> ndarray:
    """(3,) [rad] of a rotation (3, 3), the opposite of `rotation`."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(matrix).as_rotvec()


def _real(body: Body) -> Body:
    return Body(*(np.ascontiguousarray(np.real(part), float) for part in body))


def _many(bodies: list[Body], like: Body) -> Body:
    """Bodies (p, ...) in one, of arrays as those of another."""
    if not bodies:
        return Body(*(np.zeros((0, *part.shape), complex) for part in like))
    return Body(*(np.ascontiguousarray(np.stack(p), complex) for p in zip(*bodies, strict=True)))


def _heavier(part: Any, factor: float) -> Any:
    """A head or disc with its mass times a factor."""
    return replace(part, mass=part.mass * factor, inertia=tuple(factor * i for i in part.inertia))


def _spans(stations: ndarray, edges: ndarray) -> ndarray:
    """(n,) spans between guides in each piece: its size over their mean square length.

    A span bends by its share, and the error of its chord grows with the square.
    """
    found = np.ones(len(edges) - 1)
    lengths = np.diff(stations)
    for i, (a, b) in enumerate(pairwise(edges)):
        inside = np.clip(np.minimum(stations[1:], b) - np.maximum(stations[:-1], a), 0, None)
        if inside.sum() > 0:
            found[i] = (b - a) / np.sqrt((inside * lengths**2).sum() / inside.sum())
    return found


def _check(robot: RobotParams, recording: Recording) -> None:
    if not recording.header.marker:
        raise ValueError("the recording has no markers: nothing can be identified from it")
    if not robot.tendons:
        raise ValueError(f"robot {robot.name!r} has no tendons: nothing is commanded")
    crooked = [t.name for t in robot.tendons if not t.is_straight]
    if crooked:
        raise ValueError(
            f"tendon {crooked[0]!r} of robot {robot.name!r} is not straight; an identification "
            "knows tendons that stay at one place of the cross-section"
        )
    for marker in recording.header.marker:
        if marker.station_m is not None and marker.station_m > robot.length * (1 + 1e-9):
            raise ValueError(
                f"marker: station_m must be at most {robot.length:g}, got {marker.station_m:g}"
            )
