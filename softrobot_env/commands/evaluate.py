"""`softrobot evaluate`: policies on tasks, with table, report and plots."""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import (
    add_feedback,
    add_out,
    add_plant,
    expand_all,
    names_or_all,
    plant_options,
    positive,
    variation,
)
from softrobot_env.control.registry import POLICIES, installed_policies, make_policy
from softrobot_env.envs.disturbances import NEUTRAL, split
from softrobot_env.envs.tracking import DEFAULT_PERIOD, TrackingEnv
from softrobot_env.evaluation import report
from softrobot_env.evaluation.run import run_episode, warm_up
from softrobot_env.rollout import Rollout
from softrobot_env.tasks import ALL_TASKS, STEP_WIDTHS, TASKS, UNSEEN_TASKS, Task, make_task

EXAMPLE = "softrobot evaluate --tasks swing --vary youngs_modulus=0.5,0.75,1,1.25,1.5"

#: Duration [s] of evaluated step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0


@dataclass(frozen=True)
class Case:
    """One episode to run."""

    task: Task
    policy: str
    variation: dict[str, float]

    @property
    def label(self) -> str:
        """For the progress bar."""
        return f"{self.task.label}, {self.policy}"


@dataclass(frozen=True)
class Outcome:
    """An episode, its record and its row of the report."""

    case: Case
    rollout: Rollout
    row: report.Row

    @property
    def shown_row(self) -> report.Row:
        """The row for people, with seed and speed in the name of the task."""
        task = self.case.task
        return self.row if task.step_width is not None else self.row | {"task": task.label}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "--tasks",
        nargs="+",
        type=names_or_all(list(ALL_TASKS)),
        default=["all"],
        metavar="TASK",
        help=f"out of {', '.join(ALL_TASKS)}; default: all, which is {', '.join(TASKS)}",
    )
    parser.add_argument(
        "--policies",
        nargs="+",
        type=names_or_all(list(POLICIES)),
        default=["all"],
        metavar="POLICY",
        help=f"out of {', '.join(POLICIES)}; default: all",
    )
    parser.add_argument(
        "--step-widths",
        nargs="+",
        type=positive,
        default=list(STEP_WIDTHS),
        metavar="M",
        help="widths [m] of the step task; default: 0.05 0.1 0.2",
    )
    parser.add_argument(
        "--speeds",
        type=_speeds,
        metavar="V1,V2",
        help=f"largest speeds [m/s] of the references of {', '.join(UNSEEN_TASKS)}; default: 0.1",
    )
    parser.add_argument(
        "--path-seeds",
        nargs="+",
        type=int,
        metavar="N",
        help="seeds of the paths of the random task; default: 0",
    )
    parser.add_argument(
        "--vary",
        action="append",
        type=variation,
        default=[],
        metavar="NAME=V1,V2",
        help=f"values of one of {', '.join(NEUTRAL)}: of the plant, in SI units or as factors; "
        "controllers keep the nominal robot",
    )
    parser.add_argument("--no-plots", action="store_true", help="skip the plots")
    parser.add_argument("--save-rollouts", action="store_true", help="also write npz records")
    add_feedback(parser)
    add_plant(parser)
    add_out(parser, "out/evaluate")


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if any episode failed."""
    console = Console()
    args.out.mkdir(parents=True, exist_ok=True)
    left_out = [name for name in POLICIES if name not in installed_policies()]
    if left_out and "all" in args.policies:
        console.print(f'Left out {", ".join(left_out)}: pip install "softrobot_env\\[mpc]"')
    cases = list(_cases(args))
    _check(cases, args)
    outcomes = _run_cases(cases, args, console)
    rows = [outcome.row for outcome in outcomes]
    report.write_json(args.out / "report.json", rows, args.command_line)
    shown = [outcome.shown_row for outcome in outcomes]
    text = report.markdown(shown, args.command_line)
    (args.out / "report.md").write_text(text, encoding="utf-8")
    if args.save_rollouts:
        _save_rollouts(outcomes, args.out)
    for table in report.tables(shown):
        console.print(table)
    console.print(f"Wrote {args.out}/report.json, report.md")
    if not args.no_plots:
        _plot(outcomes, args.out)
        console.print(f"Wrote plots to {args.out}")
    return int(any(row["failure"] for row in rows))


def _cases(args: argparse.Namespace) -> Iterator[Case]:
    variations = _variations(args.vary)
    for task in _tasks(args):
        for policy in expand_all(args.policies, installed_policies()):
            for scales in variations:
                yield Case(task, policy, scales)


def _check(cases: list[Case], args: argparse.Namespace) -> None:
    """Refuse before the first episode what an environment would refuse in a later one.

    Raises:
        ValueError: An argument that no case uses, or a variation that a case cannot have.
    """
    names = {case.task.name for case in cases}
    if args.speeds and not names & set(UNSEEN_TASKS):
        raise ValueError(f"--speeds applies to {', '.join(UNSEEN_TASKS)} only")
    if args.path_seeds and "random" not in names:
        raise ValueError("--path-seeds applies to the random task only")
    for case in cases:
        if args.plant != MUJOCO and "tendon_friction" in case.variation:
            raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
        period = plant_options(args, case.policy).get("control_period", DEFAULT_PERIOD)
        try:
            split(case.variation, period)
        except ValueError as error:
            raise ValueError(f"{case.policy}: {error}") from None


def _tasks(args: argparse.Namespace) -> Iterator[Task]:
    for name in expand_all(args.tasks, list(TASKS)):
        if name == "step":
            yield from (make_task(name, width) for width in dict.fromkeys(args.step_widths))
        elif name in UNSEEN_TASKS:
            seeds = dict.fromkeys(args.path_seeds or [0]) if name == "random" else [None]
            for seed, speed in itertools.product(seeds, dict.fromkeys(args.speeds or [0.1])):
                yield make_task(name, speed=speed, seed=seed)
        else:
            yield make_task(name)


def _speeds(text: str) -> list[float]:
    """`0.05,0.1` as numbers."""
    return [positive(part) for part in text.split(",")]


def _variations(given: list[tuple[str, list[float]]]) -> list[dict[str, float]]:
    """Every combination of what varies, without the values that change nothing."""
    varied: dict[str, list[float]] = {}
    for name, values in given:
        varied[name] = list(dict.fromkeys([*varied.get(name, []), *values]))
    combinations = itertools.product(*varied.values())
    return [{n: v for n, v in zip(varied, c, strict=True) if v != NEUTRAL[n]} for c in combinations]


def _run_cases(cases: list[Case], args: argparse.Namespace, console: Console) -> list[Outcome]:
    environments: dict[str, TrackingEnv] = {}
    outcomes = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("evaluate", total=len(cases))
        for case in cases:
            progress.update(bar, description=case.label)
            options = plant_options(args, case.policy)
            task = case.task if case.task.step_width is None else make_task("step")
            name = f"{task.label}, {options}"
            if name not in environments:
                environments[name] = TrackingEnv(task, observe="all", **options)
            outcomes.append(_run_case(environments[name], case, args))
            progress.advance(bar)
    return outcomes


def _run_case(env: TrackingEnv, case: Case, args: argparse.Namespace) -> Outcome:
    policy = make_policy(case.policy, case.task.robot, env.control_period, args.feedback)
    options: dict[str, object] = {"vary": case.variation}
    if case.task.step_width is not None:
        options |= {"step_width": case.task.step_width, "duration": STEP_DURATION}
    warm_up(env, policy)
    rollout = run_episode(env, policy, seed=0, options=options)
    row = report.make_row(rollout, case.task, case.policy, args.plant, case.variation)
    row |= {"feedback": args.feedback, "speed": case.task.speed, "path_seed": case.task.seed}
    return Outcome(case, rollout, row)


def _file_stem(outcome: Outcome) -> str:
    parts = [outcome.case.task.label, outcome.case.policy]
    parts += [f"{name}_{scale:g}" for name, scale in outcome.case.variation.items()]
    return _in_file_name("_".join(parts))


def _in_file_name(label: str) -> str:
    return label.replace(" ", "_").replace("/", "_")


def _save_rollouts(outcomes: list[Outcome], out: Path) -> None:
    for outcome in outcomes:
        outcome.rollout.save(out / f"{_file_stem(outcome)}.npz")


def _plot(outcomes: list[Outcome], out: Path) -> None:
    """Compare policies on each task, and variations of each policy where there are several."""
    from softrobot_env.rendering.plots import plot_task

    for label in dict.fromkeys(o.case.task.label for o in outcomes):
        of_task = [o for o in outcomes if o.case.task.label == label]
        stem = _in_file_name(label)
        nominal = {o.case.policy: o.rollout for o in of_task if not o.case.variation}
        if nominal:
            plot_task(nominal, of_task[0].case.task, out, stem)
        for policy in dict.fromkeys(o.case.policy for o in of_task):
            varied = {
                report.variation_label(o.row) or "nominal": o.rollout
                for o in of_task
                if o.case.policy == policy
            }
            if len(varied) > 1:
                plot_task(varied, of_task[0].case.task, out, f"{stem}_{policy}_varied")
