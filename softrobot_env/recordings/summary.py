"""What is in a recording, and what looks wrong with it."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from softrobot_env.recordings.recording import Recording
from softrobot_env.robots import RobotParams

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
    command_range: np.ndarray
    marker_range: np.ndarray
    patterns: dict[str, int]
    warnings: tuple[str, ...]


def summarize(recording: Recording, robot: RobotParams | None = None) -> Summary:
    """Numbers and warnings of a recording; with a robot, what does not fit it too."""
    within = np.diff(recording.runs) == 0
    steps = np.diff(recording.times)[within]
    usual = float(np.median(steps)) if len(steps) else None
    late = np.flatnonzero(steps > _GAP * usual) if usual else np.zeros(0, dtype=int)
    return Summary(
        rows=len(recording.times),
        runs=int(recording.runs[-1]) + 1,
        duration=float(steps.sum()),
        rate=1 / usual if usual else None,
        gaps=tuple((np.flatnonzero(within)[late] + 2).tolist()),
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
            yield from _far(k, places, robot)
    if robot is not None:
        yield from _unfit(recording, robot)


def _of_marker(name: str, places: np.ndarray) -> Iterator[str]:
    places = places[:, ~np.isnan(places).all(axis=0)]
    seen = places[~np.isnan(places).any(axis=1)]
    if len(seen) < len(places):
        yield f"{name} is lost in {len(places) - len(seen)} of {len(places)} rows"
    if not seen.size:
        yield f"{name} is never seen"
    elif np.ptp(seen, axis=0).max() <= _STILL:
        yield f"{name} never moves"


def _far(number: int, places: np.ndarray, robot: RobotParams) -> Iterator[str]:
    clamp = np.zeros(3) if robot.base is None else np.array(robot.base.position)
    far = float(np.sqrt(np.nansum((places - clamp) ** 2, axis=1)).max())
    if far > _FAR * robot.reach:
        yield (
            f"marker {number} is up to {1e3 * far:.4g} mm from the clamp, the robot reaches "
            f"{1e3 * robot.reach:.4g} mm: look at units and frame"
        )


def _unfit(recording: Recording, robot: RobotParams) -> Iterator[str]:
    try:
        recording.controls(robot)
    except ValueError as error:
        yield str(error)
