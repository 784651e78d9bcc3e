"""`softrobot evaluate`: policies on tasks, with table, report and plots."""

import argparse
from contextlib import closing

from rich.console import Console
from rich.progress import Progress

from softrobot_env.commands.evaluate.arguments import add_arguments as add_arguments
from softrobot_env.commands.evaluate.cases import left_out, make_cases
from softrobot_env.commands.evaluate.results import Result, plot, save_rollouts
from softrobot_env.commands.setups.base import Setup, setup_of
from softrobot_env.commands.setups.choice import make_setups
from softrobot_env.evaluation import report, runner
from softrobot_env.hardware.errors import RobotError

EXAMPLE = """softrobot evaluate --tasks swing --vary youngs_modulus=0.5,0.75,1,1.25,1.5
  softrobot evaluate --tasks triangle --option period=5,1 --twin 0
  softrobot evaluate --tasks triangle --twin 3 --learnt out/rig_nn_3.npz
  softrobot evaluate --tasks triangle --policies hybrid --env virtual"""


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if any episode failed."""
    console = Console()
    args.out.mkdir(parents=True, exist_ok=True)
    setups = make_setups(args)
    cases = make_cases(args, setups)
    missing = left_out(args, cases)
    if missing:
        console.print(f'Left out {", ".join(missing)}: pip install "softrobot_env\\[mpc]"')
    results = _run_cases(cases, setups, console)
    _write(results, args, console)
    return int(len(results) < len(cases) or any(result.row.failure for result in results))


def _run_cases(
    cases: list[runner.Case], setups: tuple[Setup, ...], console: Console
) -> list[Result]:
    """Results; those so far if a real robot does not go on."""
    results = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("evaluate", total=len(cases))
        for case in cases:
            progress.update(bar, description=case.label)
            try:
                with closing(setup_of(case.task.name, setups).environment(case)) as env:
                    results.append(Result(runner.run(case, env)))
            except RobotError as error:
                console.print(f"Ended before {case.label}: {error}")
                break
            progress.advance(bar)
    return results


def _write(results: list[Result], args: argparse.Namespace, console: Console) -> None:
    """Reports, records and plots; the table first, so that it is there without matplotlib."""
    rows = [result.columns for result in results]
    report.write_json(args.out / "report.json", rows, args.command_line)
    text = report.markdown(rows, args.command_line)
    (args.out / "report.md").write_text(text, encoding="utf-8")
    if args.save_rollouts:
        save_rollouts(results, args.out)
    for table in report.tables(rows):
        console.print(table)
    for note in report.notes(rows):
        console.print(note)
    console.print(f"Wrote {args.out}/report.json, report.md")
    if not args.no_plots:
        plot(results, args.out)
        console.print(f"Wrote plots to {args.out}")
