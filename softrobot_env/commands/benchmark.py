"""`softrobot benchmark`: accuracy against cost, and speed."""

import argparse
import importlib

from rich.console import Console
from rich.progress import Progress

from softrobot_env.commands.arguments import add_out
from softrobot_env.evaluation.report import write_json

EXAMPLE = "softrobot benchmark speed --quick"

#: What can be measured: module in `softrobot_env.benchmarks` with `run` and `table`.
BENCHMARKS = ("accuracy", "speed")

#: Modules with `plot` for those that have one.
PLOTS = {"accuracy": "accuracy_plots"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("what", choices=BENCHMARKS)
    parser.add_argument("--quick", action="store_true", help="fewer cases, under 45 s")
    add_out(parser, "out/benchmark")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    console = Console()
    module = importlib.import_module(f"softrobot_env.benchmarks.{args.what}")
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(args.what, total=None)

        def show(description: str, done: int, total: int) -> None:
            progress.update(bar, description=description, completed=done, total=total)

        rows = module.run(args.quick, show)
    args.out.mkdir(parents=True, exist_ok=True)
    write_json(args.out / f"{args.what}.json", rows)
    console.print(module.table(rows))
    written = [f"{args.what}.json"]
    if args.what in PLOTS:
        plots = importlib.import_module(f"softrobot_env.benchmarks.{PLOTS[args.what]}")
        plots.plot(rows, args.out / f"{args.what}.png")
        written.append(f"{args.what}.png")
    console.print(f"Wrote {', '.join(written)} to {args.out}")
    return 0
