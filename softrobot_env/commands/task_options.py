"""Tasks of all robots and their options, as commands take them: `period=5,1`."""

import argparse
import itertools
from math import isfinite

from softrobot_env.commands.arguments import named_values, number, positive
from softrobot_env.tasks import EVERY_TASK, WITH_OPTION, Task, defaults, make_task

#: Options of a task by name.
Options = dict[str, float]

#: Values given for options of tasks.
Given = dict[str, list[float]]


def combinations(task: str, given: Given) -> list[Options]:
    """Options of a task in every combination of the values given for them."""
    own = defaults(EVERY_TASK[task])
    values = []
    for option, default in own.items():
        kind = float if isinstance(default, float) else lambda seed: seed  # seeds stay whole
        values.append(dict.fromkeys(map(kind, given.get(option, [default]))))
    return [dict(zip(own, chosen, strict=True)) for chosen in itertools.product(*values)]


def check_used(given: Given, tasks: list[str]) -> None:
    """Refuse options that none of the tasks has.

    Raises:
        ValueError: The message names the tasks that have the option.
    """
    for option in given:
        if not set(tasks) & set(WITH_OPTION[option]):
            raise ValueError(f"{option} is an option of {', '.join(WITH_OPTION[option])} only")


def option(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of an option of tasks and its values."""
    name, values = named_values(text, WITH_OPTION)
    # What is written as a whole number stays one.
    return name, [int(v) if v.isdecimal() else number(v, isfinite, "a number") for v in values]


def merge(pairs: list[tuple[str, list[float]]]) -> Given:
    """Values by name; those of a name given twice add up."""
    merged: Given = {}
    for name, values in pairs:
        merged[name] = list(dict.fromkeys([*merged.get(name, []), *values]))
    return merged


def add_task(parser: argparse.ArgumentParser) -> None:
    """--task, --option and --step-width, of commands that are about one task."""
    parser.add_argument(
        "--task",
        choices=tuple(EVERY_TASK),
        default="swing",
        metavar="TASK",
        help=f"out of {', '.join(EVERY_TASK)}; default: swing",
    )
    parser.add_argument(
        "--option",
        action="append",
        type=option,
        default=[],
        metavar="NAME=VALUE",
        help=f"an option of the task, in SI units, out of {', '.join(WITH_OPTION)}",
    )
    parser.add_argument(
        "--step-width", type=positive, metavar="M", help="as --option step_width=..."
    )


def one_task(args: argparse.Namespace) -> Task:
    """The task of `add_task`.

    Raises:
        ValueError: An option of other tasks, several values of one, or one out of range.
    """
    width = [] if args.step_width is None else [("step_width", [args.step_width])]
    given = merge([*args.option, *width])
    check_used(given, [args.task])
    options, *more = combinations(args.task, given)
    if more:
        raise ValueError("--option: only one value of each for one task")
    return make_task(args.task, **options)
