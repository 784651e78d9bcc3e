"""`softrobot recording`: check and replay tables of commands and marker positions."""

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Group

from softrobot_env.identification.fit.prediction import (
    PREDICTION_FILE,
    Judgement,
    read_prediction,
)
from softrobot_env.identification.fit.residual import RESIDUAL_FILE, corrected, read_residual
from softrobot_env.identification.replay import ErrorRow, Replay, error_rows
from softrobot_env.identification.replay import replay as replayed
from softrobot_env.recordings import Recording, read_recording
from softrobot_env.recordings.header import UNITS
from softrobot_env.recordings.recording import Summary, summarize
from softrobot_env.rendering.recordings import plot_replay
from softrobot_env.rendering.tables import Column, PlainTable, make_table, named_values, new_table
from softrobot_env.robots import RobotParams, find_robot

from . import arguments, output
from .output import say
from .registry import Command

EXAMPLE = "softrobot recording check train.csv --header assets/recordings/ftdcr_v4.toml"


FILE_TEXT = """
    recording FILE  a table, .csv or .parquet; or an .mcap file, or the folder of a Minari data set
    --header TOML  describes the columns, with priority over NAME.toml beside the table; default:
        NAME.toml alone
"""


# ---------------------------------------------------------------- check

_PATTERNS = 12  # listed at most


def _check(args: Namespace) -> int:
    """Refuse a file with errors, and report what is unusual."""
    recording = read_recording(args.recording, args.header)
    summary = summarize(recording, None if args.robot is None else find_robot(args.robot))
    say(named_values(str(args.recording), _values(recording, summary)))
    say(_ranges(recording, summary))
    for warning in summary.warnings:
        say(f"Look at: {warning}", markup=False, soft_wrap=True)
    return 0


def _values(recording: Recording, summary: Summary) -> dict[str, str]:
    head = recording.header
    rate = "" if summary.rate is None else f", mostly {summary.rate:.4g} a second"
    late = f", the first before row {summary.gaps[0]}" if summary.gaps else ""
    named = [f"{name} ({rows})" for name, rows in summary.patterns.items() if name]
    more = [f"and {len(named) - _PATTERNS} more"] if len(named) > _PATTERNS else []
    return {
        "robot": head.robot or "not said",
        "rows": f"{summary.rows}{rate}",
        "motion": "at rest in every row" if recording.static else "moves between rows",
        "runs": f"{summary.runs}, {summary.duration:.4g} s together",
        "gaps": f"{len(summary.gaps)}{late}; longest {summary.longest_gap:.3g} s",
        "commands": f"{len(head.commands.columns)}, {recording.kind}",
        "markers": str(len(head.marker)),
        "patterns": ", ".join([*named[:_PATTERNS], *more]) or "none",
    }


def _ranges(recording: Recording, summary: Summary) -> PlainTable:
    head = recording.header
    table = new_table("Ranges", ("column", "drives"), ("from", "to", "unit"))
    drives = head.commands.tendons or ("",) * len(head.commands.columns)
    unit = "mm" if head.commands.unit in UNITS["angle"] else head.commands.unit
    size = UNITS[recording.kind][unit]
    rows = zip(head.commands.columns, drives, summary.command_range, strict=True)
    for name, tendon, (low, high) in rows:
        table.add_row(name, tendon, f"{low / size:.4g}", f"{high / size:.4g}", unit)
    for k, marker in enumerate(summary.marker_range, 1):
        for axis, (low, high) in zip("xyz", 1e3 * marker, strict=True):
            if not np.isnan(low):
                table.add_row(f"marker {k} {axis}", "", f"{low:.4g}", f"{high:.4g}", "mm")
    return table


# ---------------------------------------------------------------- replay

#: The header that an identification writes next to its robot file.
_BESIDE_ROBOT = "recording.toml"

_ERRORS = {"rms": "RMS mm", "mean": "mean", "max": "max", "rms_centred": "centred: RMS"}
_ERRORS |= {"mean_centred": "mean", "max_centred": "max"}
_COLUMNS = (
    Column("pattern"),
    Column("rows", form="d"),
    *(Column(heading, value, ".2f", "mm") for value, heading in _ERRORS.items()),
)
_CAPTION = "centred: with the mean offset over all rows removed"

_LEARNED = "with residual"

_WORST = 5  # patterns on the terminal


