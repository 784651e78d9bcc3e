"""Tasks of all robots and their options, as commands take them: `period=5,1`."""

import argparse
import itertools
from collections.abc import Mapping
from math import isfinite

from softrobot_env.commands.arguments import named_values, number, positive
from softrobot_env.core.registry import is_path
from softrobot_env.robots import ROBOTS, RobotParams, default_robot, entry_of
from softrobot_env.tasks import (
    EVERY_TASK,
    Maker,
    Task,
    defaults,
    find_maker,
    known_tasks,
    make_task,
    tasks_of,
    with_option,
)
from softrobot_env.tasks.generic import GENERIC_TASKS

#: Options of a task by name.
Options = dict[str, float]

#: Values given for options of tasks.
Given = dict[str, list[float]]


def task_help() -> str:
    """What --task can be, for people."""
    own = {name: ", ".join(tasks_of(robot).own()) for name, robot in ROBOTS.items()}
    named = "".join(f"of the {name}: {tasks}; " for name, tasks in own.items() if tasks)
    return (
        f"{named}of any --robot: {', '.join(GENERIC_TASKS.registered())}; or one's own, "
        "package.module:name or file.py:name"
    )


def option_names() -> list[str]:
    """Options of the tasks that have a robot."""
    return [name for name, tasks in with_option(EVERY_TASK).items() if tasks]


def task_name(text: str) -> str:
    """A task's name, or the path of one's own."""
    if not is_path(text) and text not in known_tasks():
        known = ", ".join(known_tasks())
        raise argparse.ArgumentTypeError(
            f"unknown task {text!r}; choose from {known}, or give package.module:name or "
            "file.py:name"
        )
    return text


def combinations(make: Maker, given: Given) -> list[Options]:
    """Options of a task in every combination of the values given for them."""
    own = defaults(make)
    values = []
    for option, default in own.items():
        kind = float if isinstance(default, float) else lambda seed: seed  # seeds stay whole
        values.append([v if v is None else kind(v) for v in given.get(option, [default])])
    return [
        dict(zip(own, chosen, strict=True))
        for chosen in itertools.product(*map(dict.fromkeys, values))
    ]


def check_used(given: Given, makers: Mapping[str, Maker], robot: RobotParams | None) -> None:
    """Refuse options that none of the tasks has.

    Raises:
        ValueError: The message names the tasks that have the option, or else all options.
    """
    here = with_option(makers)
    known = here | (with_option(EVERY_TASK) if robot is None else with_option(tasks_of(robot)))
    for name in given:
        if here.get(name):
            continue
        if not known.get(name):
            able = ", ".join(filter(known.get, known))
            raise ValueError(f"no task has the option {name!r}; choose from {able}")
        raise ValueError(f"{name} is an option of {', '.join(known[name])} only")


def option(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of an option of tasks and its values."""
    name, values = named_values(text)
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
        type=task_name,
        metavar="TASK",
        help=f"{task_help()}; default: swing of the arm, circle of --robot",
    )
    parser.add_argument(
        "--option",
        action="append",
        type=option,
        default=[],
        metavar="NAME=VALUE",
        help=f"an option of the task, in SI units, out of {', '.join(option_names())}",
    )
    parser.add_argument(
        "--step-width", type=positive, metavar="M", help="as --option step_width=..."
    )


def one_task(args: argparse.Namespace, robot: RobotParams | None) -> Task:
    """The task of `add_task`, for a robot unless it has its own.

    Raises:
        ValueError: An option of other tasks, several values of one, or one out of range.
    """
    width = [] if args.step_width is None else [("step_width", [args.step_width])]
    given = merge([*args.option, *width])
    name = args.task or entry_of(default_robot() if robot is None else robot).task
    make = find_maker(name, robot)
    check_used(given, {name: make}, robot)
    options, *more = combinations(make, given)
    if more:
        raise ValueError("--option: only one value of each for one task")
    return make_task(name, robot=robot, **options)
