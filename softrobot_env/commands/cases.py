"""The robots and the episodes that commands are asked for."""

import argparse
import itertools
from collections.abc import Iterator

from softrobot_env.commands.arguments import expand_all
from softrobot_env.commands.setups import SIMULATED, ArmSetup, RigSetup, Setup, setup_of
from softrobot_env.commands.task_options import Given, check_used, combinations, merge
from softrobot_env.control.registry import POLICIES, RIG_POLICIES, installed_policies
from softrobot_env.envs.disturbances import NEUTRAL
from softrobot_env.evaluation.runner import Case
from softrobot_env.tasks import STEP_WIDTHS, TASKS, make_task

#: Arguments that only robots over a serial line have.
_SERIAL = ("robot_file", "port", "record")


def make_setups(args: argparse.Namespace) -> tuple[Setup, ...]:
    """One setup for every kind of robot.

    Each task belongs to one of them.

    Raises:
        ValueError: Arguments of a robot over a serial line for a simulated one.
        ImportError: Packages of the extra `robot` are missing.
    """
    if getattr(args, "env", SIMULATED) != SIMULATED:
        from softrobot_env.commands.robot.setup import RealSetup

        return ArmSetup(args), RealSetup(args)
    given = [f"--{name.replace('_', '-')}" for name in _SERIAL if getattr(args, name, None)]
    if given:
        raise ValueError(f"{', '.join(given)}: only with --env real or virtual")
    return ArmSetup(args), RigSetup(args)


def make_cases(args: argparse.Namespace, setups: tuple[Setup, ...]) -> list[Case]:
    """Every combination of what was asked for that fits together.

    Raises:
        ValueError: A policy without a task or a task without a policy, an option that no case
            uses, or a value that a case cannot have; before anything is run.
    """
    tasks = expand_all(args.tasks, list(TASKS))
    given = _given_options(args)
    _check_policies(args.policies, tasks, setups)
    check_used(given, tasks)
    cases = []
    for name in tasks:
        setup = setup_of(name, setups)
        policies = _fitting(args.policies, setup)
        if not policies:
            raise ValueError(
                f"no policy for task {name!r} among {', '.join(args.policies)}; it can have "
                f"{', '.join(setup.policies)}"
            )
        cases += _of_task(name, {"step_width": list(STEP_WIDTHS)} | given, policies, setup, args)
    for setup in setups:
        setup.check([case for case in cases if case.task.name in setup.tasks])
    return cases


def _of_task(
    name: str,
    given: Given,
    policies: list[str],
    setup: Setup,
    args: argparse.Namespace,
) -> Iterator[Case]:
    conditions = list(itertools.product(setup.twins(), _variations(args.vary)))
    for options in combinations(name, given):
        task = make_task(name, **options)
        for policy in policies:
            for twin, variation in conditions:
                yield setup.complete(Case(task, policy, variation, twin))


def left_out(args: argparse.Namespace, cases: list[Case]) -> list[str]:
    """Policies that would have been run if their packages were installed."""
    missing = [name for name in POLICIES if name not in installed_policies()]
    wanted = "all" in args.policies and any(case.policy in POLICIES for case in cases)
    return missing if wanted else []


def _fitting(names: list[str], setup: Setup) -> list[str]:
    """Policies among those named that can drive a robot."""
    runnable = [*installed_policies(), *RIG_POLICIES]
    ready = [name for name in setup.policies if name in runnable]
    return ready if "all" in names else [n for n in dict.fromkeys(names) if n in setup.policies]


def _check_policies(names: list[str], tasks: list[str], setups: tuple[Setup, ...]) -> None:
    used = {setup_of(task, setups) for task in tasks}
    for name in (name for name in names if name != "all"):
        able = [setup for setup in setups if name in setup.policies]
        if not used & set(able):
            fitting = ", ".join(itertools.chain(*(setup.tasks for setup in able)))
            raise ValueError(f"policy {name!r} is for the tasks {fitting}")


def _variations(given: list[tuple[str, list[float]]]) -> list[dict[str, float]]:
    """Every combination of what varies, without the values that change nothing."""
    varied = merge(given)
    combinations = itertools.product(*varied.values())
    return [{n: v for n, v in zip(varied, c, strict=True) if v != NEUTRAL[n]} for c in combinations]


def _given_options(args: argparse.Namespace) -> Given:
    """Values given for options of tasks, in whatever form."""
    short = {"step_width": args.step_widths, "speed": args.speeds, "seed": args.path_seeds}
    return merge([*args.option, *((name, values) for name, values in short.items() if values)])
