"""`softrobot benchmark`: models, controllers of arm and rig, speed, stability, thesis' figures."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from rich.console import Console, Group
from rich.progress import Progress

from softrobot_env.commands.arguments import add_out
from softrobot_env.evaluation.report import write_json

EXAMPLE = "softrobot benchmark speed --quick"

_WIDTH = 110  # characters of a report

#: What can be measured.
BENCHMARKS = (
    "accuracy",
    "controllers",
    "generalization",
    "learning",
    "rig",
    "rig_networks",
    "speed",
    "stability",
    "thesis",
)

#: Entry of a row with arrays for the pictures; reports go without.
_TRACE = "trace"


@dataclass(frozen=True)
class Benchmark:
    """How to measure, show and draw; not all have a picture."""

    run: Callable[..., list[dict]]
    tables: Callable[[list[dict]], Group]
    plot: Callable[[list[dict], Path], None] | None = None


def _load(what: str) -> Benchmark:
    if what == "accuracy":
        from softrobot_env.benchmarks import accuracy, accuracy_plots, accuracy_tables

        return Benchmark(accuracy.run, accuracy_tables.tables, accuracy_plots.plot)
    if what == "controllers":
        from softrobot_env.benchmarks import controllers, controllers_plots, controllers_tables

        return Benchmark(controllers.run, controllers_tables.tables, controllers_plots.plot)
    if what == "generalization":
        from softrobot_env.benchmarks import (
            generalization,
            generalization_plots,
            generalization_tables,
        )

        return Benchmark(
            generalization.run, generalization_tables.tables, generalization_plots.plot
        )
    if what == "learning":
        from softrobot_env.benchmarks import learning, learning_plots, learning_tables

        return Benchmark(learning.run, learning_tables.tables, learning_plots.plot)
    if what == "rig":
        from softrobot_env.benchmarks import rig, rig_plots, rig_tables

        return Benchmark(rig.run, rig_tables.tables, rig_plots.plot)
    if what == "rig_networks":
        from softrobot_env.benchmarks import (
            rig_networks,
            rig_networks_plots,
            rig_networks_tables,
        )

        return Benchmark(
            rig_networks.run_on_twin, rig_networks_tables.tables, rig_networks_plots.plot
        )
    if what == "stability":
        from softrobot_env.benchmarks import stability, stability_plots, stability_tables

        return Benchmark(stability.run, stability_tables.tables, stability_plots.plot)
    if what == "thesis":
        from softrobot_env.benchmarks import (
            thesis_figures,
            thesis_figures_plots,
            thesis_figures_tables,
        )

        return Benchmark(
            thesis_figures.run, thesis_figures_tables.tables, thesis_figures_plots.plot
        )
    from softrobot_env.benchmarks import speed

    return Benchmark(speed.run, speed.tables)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("what", choices=BENCHMARKS)
    parser.add_argument("--quick", action="store_true", help="fewer cases, under 45 s")
    add_out(parser, "out/benchmark", "; a folder of what is measured is made in it")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    console = Console()
    out = args.out / args.what
    out.mkdir(parents=True, exist_ok=True)
    benchmark = _load(args.what)
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(args.what, total=None)

        def show(description: str, done: int, total: int) -> None:
            progress.update(bar, description=description, completed=done, total=total)

        rows = benchmark.run(args.quick, show)
    write_json(out / "report.json", [_written(row) for row in rows], args.command_line)
    tables = benchmark.tables(rows)
    console.print(tables)
    (out / "report.md").write_text(_markdown(args.what, tables, args.command_line), "utf-8")
    if benchmark.plot is not None:
        benchmark.plot(rows, out / f"{args.what}.png")
    console.print(f"Wrote {', '.join(sorted(path.name for path in out.iterdir()))} to {out}")
    return 0


def _written(row: dict) -> dict:
    """A row as a report has it."""
    return {name: value for name, value in row.items() if name != _TRACE}


def _markdown(what: str, tables: Group, command: str) -> str:
    """The tables as they appear on a terminal, with the command that made them."""
    page = Console(record=True, width=_WIDTH, file=StringIO())
    page.print(tables)
    text = page.export_text()
    return f"# Benchmark: {what}\n\nMade by `{command}`.\n\n```text\n{text.rstrip()}\n```\n"
