"""`softrobot benchmark accuracy|stability --robot FILE`: the models of a robot of one's own."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

from rich.console import Console

from softrobot_env.commands.output import drawn, new_results, progress_on
from softrobot_env.core.files import write_text
from softrobot_env.evaluation.report import write_json
from softrobot_env.rendering.tables import text_page
from softrobot_env.robots import GRIPPERS, RobotParams, find_robot


class Check(NamedTuple):
    """How to measure a robot, from (robot, quick, progress), and to show its rows."""

    measure: Callable[..., list[Any]]
    tables: Callable[..., Any]
    plot: Callable[..., None]


def _accuracy() -> Check:
    from softrobot_env.evaluation.models.accuracy import measure
    from softrobot_env.rendering.models import accuracy_tables, plot_accuracy

    return Check(measure, accuracy_tables, plot_accuracy)


def _stability() -> Check:
    from softrobot_env.evaluation.models.stability import measure
    from softrobot_env.rendering.models import plot_stability, stability_tables

    return Check(measure, stability_tables, plot_stability)


#: What can be measured of any robot; each loads what it needs.
CHECKS: dict[str, Callable[[], Check]] = {"accuracy": _accuracy, "stability": _stability}


def run(args: argparse.Namespace) -> int:
    """Measure `args.what` of `args.robot`.

    Raises:
        ValueError: It cannot be measured of any robot, or the robot is none.
    """
    if args.what not in CHECKS:
        raise ValueError(
            f"the benchmark {args.what} measures its own robots: --robot goes with "
            f"{' and '.join(CHECKS)}; give it to softrobot evaluate or inspect for more"
        )
    if args.redraw:
        raise ValueError("--redraw draws the study's own report anew: leave out --robot")
    robot, check, console = _found(args.robot), CHECKS[args.what](), Console()
    out = args.out / args.what
    with new_results(out, args.overwrite):
        with progress_on(console) as progress:
            bar = progress.add_task(args.what, total=None)

            def show(text: str, done: int, total: int) -> None:
                progress.update(bar, description=text, completed=done, total=total)

            rows = check.measure(robot, args.quick, show)
        write_json(out / "report.json", [asdict(row) for row in rows], args.command_line)
        tables = check.tables(rows)
        console.print(tables)
        page = text_page(f"Benchmark: {args.what} of {robot.name}", tables, args.command_line)
        write_text(out / "report.md", page)
        picture = out / f"{args.what}.png"
        plotted = drawn(lambda: check.plot(rows, picture, robot.name), console)
        told = " and a picture" if plotted else ""
        console.print(f"Wrote report.json, report.md{told} to {out}")
    return 0


def _found(which: str) -> RobotParams:
    if which in GRIPPERS:
        raise ValueError(
            f"gripper {which!r} is several robots: give one of its fingers, such as gripper_finger"
        )
    return find_robot(which)
