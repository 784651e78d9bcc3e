"""`softrobot recording check`: whether a recording is good, and what it holds."""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console

from softrobot_env.commands.arguments import add_robot
from softrobot_env.recordings import Recording, read_recording
from softrobot_env.recordings.header import UNITS
from softrobot_env.recordings.recording import Summary, summarize
from softrobot_env.rendering.tables import PlainTable, named_values, new_table
from softrobot_env.robots import find_robot

EXAMPLE = """softrobot recording check train.csv
  softrobot recording check train.csv --header assets/recordings/ftdcr_v4.toml --robot ftdcr_v4"""

_PATTERNS = 12  # at most that are listed


def add_file(parser: argparse.ArgumentParser) -> None:
    """The recording, and --header."""
    parser.add_argument(
        "recording",
        type=Path,
        metavar="FILE",
        help="a table, .csv or .parquet; or an .mcap file, or the folder of a Minari data set",
    )
    parser.add_argument(
        "--header",
        type=Path,
        metavar="TOML",
        help="says which column is what, before what NAME.toml beside the table says; "
        "default: NAME.toml alone",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_file(parser)
    add_robot(parser, "to compare with; default: none")


def run(args: argparse.Namespace) -> int:
    """Run the command; what is wrong with a file is refused, what is odd is told."""
    recording = read_recording(args.recording, args.header)
    robot = None if args.robot is None else find_robot(args.robot)
    summary = summarize(recording, robot)
    console = Console(highlight=False)
    console.print(named_values(str(args.recording), _values(recording, summary)))
    console.print(_ranges(recording, summary))
    for warning in summary.warnings:
        console.print(f"Look at: {warning}", markup=False, soft_wrap=True)
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
