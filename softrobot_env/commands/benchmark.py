"""`softrobot benchmark`: models, controllers of arm and rig, speed, stability, thesis' figures."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from pathlib import Path

from rich.console import Console, Group
from rich.progress import Progress

from softrobot_env.commands.arguments import add_out
from softrobot_env.evaluation.report import write_json

EXAMPLE = "softrobot benchmark speed --quick"

_WIDTH = 110  # characters of a report

_BENCHMARKS = "softrobot_env.benchmarks"

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
    """The functions of a benchmark, from its modules `NAME`, `NAME_tables` and `NAME_plots`."""
    module = import_module(f"{_BENCHMARKS}.{what}")
    if what == "speed":
        return Benchmark(module.run, module.tables)
    tables, plots = (import_module(f"{_BENCHMARKS}.{what}_{part}") for part in ("tables", "plots"))
    run = module.run_on_twin if what == "rig_networks" else module.run
    return Benchmark(run, tables.tables, plots.plot)


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
