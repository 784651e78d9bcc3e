"""`softrobot recording replay`: how far a simulated robot is from a recorded one."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console, Group

from softrobot_env.beams.registry import MUJOCO, PLANTS
from softrobot_env.commands.arguments import twin
from softrobot_env.commands.output import add_out, drawn, new_results, progress_on
from softrobot_env.commands.recording.check import add_file
from softrobot_env.core.files import write_text
from softrobot_env.recordings import read_recording
from softrobot_env.rendering.tables import Column, make_table, text_page
from softrobot_env.robots import ROBOTS, RobotParams, find_robot

if TYPE_CHECKING:
    from softrobot_env.identification.replay import ErrorRow, Replay

EXAMPLE = """softrobot recording replay test.csv --robot out/identify/robot.toml
  softrobot recording replay train.csv --header my_header.toml --robot my.toml --plant cosserat"""

#: The header that an identification writes beside its robot file.
_BESIDE_ROBOT = "recording.toml"

_MM = {"form": ".2f", "unit": "mm"}

_COLUMNS = (
    Column("pattern", "pattern"),
    Column("rows", "rows", "d"),
    Column("RMS mm", "rms", **_MM),
    Column("mean", "mean", **_MM),
    Column("max", "max", **_MM),
    Column("centred: RMS", "rms_centred", **_MM),
    Column("mean", "mean_centred", **_MM),
    Column("max", "max_centred", **_MM),
)
_CAPTION = "centred: with the mean offset over all rows removed"

_LEARNED = "with residual"

_WORST = 5  # patterns on the terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_file(parser)
    parser.add_argument(
        "--robot",
        required=True,
        metavar="ROBOT",
        help=f"a robot file (*.toml), or a robot out of {', '.join(ROBOTS)}; {_BESIDE_ROBOT} "
        "beside the file counts as --header unless that is given, and residual.npz as a correction "
        "that is told apart",
    )
    parser.add_argument(
        "--plant",
        choices=PLANTS,
        default=MUJOCO,
        help="what is simulated: MuJoCo's chain or a beam model; default: mujoco",
    )
    parser.add_argument(
        "--twin",
        type=twin,
        metavar="SEED",
        help="errors of manufacturing, servos and tendons, of a robot driven by length; default: "
        "none",
    )
    parser.add_argument("--no-plots", action="store_true", help="skip the plots")
    add_out(parser, "out/replay")


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if a part of the recording could not be simulated."""
    with new_results(args.out, args.overwrite):
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    """Replay, print and write."""
    from softrobot_env.evaluation.report import write_json
    from softrobot_env.identification.replay import error_rows
    from softrobot_env.identification.replay import replay as replayed

    console = Console(highlight=False)
    robot = find_robot(args.robot)
    header = args.header or _beside(robot)
    if header is not None and args.header is None:
        console.print(f"Header: {header}", soft_wrap=True)
    recording = read_recording(args.recording, header)
    with progress_on(console) as progress:
        bar = progress.add_task("replay", total=len(recording.times))
        result = replayed(
            recording,
            robot,
            args.plant,
            args.twin,
            lambda rows: progress.update(bar, completed=rows),
        )
    rows = error_rows(result)
    title = f"{args.recording.name}: {robot.name}, {args.plant}"
    console.print(make_table(_title(title, rows), _COLUMNS, _worst(rows), caption=_CAPTION))
    told = [*result.notes, *(f"Failed: {failure}" for failure in result.failures)]
    for line in told:
        console.print(line, soft_wrap=True, markup=False)
    common = {"robot": robot.name, "plant": args.plant, "cpu_time": result.cpu_time}
    columns = [common | row.columns() for row in rows]
    write_json(args.out / "report.json", columns, args.command_line)
    table = make_table(title, _COLUMNS, rows, caption=_CAPTION)
    parts = [table, *told]
    learned = _with_residual(result)
    if learned is not None:
        better = error_rows(learned)
        console.print(make_table(f"{title}, {_LEARNED}", _COLUMNS, better[:1], caption=_CAPTION))
        columns += [common | {"model": _LEARNED} | row.columns() for row in better]
        write_json(args.out / "report.json", columns, args.command_line)
        parts.append(make_table(f"{title}, {_LEARNED}", _COLUMNS, better, caption=_CAPTION))
    text = text_page("Replay of a recording", Group(*parts), args.command_line)
    write_text(args.out / "report.md", text)
    console.print(f"{result.cpu_time:.1f} s of CPU time. Wrote {args.out}/report.json, report.md")
    if not args.no_plots:
        from softrobot_env.rendering.recordings import plot_replay

        if drawn(lambda: plot_replay(result, rows, args.out), console):
            console.print(f"Wrote plots to {args.out}")
    return int(bool(result.failures))


def _with_residual(result: "Replay") -> "Replay | None":
    """The replay corrected by what was learned of an identified robot, beside whose file it is."""
    from softrobot_env.identification.fit.residual import (
        RESIDUAL_FILE,
        corrected,
        read_residual,
    )

    file = result.robot.file
    path = None if file is None else file.parent / RESIDUAL_FILE
    if path is None or not path.is_file() or not result.static:
        return None
    change = corrected(read_residual(path), result.robot, result.recording)
    return replace(result, simulated=result.simulated + change)


def _worst(rows: "list[ErrorRow]") -> "list[ErrorRow]":
    """All rows together, and the patterns with the largest errors."""
    known = [row for row in rows[1:] if row.rms is not None]
    return [rows[0], *sorted(known, key=lambda row: -row.rms)[:_WORST]]


def _title(title: str, rows: "list[ErrorRow]") -> str:
    more = len(rows) - 1 - _WORST
    return f"{title} (the worst {_WORST} of {len(rows) - 1} patterns)" if more > 0 else title


def _beside(robot: RobotParams) -> Path | None:
    """The header beside a robot's file, where there is one."""
    if robot.file is None:
        return None
    path = robot.file.parent / _BESIDE_ROBOT
    return path if path.is_file() else None
