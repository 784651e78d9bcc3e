"""Recordings once they are read, or made of episodes of environments: arrays in SI units."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

from .header import Commands, Header, Marker, Time


@dataclass(frozen=True)
class Recording:
    """Commands and marker positions of a robot, row by row.

    Attributes:
        header: What the columns were, what the commands are, and where the markers sit. Units,
            factors and frame are applied already.
        times: (t,) [s] since the first row of each run, rising within a run; of rows at rest some
            may be equal.
        commands: (t, n) [m, N or 1].
        markers: (t, k, 3) [m] in the robot's world; NaN where the header says no column, and where
            a marker that may be lost was.
        labels: (t,) str; empty where there are none.
        runs: (t,) which run a row is of, 0, 1, ...
    """

    header: Header
    times: ndarray
    commands: ndarray
    markers: ndarray
    labels: ndarray
    runs: ndarray

    def __post_init__(self) -> None:
        rows, head = len(self.times), self.header
        shapes = {
            "times": (rows,),
            "commands": (rows, len(head.commands.columns)),
            "markers": (rows, len(head.marker), 3),
            "labels": (rows,),
            "runs": (rows,),
        }
        for name, shape in shapes.items():
            got = getattr(self, name).shape
            if got != shape:
                raise ValueError(f"recording: {name} must have shape {shape}, got {got}")
        if not rows:
            raise ValueError("recording: it has no rows")
        self._check_numbers()

    def _check_numbers(self) -> None:
        head = self.header
        order = ["xyz".index(axis[-1]) for axis in head.frame.axes]
        needed = np.ones(self.markers.shape[1:], bool)
        for k, marker in enumerate(head.marker):
            needed[k] = [marker.columns[i] is not None and not marker.may_be_lost for i in order]
        for name, bad in {
            "times": ~np.isfinite(self.times),
            "commands": ~np.isfinite(self.commands),
            "markers": ~np.isfinite(self.markers) & needed,
        }.items():
            if bad.any():
                raise ValueError(f"row {1 + int(np.argwhere(bad)[0][0])}: {name} must be finite")
        steps, same = np.diff(self.times), np.diff(self.runs) == 0
        late = np.flatnonzero(((steps < 0) | ((steps == 0) & (not head.static))) & same)
        if len(late):
            row = int(late[0])
            raise ValueError(
                f"row {row + 2}: times must rise, got {self.times[row + 1]:.9g} s after "
                f"{self.times[row]:.9g} s"
            )

    @property
    def kind(self) -> str:
        """Of the commands: "length", "tension" or "action"."""
        return self.header.commands.kind

    @property
    def static(self) -> bool:
        """Whether the robot is at rest in every row."""
        return self.header.static

    @property
    def tendons(self) -> tuple[str, ...] | None:
        """The robot's tendon that each command drives, None if that is not known."""
        return self.header.commands.tendons

    @cached_property
    def patterns(self) -> ndarray:
        """(t,) str, labels without the ends that do not count."""
        patterns = [str(label) for label in self.labels]
        for end in self.header.label_ends:
            patterns = [text.removesuffix(end) for text in patterns]
        return np.array(patterns)

    @cached_property
    def begins(self) -> ndarray:
        """(t,) bool, rows where a run begins."""
        return np.diff(self.runs, prepend=-1) != 0

    @property
    def steps(self) -> ndarray:
        """[s] between each row and the next of its run."""
        return np.diff(self.times)[~self.begins[1:]]

    def with_header(self, **changes: Any) -> "Recording":
        """The recording with another header, by its fields."""
        return replace(self, header=replace(self.header, **changes))

    def part(self, rows: ndarray | slice) -> "Recording":
        """The recording of some rows, by their indices in order, a mask or a slice."""
        arrays = [f.name for f in fields(self) if f.name != "header"]
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})

    def controls(self, robot: RobotParams) -> ndarray:
        """What the drives of a robot apply, (t, n_tendons) [m] or [N], in the robot's order.

        A tendon without a command keeps its length, or its pretension.

        Raises:
            ValueError: It is not known which tendons the commands drive, the robot lacks one, or
                actions are of another number than it has inputs.
        """
        if self.kind == "action":
            inputs = robot_inputs(robot)
            if self.commands.shape[1] != inputs.n_inputs:
                raise ValueError(
                    f"robot {robot.name!r} takes actions of {inputs.n_inputs} numbers, the "
                    f"recording has {self.commands.shape[1]}"
                )
            return inputs.per_action().command(self.commands)
        names = robot.tendon_names
        known = self.tendons if self.tendons is not None else self.header.commands.columns
        unknown = [name for name in known if name not in names]
        if unknown and self.tendons is None:
            raise ValueError(
                "which tendons the commands drive is not known: say it by the header's "
                f"commands.tendons, one of {', '.join(names)} for each of {', '.join(known)}; "
                "`softrobot identify` finds it where there are as many columns as tendons"
            )
        if unknown:
            raise ValueError(
                f"robot {robot.name!r} has no tendon {unknown[0]!r}; "
                f"it has {', '.join(names) or 'none'}"
            )
        idle = robot.of_tendons("pretension") * (self.kind == "tension")
        out = np.tile(idle, (len(self.times), 1))
        out[:, [names.index(name) for name in known]] = self.commands
        return out

    def drive(self, robot: RobotParams) -> str:
        """How the recorded robot was driven, "length" or "tension"; actions as the robot is."""
        return robot.drive.kind if self.kind == "action" else self.kind


