"""`softrobot train` of several runs: seeds and settings, side by side, with one report."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from softrobot_env.commands.arguments import files_among
from softrobot_env.commands.output import drawn, inside, new_results, progress_on
from softrobot_env.core.files import write_text
from softrobot_env.core.processes import using
from softrobot_env.core.runs import KEPT, kept_rows
from softrobot_env.evaluation.report import write_json
from softrobot_env.rendering.tables import text_page
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import artifact_name
from softrobot_env.training.registry import LEARNERS, TRAININGS, check_reinforcement
from softrobot_env.training.request import TrainingRequest, file_of
from softrobot_env.training.rl_config import IMITATION

if TYPE_CHECKING:
    from softrobot_env.training.several.runs import Run

#: Where several runs are written, in a folder by the training's name.
SEVERAL = Path("out") / "trainings"

#: What only a single run takes.
_SINGLE = ("ship", "checkpoint", "resume")

#: Arguments that no run depends on.
ELSEWHERE = ("workers", "out", "overwrite", "log", "command", "command_line", "command_run")


def train_several(
    args: argparse.Namespace,
    name: str,
    robot: RobotParams,
    settings: Mapping[str, Any],
    values: Mapping[str, Sequence[float]],
) -> int:
    """Train with all seeds and values of settings; 1 if a run failed.

    Raises:
        ValueError: An argument that several runs do not take, seeds of a training without chance,
            or what a run would refuse.
        FileExistsError: There are results already, and no --overwrite.
    """
    from softrobot_env.training.several import report, runs

    given = [f"--{one}" for one in _SINGLE if getattr(args, one)]
    if given:
        raise ValueError(f"{', '.join(given)}: of a single run, not of --seeds and --workers")
    if args.seeds is not None and not TRAININGS[name].drawn:
        able = ", ".join(other for other, known in TRAININGS.items() if known.drawn)
        raise ValueError(f"--seeds: nothing in {name} is drawn at random; only with {able}")
    out = args.out or SEVERAL / name
    order = order_in(out, name, robot, settings, args.name)
    orders = runs.orders_of(order, args.seeds or (args.seed,), values)
    if name in LEARNERS:
        for one in orders.values():
            check_reinforcement(name, one)
    console = Console()
    study = study_in_words("train", args)
    files = files_in(args, out)
    with new_results(out, args.overwrite), kept_rows(out / KEPT, study, files) as kept:
        with progress_on(console) as progress, using(args.workers):
            bar = progress.add_task(name, total=len(orders))

            def show(what: str, done: int, total: int) -> None:
                progress.update(bar, description=f"{name}: {what}", completed=done, total=total)

            found = runs.run_all(name, orders, kept, show, args.overwrite)
        if kept.taken:
            console.print(f"Took up {kept.taken} runs that were done when the command stopped")
        write(args, out, f"Several runs of {name}", found, report.tables(found), console)
    best = report.best_of(found)
    if best is not None:
        path = out / best.folder / order.path.name
        console.print(f"Best: seed {best.seed}, {path}", soft_wrap=True, highlight=False)
    return int(any(run.failure for run in found))


def order_in(
    out: Path, name: str, robot: RobotParams, settings: Mapping[str, Any], file: str | None
) -> TrainingRequest:
    """What runs have in common, whose folders are in `out`, as is what they build on."""
    path = file_of(robot, inside(out, file or name), out.resolve())
    settings = dict(settings)
    if "recording" in settings:
        settings["recording"] = settings["recording"].resolve()
    beside = path.with_name(artifact_name(robot, IMITATION))
    if "start" in settings and Path(settings["start"]).is_file():
        settings["start"] = str(Path(settings["start"]).resolve())
    elif name in LEARNERS and "start" not in settings and beside.is_file():
        settings["start"] = str(beside)
    return replace(TrainingRequest(robot, path, 0, settings), near=path.parent)


def study_in_words(command: str, args: argparse.Namespace) -> str:
    """What a study is, by the arguments that its runs depend on."""
    given = {key: value for key, value in vars(args).items() if key not in ELSEWHERE}
    return f"{command} {sorted(given.items(), key=str)}"


def files_in(args: argparse.Namespace, out: Path) -> set[Path]:
    """Files that the runs depend on: those that are given, and what they build on in `out`."""
    given = [value for key, value in vars(args).items() if key not in ELSEWHERE]
    return files_among(given) | set(out.resolve().glob("*.npz"))


def write(
    args: argparse.Namespace,
    out: Path,
    title: str,
    found: "list[Run]",
    tables: Any,
    console: Console,
) -> None:
    """Report, page and curves."""
    from softrobot_env.training.several.report import plot

    write_json(out / "report.json", [run.row() for run in found], args.command_line)
    write_text(out / "report.md", text_page(title, tables, args.command_line))
    console.print(tables)
    curves = any(run.curve for run in found)
    plotted = curves and drawn(lambda: plot(found, out / "curves.png"), console)
    wrote = "report.json, report.md" + (", curves.png" if plotted else "")
    console.print(f"Wrote {wrote} to {out}", soft_wrap=True)
