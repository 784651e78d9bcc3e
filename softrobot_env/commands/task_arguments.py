"""Arguments of commands that are about one task."""

import argparse

from softrobot_env.commands.arguments import positive
from softrobot_env.commands.task_options import (
    OPTIONS,
    TASK_NAMES,
    Options,
    build_task,
    check_used,
    combinations,
    merge,
    option,
)
from softrobot_env.tasks import Task
from softrobot_env.tasks.rig import RigTask


def add_task(parser: argparse.ArgumentParser) -> None:
    """--task, --option and --step-width."""
    parser.add_argument(
        "--task",
        choices=TASK_NAMES,
        default="swing",
        metavar="TASK",
        help=f"out of {', '.join(TASK_NAMES)}; default: swing",
    )
    parser.add_argument(
        "--option",
        action="append",
        type=option,
        default=[],
        metavar="NAME=VALUE",
        help=f"an option of the task, in SI units, out of {', '.join(OPTIONS)}",
    )
    parser.add_argument(
        "--step-width", type=positive, metavar="M", help="as --option step_width=..."
    )


def one_task(args: argparse.Namespace) -> tuple[Task | RigTask, Options]:
    """The task of `add_task`, and all options it was made with.

    Raises:
        ValueError: An option of other tasks, several values of one, or one out of range.
    """
    width = [] if args.step_width is None else [("step_width", [args.step_width])]
    given = merge([*args.option, *width])
    check_used(given, [args.task])
    options, *more = combinations(args.task, given)
    if more:
        raise ValueError("--option: only one value of each for one task")
    return build_task(args.task, options), options