def since_begin(times: ndarray, runs: ndarray) -> ndarray:
    """Times (t,) since the first row of each run, by their numbers 0, 1, ... (t,)."""
    first = np.unique(runs, return_index=True)[1]
    return times - times[first][runs]


_UNIT = {"length": "m", "tension": "N"}


def episode_recording(
    robot: RobotParams,
    axes: slice,
    times: ndarray,
    actions: ndarray,
    tips: ndarray,
    *,
    labels: Sequence[str] | None = None,
    runs: ndarray | None = None,
    source: str | None = None,
) -> Recording:
    """The recording of a robot's episodes: its tendons' lengths or tensions, and its tip.

    Args:
        robot: What was commanded; commands are what its drives apply for the actions.
        axes: Coordinates out of x, y and z that were measured.
        times: (t,) [s] since the start of each episode.
        actions: (t, n_inputs), in force just before each time.
        tips: (t, d) [m], the coordinates that were measured.
        labels: (t,) of the rows; none unless given.
        runs: (t,) number of the episode; one unless given.
        source: Where it comes from, for people.

    Raises:
        ValueError: A number is not finite, or times do not rise within an episode.
    """
    rows, unit = len(times), _UNIT[robot.drive.kind]
    markers = np.full((rows, 1, 3), np.nan)
    markers[:, 0, axes] = tips
    names = robot.tendon_names
    columns = tuple(f"{name}_{unit}" for name in names)
    header = Header(
        Commands(robot.drive.kind, columns, unit, tendons=names, in_force="until"),
        marker=(Marker(**{axis: f"tip_{axis}" for axis in "xyz"[axes]}),),
        time=Time("time"),
        runs="run",
        label="label",
        robot=robot.name,
        source=source,
    )
    return Recording(
        header=header,
        times=np.asarray(times, float),
        commands=robot_inputs(robot).per_action().command(np.asarray(actions, float)),
        markers=markers,
        labels=np.full(rows, "") if labels is None else np.array(labels, str),
        runs=np.zeros(rows, int) if runs is None else runs,
    )


def at_their_time(times: ndarray, ages: ndarray, tips: ndarray) -> ndarray:
    """Tips (t, d) [m] at times (t,) [s], from what was seen then, each some age (t,) [s] old."""
    if not np.any(ages):
        return tips
    taken, first = np.unique(times - ages, return_index=True)
    return np.stack([np.interp(times, taken, column[first]) for column in tips.T], axis=1)


