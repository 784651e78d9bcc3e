"""`softrobot evaluate`: policies on tasks, with table, report and plots."""

from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from softrobot_env.core import under_way
from softrobot_env.core.extras import install_command
from softrobot_env.core.files import file_name, write_text
from softrobot_env.core.processes import using
from softrobot_env.core.runs import KEPT, Kept, kept_rows, run_cases
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.report import (
    beside_real_drives,
    identified_label,
    option_columns,
    robot_label,
    variation_label,
    write_json,
)
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import EvaluatedRow
from softrobot_env.hardware.errors import RobotError
from softrobot_env.recordings import write_recording
from softrobot_env.rendering import episodes
from softrobot_env.rendering.plots import DRAWN, plot_task, redraw
from softrobot_env.tasks import Task

from . import output
from .arguments import SIMULATED, study_of
from .cases import Setup, left_out, make_cases, make_setup
from .output import say

EXAMPLE = """softrobot evaluate --tasks swing --vary youngs_modulus=0.5,0.75,1,1.25,1.5
  softrobot evaluate --tasks triangle --option period=5,1 --twin 0
  softrobot evaluate --tasks triangle --twin 3 --identified out/rig_nn_3.npz
  softrobot evaluate --tasks triangle --policies hybrid --env virtual
  softrobot evaluate --robot my.toml --tasks circle my_tasks.py:lemniscate --policies all"""


USAGE = "softrobot evaluate [--tasks TASK ...] [--policies POLICY ...] [OPTION ...]"

ARGUMENTS = f"""
    <robot> all tasks are for it; default: those of the arm and the rig
    --tasks TASK+ (all)  out of `softrobot list tasks`, or one's own, package.module:name or
        file.py:name; default: all of --robot, of the arm step, swing, lshape
    --policies POLICY+ (all)  out of `softrobot list policies`, or your own, as with tasks;
        default: all that fit a task
    --duration S  default: the task's
    <plant>
    [options of tasks]
    --option NAME=V1,V2  values of an option of tasks, in SI units: <options>
    --step-widths M+  as --option step_width=...; default: 0.05 0.1 0.2
    --speeds V1,V2  as --option speed=...; of circle, figure_eight, random the largest of the
        reference, default: 0.1
    --path-seeds N+  as --option seed=...; default: 0
    [robots that differ from what the policies know]
    --vary NAME=V1,V2  values of one of <variations>: in SI units or as factors;
        controllers keep the nominal robot
    --randomize NAME=LOW,HIGH  ranges of the same quantities, of which --draws robots are
        sampled besides --vary; every policy gets the same ones
    --draws N  of --randomize; default: 5
    --real-drive  every episode also with a usual drive of real robots, which policies do not know:
        tendons that rub and servos with a force, a lag and a dead time, as far as the robot's file
        does not say what its own drive is like
    [the test rig]
    <twins>
    <identified>
    [rigs over a serial line]
    --env ENV ({SIMULATED})  tasks of the rig in simulation (sim), on a virtual robot
        over a serial line in real time, or on a real one; out of %(choices)s
    --robot-file FILE  of a real robot, see `softrobot robot calibrate`; default: the rig's
    <port>
    --record DIR  write commands and tip of every episode as a recording there, for `softrobot
        recording`; and of a serial line all messages
    [feedback]
    <feedback>
    [parallel episodes]
    <workers>, and resume after a stop; decisions take longer than alone;
        default: one after the other
    [what is written]
    --out DIR (out/evaluate)
    <overwrite>
    <no-plots>
    --redraw  run nothing: redraw the plots of an earlier run
    --save-rollouts  also write npz records
    <scene>
"""


class Result(NamedTuple):
    """An episode and its row of the report."""

    outcome: runner.Outcome
    row: EvaluatedRow

    @property
    def group(self) -> str:
        """Task, and robot or rig, of the episodes that one plot compares."""
        return self.outcome.case.robot_label

    @property
    def varied(self) -> str:
        """How the robot differs from the nominal one."""
        return variation_label(self.row.columns())


def _result(outcome: runner.Outcome) -> Result:
    case, known = outcome.case, outcome.case.identified
    row = outcome.row(
        EvaluatedRow,
        options=option_columns(dict(case.task.options)),
        twin=case.twin,
        feedback=case.feedback,
        identified=None if known is None else identified_label(known.twin),
        known_delay=case.delay,
        real_drive=case.real_drive,
        **asdict(approached_metrics(outcome.rollout, case.task.trajectory)),
    )
    return Result(outcome, row)


def run(args: Namespace) -> int:
    """Run the command; 1 if any episode failed."""
    return _redraw(args.out) if args.redraw else _evaluate(args)


def _redraw(out: Path) -> int:
    """Redraw an earlier run from its files alone."""
    with output.changed_results(out):
        files = sorted(out.glob(f"*{DRAWN}"))
        if not files:
            raise FileNotFoundError(f"{out}: there is no *{DRAWN} of an earlier run with plots")
        for file in files:
            redraw(file)
    say(f"Drew {len(files)} comparisons in {out} anew")
    return 0


