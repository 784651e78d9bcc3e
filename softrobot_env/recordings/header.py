"""The header of a recording: which column is what, in which unit and frame; keys of a TOML file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy import ndarray

from softrobot_env.core.files import read_table, text, write_text
from softrobot_env.core.records import (
    NotNegative,
    Positive,
    Record,
    Vector3,
    check_fields,
    check_unique,
    placed,
    read,
    write,
)

CommandKind = Literal["length", "tension", "action"]
TimeUnit = Literal["s", "ms", "us", "ns"]
LengthUnit = Literal["m", "cm", "mm"]

#: SI units in each unit that a column may have.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "tension": {"N": 1.0, "mN": 1e-3},
    "action": {"1": 1.0},
    "angle": {"rad": 1.0, "deg": pi / 180, "turn": 2 * pi},
}

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Time(Record):
    """The column of times.

    Attributes:
        column: Its name. Only differences count, so that the clock may be any.
        unit: Of its numbers.
    """

    column: str
    unit: TimeUnit = "s"


@dataclass(frozen=True)
class Commands:
    """The columns of commands.

    Attributes:
        kind: "length" pulled in from the straight pose on, "tension", or "action" of an
            environment in [-1, 1].
        columns: Names.
        unit: Of their numbers: m, cm or mm; N or mN; 1. Of lengths also rad, deg or turn, angles
            of servos with spools.
        tendons: The robot's tendon that each column drives; not known unless given. Actions have
            the order of the environment and no tendons.
        factors: What each column is multiplied by: -1 where it counts what is let out, one over
            the counts of a unit where it counts; 1 unless given.
        zeros: What is added after that [m, N or 1]: what a servo pulls in, or lets out, where its
            column says zero; none unless given.
        in_force: Whether a row's command acts "from" its time to that of the next, or from the
            row before "until" its own.
        spool_radius_m: Radius of the spools, which turns angles into lengths; with a unit of
            angles only.
    """

    kind: CommandKind
    columns: tuple[str, ...]
    unit: str
    tendons: tuple[str, ...] | None = None
    factors: tuple[float, ...] | None = None
    zeros: tuple[float, ...] | None = None
    in_force: Literal["from", "until"] = "from"
    spool_radius_m: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self, "commands")
        known = [*UNITS[self.kind], *(UNITS["angle"] if self.kind == "length" else ())]
        if self.unit not in known:
            raise ValueError(
                f"commands: unit of a {self.kind} must be one of {', '.join(known)}, got "
                f"{self.unit!r}"
            )
        if self._by_angle != (self.spool_radius_m is not None):
            angles = ", ".join(UNITS["angle"])
            raise ValueError(
                f"commands: angles ({angles}) and spool_radius_m go together, got unit "
                f"{self.unit!r} and {'none' if self._by_angle else 'one'}"
            )
        check_unique(self.columns, "commands: columns")
        if not self.columns:
            raise ValueError("commands: columns must name one column or more")
        if self.tendons is not None and self.kind == "action":
            raise ValueError("commands: actions have the environment's order and no tendons")
        check_unique(self.tendons or (), "commands: tendons")
        for name in ("tendons", "factors", "zeros"):
            given = getattr(self, name)
            if given is not None and len(given) != len(self.columns):
                raise ValueError(
                    f"commands: {name} must be one for each of the {len(self.columns)} columns, "
                    f"got {len(given)}"
                )

    @property
    def _by_angle(self) -> bool:
        return self.kind == "length" and self.unit in UNITS["angle"]

    @property
    def scale(self) -> ndarray:
        """(n,) what columns are multiplied by to have SI units."""
        factors = self.factors or (1.0,) * len(self.columns)
        unit = UNITS["angle" if self._by_angle else self.kind][self.unit]
        return unit * (self.spool_radius_m or 1.0) * np.array(factors, float)

    @property
    def offset(self) -> ndarray:
        """(n,) what is added to columns after that, in SI units."""
        return np.array(self.zeros or (0.0,) * len(self.columns), float)


@dataclass(frozen=True)
class Marker:
    """A marker that was measured.

    Attributes:
        x, y, z: Columns of its position; a coordinate without one was not measured.
        unit: Of their numbers.
        station_m: Arc length of the cross-section that carries it; the robot's output point at
            its tip unless given.
        offset_m: (3,) from that point, along the cross-section's x and y and out of it.
        delay_s: How late it is measured.
        may_be_lost: Whether it was not seen in some rows, whose cells are empty or nan.
    """

    x: str | None = None
    y: str | None = None
    z: str | None = None
    unit: LengthUnit = "m"
    station_m: NotNegative | None = None
    offset_m: Vector3 = (0.0, 0.0, 0.0)
    delay_s: NotNegative = 0.0
    may_be_lost: bool = False

    def __post_init__(self) -> None:
        check_fields(self, "marker")
        if not any(self.columns):
            raise ValueError("marker: name a column of x, y or z")

    @property
    def columns(self) -> tuple[str | None, ...]:
        """Of x, y and z."""
        return self.x, self.y, self.z


@dataclass(frozen=True)
class Frame:
    """Where the recording's coordinates lie in the robot's world.

    A recorded point p is turned and shifted: world = R(turn) axes(p) + shift.

    Attributes:
        axes: The recorded axes that are the world's x, y and z, such as ["z", "x", "y"] for a
            camera whose y points up; "-x" is the opposite of x.
        turn_deg: (3,) rotation vector [degrees] after that.
        shift_m: (3,) [m] after that.
    """

    axes: tuple[str, str, str] = _AXES
    turn_deg: Vector3 = (0.0, 0.0, 0.0)
    shift_m: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_fields(self, "frame")
        if sorted(axis.removeprefix("-") for axis in self.axes) != list(_AXES):
            raise ValueError(f'frame: axes must be x, y and z, "-x" and so on, got {self.axes}')
        if np.linalg.det(self._permutation) < 0:
            raise ValueError(f"frame: axes {', '.join(self.axes)} are left-handed")

    @cached_property
    def _permutation(self) -> ndarray:
        rows = np.zeros((3, 3))
        for row, axis in enumerate(self.axes):
            rows[row, _AXES.index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
        return rows

    @cached_property
    def rotation(self) -> ndarray:
        """(3, 3) from recorded to world directions, turn included."""
        if not any(self.turn_deg):
            return self._permutation
        from scipy.spatial.transform import Rotation  # takes time to load

        turn = Rotation.from_rotvec(self.turn_deg, degrees=True)
        return turn.as_matrix() @ self._permutation

    def to_world(self, points: ndarray) -> ndarray:
        """Recorded points (t, ..., 3) [m] in the world.

        A coordinate that is NaN in all rows was not measured; a point that is NaN in one was lost.

        Raises:
            ValueError: A coordinate was not measured although the frame is turned.
        """
        matrix = self.rotation
        if np.isnan(points).all(axis=0).any():
            if any(self.turn_deg):
                raise ValueError("frame: a turn needs markers with x, y and z measured")
            order = [_AXES.index(axis[-1]) for axis in self.axes]
            return points[..., order] * matrix[range(3), order] + self.shift_m
        return points @ matrix.T + self.shift_m

    def to_recorded(self, points: ndarray) -> ndarray:
        """The opposite of `to_world`."""
        gone = np.isnan(points)
        found = (np.where(gone, 0.0, points) - self.shift_m) @ self.rotation
        if gone.any():
            order = [abs(row).argmax() for row in self.rotation]
            found[..., order] = np.where(gone, np.nan, found[..., order])
        return found


@dataclass(frozen=True)
class Header:
    """What a recording's table holds.

    Attributes:
        commands: Its commands.
        marker: Its markers.
        time: Its times; rows come at `rate_Hz` unless given.
        rate_Hz: Of the rows. A robot at rest needs neither: its rows then count as seconds.
        runs: Column whose value changes where another run begins: times start afresh, and a
            robot that is simulated begins at rest under the run's first command.
        static: Whether the robot is at rest in every row, as against moving between them.
        label: Column of labels, such as the pattern that a row is of.
        label_ends: Ends that do not count: with "_hold" a row of "circle_hold" is of "circle".
        frame: Of the markers.
        robot: What was recorded, for people.
        source: Where it comes from, for people.
    """

    commands: Commands
    marker: tuple[Marker, ...] = ()
    time: Time | None = None
    rate_Hz: Positive | None = None
    runs: str | None = None
    static: bool = False
    label: str | None = None
    label_ends: tuple[str, ...] = ()
    frame: Frame = Frame()
    robot: str | None = None
    source: str | None = None

    def __post_init__(self) -> None:
        check_fields(self, "header")
        given = (self.time is not None) + (self.rate_Hz is not None)
        if given != 1 and not (self.static and not given):
            raise ValueError("header: give a table [time] or rate_Hz, and not both")

    def with_markers(self, **changes: Any) -> "Header":
        """The header with the same changes of all markers, by their fields."""
        return replace(self, marker=tuple(replace(one, **changes) for one in self.marker))

    def later(self, delay: float) -> "Header":
        """The header with markers that are measured later by a time [s]."""
        late = tuple(replace(one, delay_s=one.delay_s + delay) for one in self.marker)
        return replace(self, marker=late)

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that it names."""
        time = () if self.time is None else (self.time.column,)
        markers = [name for marker in self.marker for name in marker.columns]
        return tuple(filter(None, (*time, self.runs, self.label, *self.commands.columns, *markers)))


def read_header(*paths: Path | str) -> Header:
    """The header that TOML files say together; what later ones say counts.

    Raises:
        ValueError: They say what is not allowed, or too little; the message names the last file.
        OSError: One cannot be read.
    """
    table: dict[str, Any] = {}
    with placed(paths[-1]):
        for path in paths:
            table = _merged(table, read_table(Path(path)))
        return read(Header, table)


def write_header(header: Header, path: Path | str) -> None:
    """Write a file that is read as the same header."""
    write_text(path, text(write(header)))


def _merged(table: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    both = dict(table) | dict(over)
    for name in set(table) & set(over):
        if isinstance(table[name], Mapping) and isinstance(over[name], Mapping):
            both[name] = dict(table[name]) | dict(over[name])
    return both
