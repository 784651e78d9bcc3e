"""`softrobot benchmark`: runs a study, writes its report and draws its pictures."""

import argparse
from pathlib import Path

from rich.console import Console

from softrobot_env.commands import own_robot
from softrobot_env.commands.arguments import add_robot, add_workers, seed
from softrobot_env.commands.output import add_out, changed_results, drawn, new_results, progress_on
from softrobot_env.core.files import write_text
from softrobot_env.core.processes import using
from softrobot_env.core.runs import KEPT, Record, kept_rows
from softrobot_env.core.studies import BENCHMARKS, Benchmark, measured
from softrobot_env.evaluation import stored
from softrobot_env.rendering.tables import text_page

EXAMPLE = """softrobot benchmark speed --quick
  softrobot benchmark accuracy --robot my.toml
  softrobot benchmark laws --redraw"""

#: Options of some benchmarks -> help.
_OPTIONS = {
    "count": "scenes only: number of random scenes; default: 200, 20 of a quick run",
    "seed": "scenes only: what they are drawn from; default: 0",
}

_NOT_HERE = (
    "there is no study {!r} here: the package's own are in scripts/studies of its repository, not "
    "in the wheel; clone it and run this command there (known here: {})"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    told = "".join(f"\n  {name:<16}{measured(name)}" for name in BENCHMARKS)
    parser.description = f"{parser.description}:{told}"
    known = tuple(dict.fromkeys((*BENCHMARKS, *own_robot.CHECKS))) if BENCHMARKS else None
    parser.add_argument("what", choices=known, metavar="WHAT", help="one of the above")
    parser.add_argument("--quick", action="store_true", help="fewer cases, under 45 s")
    parser.add_argument(
        "--redraw",
        action="store_true",
        help="measure nothing: draw the pictures of the report that is there anew",
    )
    for name, what in _OPTIONS.items():
        parser.add_argument(f"--{name}", type=seed, metavar="N", help=what)
    add_robot(
        parser,
        "accuracy and stability only: measure the models of this robot in place of the study's",
    )
    add_workers(parser, "; default: as many processes as the benchmark is made for")
    add_out(parser, "out/benchmark", "; a folder of what is measured is made in it")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    if args.robot is not None:
        return own_robot.run(args)
    if args.what not in BENCHMARKS:
        raise ValueError(_NOT_HERE.format(args.what, ", ".join(BENCHMARKS) or "none"))
    benchmark = BENCHMARKS[args.what]()
    options = _own_options(args, benchmark.options)
    if benchmark.alone and args.workers is not None:
        raise ValueError(f"the benchmark {args.what} runs one job after the other: no --workers")
    console = Console()
    out = args.out / args.what
    if args.redraw:
        return _redraw(args, benchmark, out, console)
    with new_results(out, args.overwrite):
        _measure(args, benchmark, out, options, console)
    return 0


def _redraw(args: argparse.Namespace, benchmark: Benchmark, out: Path, console: Console) -> int:
    """Draw the pictures of a report anew; 1 where they could not be drawn."""
    given = [f"--{name}" for name in ("quick", *_OPTIONS, "workers") if getattr(args, name)]
    if given:
        raise ValueError(f"{given[0]} measures anew, --redraw measures nothing: give one of them")
    if benchmark.draw is None:
        raise ValueError(f"the benchmark {args.what} has no pictures")
    with changed_results(out):
        plotted = _draw(args.what, benchmark, out, console)
    if plotted:
        console.print(f"Drew the plots in {out} anew")
    return int(not plotted)


def _draw(what: str, benchmark: Benchmark, out: Path, console: Console) -> bool:
    """Pictures of a folder's report, and of nothing else, so that they can be drawn again."""
    if benchmark.draw is None:
        return False
    records = stored.read(out, benchmark.kinds)
    return drawn(lambda: benchmark.draw(records, out / f"{what}.png"), console)


def _measure(
    args: argparse.Namespace,
    benchmark: Benchmark,
    out: Path,
    options: dict[str, int],
    console: Console,
) -> None:
    """Run, print and write."""
    study = f"{args.what} quick={args.quick} {sorted(options.items())}"
    with kept_rows(out / KEPT, study, getattr(benchmark, "sources", ())) as kept:
        with progress_on(console) as progress, using(args.workers):
            bar = progress.add_task(args.what, total=None)

            def show(description: str, done: int, total: int) -> None:
                progress.update(bar, description=description, completed=done, total=total)

            records = benchmark.run(args.quick, show, kept=kept, **options)
        if kept.taken:
            console.print(f"Took up {kept.taken} cases that were done when an earlier run stopped")
        _write(args, benchmark, out, records, console)


def _write(
    args: argparse.Namespace,
    benchmark: Benchmark,
    out: Path,
    records: list[Record],
    console: Console,
) -> None:
    """Reports and plots."""
    stored.write(out, records, args.command_line)
    tables = benchmark.show(records)
    console.print(tables)
    text = text_page(f"Benchmark: {args.what}", tables, args.command_line)
    write_text(out / "report.md", text)
    plotted = _draw(args.what, benchmark, out, console)
    console.print(f"Wrote report.json, report.md{' and plots' if plotted else ''} to {out}")


def _own_options(args: argparse.Namespace, known: tuple[str, ...]) -> dict[str, int]:
    """Options that were given.

    Raises:
        ValueError: The benchmark does not have one of them.
    """
    given = {name: getattr(args, name) for name in _OPTIONS if getattr(args, name) is not None}
    foreign = [f"--{name}" for name in given if name not in known]
    if foreign:
        raise ValueError(f"the benchmark {args.what} takes no {', '.join(foreign)}")
    return given