# ---------------------------------------------------------------- what looks wrong

_GAP = 5.0  # times the usual distance of rows
_STILL = 1e-9  # of a command that never changes
_FAR = 1.05  # times the robot's reach


@dataclass(frozen=True)
class Summary:
    """A recording in numbers.

    Attributes:
        rows, runs: How many.
        duration: [s] of all runs together.
        rate: [Hz], of most rows; None of a single row.
        gaps: Numbers of the rows that come late, after five times the usual distance or more.
        longest_gap: [s].
        command_range: (n, 2) [m, N or 1], of each command.
        marker_range: (k, 3, 2) [m], of each marker.
        patterns: Rows of each pattern.
        warnings: What may be wrong, a line each.
    """

    rows: int
    runs: int
    duration: float
    rate: float | None
    gaps: tuple[int, ...]
    longest_gap: float
    command_range: ndarray
    marker_range: ndarray
    patterns: dict[str, int]
    warnings: tuple[str, ...]


def summarize(recording: Recording, robot: RobotParams | None = None) -> Summary:
    """Numbers and warnings of a recording; with a robot, what does not fit it too."""
    steps = recording.steps
    usual = float(np.median(steps)) if len(steps) else None
    late = np.flatnonzero(steps > _GAP * usual) if usual else np.zeros(0, int)
    return Summary(
        rows=len(recording.times),
        runs=int(recording.runs[-1]) + 1,
        duration=float(steps.sum()),
        rate=1 / usual if usual else None,
        gaps=tuple((np.flatnonzero(~recording.begins)[late] + 1).tolist()),
        longest_gap=float(steps.max()) if len(steps) else 0.0,
        command_range=np.stack([recording.commands.min(0), recording.commands.max(0)], axis=1),
        marker_range=np.stack(
            [reduce(recording.markers, axis=0) for reduce in (np.fmin.reduce, np.fmax.reduce)],
            axis=-1,
        ),
        patterns=dict(Counter(recording.patterns.tolist())),
        warnings=tuple(_warnings(recording, robot)),
    )


def _warnings(recording: Recording, robot: RobotParams | None) -> Iterator[str]:
    head = recording.header
    if robot is None and recording.kind != "action" and head.commands.tendons is None:
        yield "which tendons the commands drive is not known (commands.tendons)"
    if not head.marker:
        yield "there are no markers"
    for name, column in zip(head.commands.columns, recording.commands.T, strict=True):
        if np.ptp(column) <= _STILL:
            yield f"command {name} never changes"
        if recording.kind == "tension" and column.min() < 0:
            yield f"command {name} is a tension below zero: a tendon cannot push"
    for k, places in enumerate(recording.markers.swapaxes(0, 1), 1):
        yield from _of_marker(f"marker {k}", places)
        if robot is not None:
            away = places - robot.clamp.position
            far = float(np.sqrt(np.nansum(away**2, axis=1)).max())
            if far > _FAR * robot.reach:
                yield (
                    f"marker {k} is up to {1e3 * far:.4g} mm from the clamp, the robot reaches "
                    f"{1e3 * robot.reach:.4g} mm: look at units and frame"
                )
    if robot is not None:
        try:
            recording.controls(robot)
        except ValueError as error:
            yield str(error)


def _of_marker(name: str, places: ndarray) -> Iterator[str]:
    places = places[:, ~np.isnan(places).all(axis=0)]
    seen = places[~np.isnan(places).any(axis=1)]
    if len(seen) < len(places):
        yield f"{name} is lost in {len(places) - len(seen)} of {len(places)} rows"
    if not seen.size:
        yield f"{name} is never seen"
    elif np.ptp(seen, axis=0).max() <= _STILL:
        yield f"{name} never moves"