@output.filling
def _replay(args: Namespace) -> int:
    """Replay, print and write; 1 if a part of the recording could not be simulated."""
    robot = find_robot(args.robot)
    header = args.header or _beside(robot, _BESIDE_ROBOT)
    if header is not None and args.header is None:
        say(f"Header: {header}", soft_wrap=True)
    recording = read_recording(args.recording, header)
    count = len(recording.times)
    with output.progress_on("replay", count) as show:
        result = replayed(
            recording, robot, args.plant, args.twin, lambda rows: show("replay", rows, count)
        )
    rows = error_rows(result)
    title = f"{args.recording.name}: {robot.name}, {args.plant}"
    count = len(rows) - 1
    few = f" (the worst {_WORST} of {count} patterns)" if count > _WORST else ""
    say(make_table(f"{title}{few}", _COLUMNS, _worst(rows), caption=_CAPTION))
    failed = (f"Failed: {failure}" for failure in result.failures)
    expected = _expected(result)
    notes = [*result.notes, *([] if expected is None else [str(expected)]), *failed]
    for line in notes:
        say(line, soft_wrap=True, markup=False)
    common = {"robot": robot.name, "plant": args.plant, "cpu_time": result.cpu_time}
    columns = [common | asdict(row) for row in rows]
    if expected is not None:
        told = asdict(expected).items()
        columns[0] |= {f"interval_{name}": value for name, value in told if name != "over"}
    parts = [make_table(title, _COLUMNS, rows, caption=_CAPTION), *notes]
    learned = _with_residual(result)
    if learned is not None:
        better, title = error_rows(learned), f"{title}, {_LEARNED}"
        say(make_table(title, _COLUMNS, better[:1], caption=_CAPTION))
        columns += [common | {"model": _LEARNED} | asdict(row) for row in better]
        parts.append(make_table(title, _COLUMNS, better, caption=_CAPTION))
    say(f"{result.cpu_time:.1f} s of CPU time")
    draw = partial(plot_replay, result, rows, args.out)
    output.write_report(args, columns, "Replay of a recording", Group(*parts), draw)
    return int(bool(result.failures))


def _with_residual(result: Replay) -> Replay | None:
    """The replay corrected by the residual model next to an identified robot's file."""
    path = _beside(result.robot, RESIDUAL_FILE)
    if path is None or not result.static:
        return None
    change = corrected(read_residual(path), result.robot, result.recording)
    return replace(result, simulated=result.simulated + change)


def _expected(result: Replay) -> Judgement | None:
    """Comparison of the errors with those expected by the robot's identification."""
    path = _beside(result.robot, PREDICTION_FILE)
    if path is None or not result.static:
        return None
    return read_prediction(path).judged(result.robot, result.recording, result.distance)


def _worst(rows: list[ErrorRow]) -> list[ErrorRow]:
    """All rows together, and the patterns with the largest errors."""
    known = [row for row in rows[1:] if row.rms is not None]
    return [rows[0], *sorted(known, key=lambda row: -row.rms)[:_WORST]]


def _beside(robot: RobotParams, name: str) -> Path | None:
    """A file that an identification wrote next to the robot's, if there is one."""
    if robot.file is None:
        return None
    path = robot.file.parent / name
    return path if path.is_file() else None


_CHECK = arguments.command(
    """softrobot recording check train.csv
  softrobot recording check train.csv --header assets/recordings/ftdcr_v4.toml --robot ftdcr_v4""",
    f"{FILE_TEXT}\n<robot> to compare with; default: none",
    _check,
)

_REPLAY = arguments.command(
    """softrobot recording replay test.csv --robot out/identify/robot.toml
  softrobot recording replay train.csv --header my_header.toml --robot my.toml --plant cosserat""",
    f"""
    {FILE_TEXT}
    <robot!> {_BESIDE_ROBOT} beside the file counts as --header unless that is given, and
        residual.npz as a correction that is reported apart; by prediction.npz it is said whether
        the errors are as expected, and how far commands leave the identified range
    <plant>
    --twin TWIN  errors of manufacturing, servos and tendons, of a robot driven by length; default:
        none
    <no-plots>
    --out DIR (out/replay)
    <overwrite>
    """,
    _replay,
)

#: The commands of `softrobot recording`.
COMMANDS: Mapping[str, Command] = {
    "check": (_CHECK, "say whether a recording is good, what it holds and what is odd"),
    "replay": (
        _REPLAY,
        "simulate a recording's commands with a robot; report the error of its markers",
    ),
}
