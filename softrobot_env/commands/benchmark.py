"""`softrobot benchmark`: runs a study, writes its report and draws its pictures."""

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from functools import partial

from softrobot_env.core.processes import using
from softrobot_env.core.registry import load
from softrobot_env.core.runs import KEPT, kept_rows
from softrobot_env.core.studies import BENCHMARKS, Benchmark, measured
from softrobot_env.evaluation import stored
from softrobot_env.robots import GRIPPERS, find_robot

from .arguments import declare, flags
from .output import (
    changed_results,
    filling,
    new_results,
    plotted,
    progress_on,
    say,
    write_page,
    write_report,
    write_tables,
)

EXAMPLE = """softrobot benchmark speed --quick
  softrobot benchmark accuracy --robot my.toml
  softrobot benchmark laws --redraw"""


#: Studies of any robot -> functions that measure (robot, quick, progress), make tables of the rows,
#: and plot them.
CHECKS = {
    "accuracy": (
        "softrobot_env.evaluation.models.accuracy:measure",
        "softrobot_env.rendering.models:accuracy_tables",
        "softrobot_env.rendering.models:plot_accuracy",
    ),
    "stability": (
        "softrobot_env.evaluation.models.stability:measure",
        "softrobot_env.rendering.models:stability_tables",
        "softrobot_env.rendering.models:plot_stability",
    ),
}

#: Options of some benchmarks.
_OPTIONS = ("count", "seed")

_NOT_HERE = (
    "there is no study {!r} here: the package's own are in scripts/studies of its repository, not "
    "in the wheel; clone it and run this command there (known here: {})"
)


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of the command."""
    names = "".join(f"\n  {name:<16}{measured(name)}" for name in BENCHMARKS)
    parser.description = f"{parser.description}:{names}"
    text = """
        what WHAT  one of the above
        --quick  fewer cases, under 45 s
        --redraw  measure nothing: make tables and pictures of the report that is there anew
        --count N  number of random scenes, robot files (files), rods (identify) or twins
            (intervals), and of no other benchmark; default: 200, 200, 100, 40, fewer of a quick run
        --seed SEED  scenes and files only: what they are sampled from; default: 0
        <robot> accuracy and stability only: measure the models of this robot in place of the
            study's
        <workers>; default: as many processes as the benchmark is made for
        --out DIR (out/benchmark)  a folder of what is measured is made in it
        <overwrite>
    """
    declare(parser, text, what=tuple({**BENCHMARKS, **CHECKS}) if BENCHMARKS else str)


def run(args: Namespace) -> int:
    """Run the command."""
    args.out /= args.what
    if args.robot is not None:
        return _measure_own(args)
    if args.what not in BENCHMARKS:
        raise ValueError(_NOT_HERE.format(args.what, ", ".join(BENCHMARKS) or "none"))
    benchmark = BENCHMARKS[args.what]()
    if foreign := flags(args, (name for name in _OPTIONS if name not in benchmark.options)):
        raise ValueError(f"the benchmark {args.what} takes no {foreign}")
    if benchmark.alone and args.workers is not None:
        raise ValueError(f"the benchmark {args.what} runs one job after the other: no --workers")
    return _redraw(args, benchmark) if args.redraw else _measure(args, benchmark)


def _redraw(args: Namespace, benchmark: Benchmark) -> int:
    """Redraw the tables and pictures of a report; 1 if pictures were not possible."""
    if given := flags(args, ("quick", *_OPTIONS, "workers")):
        raise ValueError(f"{given} measures anew, --redraw measures nothing: give one of them")
    with changed_results(args.out):
        tables = benchmark.show(stored.read(args.out, benchmark.kinds))
        write_tables(args.out, f"Benchmark: {args.what}", tables, stored.command(args.out))
        drawn = benchmark.draw is None or plotted(lambda: _draw(args, benchmark))
    if drawn:
        plots = "" if benchmark.draw is None else " and plots"
        say(f"Made report.md{plots} in {args.out} anew")
    return int(not drawn)


def _draw(args: Namespace, benchmark: Benchmark) -> None:
    """Draw pictures from a folder's report alone, so that they can be redrawn."""
    benchmark.draw(stored.read(args.out, benchmark.kinds), args.out / f"{args.what}.png")


@filling
def _measure(args: Namespace, benchmark: Benchmark) -> int:
    """Run, print and write reports and plots."""
    given = {name: getattr(args, name) for name in benchmark.options}
    given = {name: value for name, value in given.items() if value is not None}
    study = f"{args.what} quick={args.quick} {sorted(given.items())}"
    with kept_rows(args.out / KEPT, study, getattr(benchmark, "sources", ())) as kept:
        with progress_on(args.what) as show, using(args.workers):
            records = benchmark.run(args.quick, show, kept=kept, **given)
        if kept.taken:
            say(f"Took up {kept.taken} cases that were done when an earlier run stopped")
        stored.write(args.out, records, args.command_line)
        tables = benchmark.show(records)
        say(tables)
        draw = None if benchmark.draw is None else partial(_draw, args, benchmark)
        write_page(args, f"Benchmark: {args.what}", tables, draw)
    return 0


# ---------------------------------------------------------------- your own robots


def _measure_own(args: Namespace) -> int:
    """Measure `args.what` for `args.robot`, a robot of the user's.

    Raises:
        ValueError: The study does not take any robot, or there is no such robot.
    """
    if args.what not in CHECKS:
        raise ValueError(
            f"the benchmark {args.what} measures its own robots: --robot goes with "
            f"{' and '.join(CHECKS)}; give it to softrobot evaluate or inspect for more"
        )
    if args.redraw:
        raise ValueError("--redraw draws the study's own report anew: leave out --robot")
    if args.robot in GRIPPERS:
        raise ValueError(
            f"gripper {args.robot!r} is several robots: give one of its fingers, such as "
            "gripper_finger"
        )
    robot, (measure, tables_of, plot) = find_robot(args.robot), map(load, CHECKS[args.what])
    with new_results(args.out, args.overwrite):
        with progress_on(args.what) as show:
            rows = measure(robot, args.quick, show)
        tables, title = tables_of(rows), f"Benchmark: {args.what} of {robot.name}"
        say(tables)
        draw = partial(plot, rows, args.out / f"{args.what}.png", robot.name)
        write_report(args, [asdict(row) for row in rows], title, tables, draw)
    return 0