@output.filling
def _evaluate(args: Namespace) -> int:
    """Run all cases and write the results."""
    if args.record is not None:
        output.check_folder(args.record)
        output.check_free(*sorted(args.record.glob("*.csv")), overwrite=args.overwrite)
    if args.workers is not None and args.env != SIMULATED:
        raise ValueError(f"--workers: only with --env {SIMULATED}")
    setup = make_setup(args)
    cases = make_cases(args, setup)
    missing = left_out(args, cases)
    if missing:
        say(f"Left out {', '.join(missing)}: {install_command('mpc')}", markup=False)
    if args.workers is None:
        results = _run_cases(cases, setup)
        _write(results, args)
    else:
        with kept_rows(args.out / KEPT, *study_of(args)) as kept:
            results = _run_side_by_side(cases, args, kept)
            if kept.taken:
                say(f"Took up {kept.taken} episodes of an earlier run that was stopped")
            _write(results, args)
    return int(len(results) < len(cases) or any(result.row.failure for result in results))


def _run_cases(cases: list[runner.Case], setup: Setup) -> list[Result]:
    """Results; those obtained so far if a real robot stops."""
    results = []
    with output.progress_on("evaluate", len(cases)) as show:

        def report(begun: int, case: runner.Case, now: float) -> None:
            lasts = case.duration or case.task.duration
            show(case.label, begun + min(1.0, now / lasts), len(cases))

        for begun, case in enumerate(cases):
            under_way.tell(f"{case.label}, {begun + 1} of {len(cases)}")
            report(begun, case, 0.0)
            try:
                with closing(setup.environment(case)) as env:
                    results.append(
                        _result(runner.run(case, env, None, partial(report, begun, case)))
                    )
            except RobotError as error:
                say(f"Ended before {case.label}: {error}")
                break
    return results


@dataclass(frozen=True)
class _Episode:
    """Data of an episode kept until all are done."""

    rollout: Rollout
    decision_period: float


def _run_side_by_side(cases: list[runner.Case], args: Namespace, kept: Kept) -> list[Result]:
    """Results computed in processes, including those kept from an earlier run."""
    with output.progress_on("evaluate", len(cases)) as show, using(args.workers):
        episodes = run_cases(
            enumerate(cases),
            lambda numbered: runner.run(numbered[1]),
            kinds=(_Episode,),
            kept=kept,
            key=lambda numbered: f"{numbered[0]} {numbered[1].label}",
            label=lambda numbered: numbered[1].label,
            arrived=lambda _, found: _Episode(found.rollout, found.decision_period),
            progress=show,
        )
    found = zip(cases, episodes, strict=True)
    return [_result(runner.Outcome(c, e.rollout, e.decision_period)) for c, e in found]


def _write(results: list[Result], args: Namespace) -> None:
    """Write reports, records and plots; the table first, which does not need matplotlib."""
    rows = beside_real_drives([result.row.columns() for result in results])
    write_json(args.out / "report.json", rows, args.command_line)
    write_text(args.out / "report.md", episodes.markdown(rows, args.command_line))
    if args.save_rollouts:
        for result in results:
            result.outcome.rollout.save(args.out / file_name(f"{_file_stem(result)}.npz"))
    if args.record is not None:
        _record(results, args.record)
        say(f"Wrote {len(results)} recordings to {args.record}", soft_wrap=True)
    for table in episodes.tables(rows):
        say(table)
    for note in episodes.notes(rows):
        say(note)
    say(f"Wrote {args.out}/report.json, report.md")
    if not args.no_plots:
        output.plotted(lambda: _plot(results, args.out))


def _record(results: list[Result], folder: Path) -> None:
    """A table and its header for every episode; equal names are numbered."""
    count = Counter[str]()
    for result in results:
        stem = _file_stem(result)
        count[stem] += 1
        name = stem if count[stem] == 1 else f"{stem}_{count[stem]}"
        outcome = result.outcome
        path = folder / file_name(f"{name}.csv")
        write_recording(outcome.rollout.recording(outcome.case.task), path)


def _plot(results: list[Result], out: Path) -> None:
    """Plot comparable episodes, and report it."""
    found = list(_comparisons(results))
    for rollouts, task, title, stem, varied in found:
        plot_task(rollouts, task, title, out, stem, varied)
    say(f"Wrote plots to {out}" if found else "No plots: nothing to compare")


def _comparisons(
    results: list[Result],
) -> Iterator[tuple[dict[str, Rollout], Task, str, str, bool]]:
    """Policies on each task, and variations of each policy where there are several.

    Policies are compared on the nominal robot, or on the only other one if that was not run.
    """
    for group in dict.fromkeys(result.group for result in results):
        same = [result for result in results if result.group == group]
        task, stem = same[0].outcome.case.task, _in_file_name(group)
        robots = {result.varied for result in same}
        if "" in robots or len(robots) == 1:
            label = "" if "" in robots else same[0].varied
            one = {r.row.policy: r.outcome.rollout for r in same if r.varied == label}
            yield one, task, ", ".join(filter(None, (group, label))), stem, False
        for name in dict.fromkeys(result.row.policy for result in same):
            mine = [result for result in same if result.row.policy == name]
            several = {robot_label(r.row.columns()) or "nominal": r.outcome.rollout for r in mine}
            if len(several) > 1:
                yield several, task, f"{group}, {name}", f"{stem}_{name}_varied", True


def _file_stem(result: Result) -> str:
    parts = [result.group, result.row.policy]
    parts += [f"{name}_{scale:g}" for name, scale in result.row.variation.items()]
    parts += [f"known_{result.row.known_delay:g}"] if result.row.known_delay else []
    parts += ["real_drive"] if result.row.real_drive else []
    return _in_file_name("_".join(parts))


def _in_file_name(label: str) -> str:
    return label.replace(",", "").replace(" ", "_").replace("/", "_")
