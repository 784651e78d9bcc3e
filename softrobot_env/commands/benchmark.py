"""`softrobot benchmark`: runs a study, writes its report and draws its pictures."""

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path

from softrobot_env.core.files import write_text
from softrobot_env.core.processes import using
from softrobot_env.core.registry import load
from softrobot_env.core.runs import KEPT, kept_rows
from softrobot_env.core.studies import BENCHMARKS, Benchmark, measured
from softrobot_env.evaluation import stored
from softrobot_env.rendering.tables import text_page
from softrobot_env.robots import GRIPPERS, find_robot

from .arguments import declare, flags
from .output import changed_results, new_results, plotted, progress_on, say, write_report

EXAMPLE = """softrobot benchmark speed --quick
  softrobot benchmark accuracy --robot my.toml
  softrobot benchmark laws --redraw"""


#: What can be measured of any robot -> what measures it, from (robot, quick, progress), makes
#: tables of its rows, and plots them.
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
        --redraw  measure nothing: draw the pictures of the report that is there anew
        --count N  scenes only: number of random scenes; default: 200, 20 of a quick run
        --seed SEED  scenes only: what they are sampled from; default: 0
        <robot> accuracy and stability only: measure the models of this robot in place of the
            study's
        <workers>; default: as many processes as the benchmark is made for
        --out DIR (out/benchmark)  a folder of what is measured is made in it
        <overwrite>
    """
    declare(parser, text, what=tuple({**BENCHMARKS, **CHECKS}) if BENCHMARKS else str)


def run(args: Namespace) -> int:
    """Run the command."""
    if args.robot is not None:
        return _run_own(args)
    if args.what not in BENCHMARKS:
        raise ValueError(_NOT_HERE.format(args.what, ", ".join(BENCHMARKS) or "none"))
    benchmark = BENCHMARKS[args.what]()
    options = _own_options(args, benchmark.options)
    if benchmark.alone and args.workers is not None:
        raise ValueError(f"the benchmark {args.what} runs one job after the other: no --workers")
    out = args.out / args.what
    if args.redraw:
        return _redraw(args, benchmark, out)
    with new_results(out, args.overwrite):
        _measure(args, benchmark, out, options)
    return 0


def _redraw(args: Namespace, benchmark: Benchmark, out: Path) -> int:
    """Plot a report anew; 1 where that was not possible."""
    if given := flags(args, ("quick", *_OPTIONS, "workers")):
        raise ValueError(f"{given} measures anew, --redraw measures nothing: give one of them")
    if benchmark.draw is None:
        raise ValueError(f"the benchmark {args.what} has no pictures")
    with changed_results(out):
        plotted = _draw(args.what, benchmark, out)
    if plotted:
        say(f"Drew the plots in {out} anew")
    return int(not plotted)


def _draw(what: str, benchmark: Benchmark, out: Path) -> bool:
    """Pictures of a folder's report, and of nothing else, so that they can be made again."""
    if benchmark.draw is None:
        return False
    records = stored.read(out, benchmark.kinds)
    return plotted(lambda: benchmark.draw(records, out / f"{what}.png"))


def _measure(args: Namespace, benchmark: Benchmark, out: Path, options: dict[str, int]) -> None:
    """Run, print and write reports and plots."""
    study = f"{args.what} quick={args.quick} {sorted(options.items())}"
    with kept_rows(out / KEPT, study, getattr(benchmark, "sources", ())) as kept:
        with progress_on(args.what) as show, using(args.workers):
            records = benchmark.run(args.quick, show, kept=kept, **options)
        if kept.taken:
            say(f"Took up {kept.taken} cases that were done when an earlier run stopped")
        stored.write(out, records, args.command_line)
        tables = benchmark.show(records)
        say(tables)
        text = text_page(f"Benchmark: {args.what}", tables, args.command_line)
        write_text(out / "report.md", text)
        plotted = _draw(args.what, benchmark, out)
        say(f"Wrote report.json, report.md{' and plots' if plotted else ''} to {out}")


def _own_options(args: Namespace, known: tuple[str, ...]) -> dict[str, int]:
    """Options that were given.

    Raises:
        ValueError: The benchmark does not have one of them.
    """
    if foreign := flags(args, (name for name in _OPTIONS if name not in known)):
        raise ValueError(f"the benchmark {args.what} takes no {foreign}")
    return {name: getattr(args, name) for name in known if getattr(args, name) is not None}


# ---------------------------------------------------------------- robots of one's own


def _run_own(args: Namespace) -> int:
    """Measure `args.what` of `args.robot`, a robot of one's own.

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
    if args.robot in GRIPPERS:
        raise ValueError(
            f"gripper {args.robot!r} is several robots: give one of its fingers, such as "
            "gripper_finger"
        )
    robot, (measure, tables_of, plot) = find_robot(args.robot), map(load, CHECKS[args.what])
    out = args.out / args.what
    with new_results(out, args.overwrite):
        with progress_on(args.what) as show:
            rows = measure(robot, args.quick, show)
        tables, title = tables_of(rows), f"Benchmark: {args.what} of {robot.name}"
        say(tables)
        write_report(out, [asdict(row) for row in rows], title, tables, args.command_line)
        picture = out / f"{args.what}.png"
        pictures = " and a picture" if plotted(lambda: plot(rows, picture, robot.name)) else ""
        say(f"Wrote report.json, report.md{pictures} to {out}")
    return 0
