"""Tasks of all robots and their options, as commands take them: `period=5,1`."""

import argparse
import itertools
from inspect import signature
from math import isfinite

from softrobot_env.tasks import ALL_TASKS, Task, make_task
from softrobot_env.tasks.rig import RIG_TASKS, RigTask, make_rig_task

#: Tasks of all robots.
TASK_NAMES = (*ALL_TASKS, *RIG_TASKS)

#: Options of a task by name: numbers.
Options = dict[str, float]

#: Values given for options of tasks.
Given = dict[str, list[float]]


def default_options(task: str) -> Options:
    """Options of a task, and their values unless given."""
    parameters = signature((ALL_TASKS | RIG_TASKS)[task]).parameters
    return {name: parameter.default for name, parameter in parameters.items()}


#: Option -> tasks that have it.
OPTIONS = {
    option: tuple(task for task in TASK_NAMES if option in default_options(task))
    for option in dict.fromkeys(itertools.chain(*map(default_options, TASK_NAMES)))
}


def build_task(name: str, options: Options) -> Task | RigTask:
    """A task of any robot.

    Raises:
        ValueError: An option out of range.
    """
    make = make_task if name in ALL_TASKS else make_rig_task
    return make(name, **options)


def combinations(task: str, given: Given) -> list[Options]:
    """Options of a task in every combination of the values given for them."""
    own = default_options(task)
    values = [
        dict.fromkeys(_in_kind(value, default) for value in given.get(option, [default]))
        for option, default in own.items()
    ]
    return [dict(zip(own, chosen, strict=True)) for chosen in itertools.product(*values)]


def _in_kind(value: float, default: float) -> float:
    """A number as the task wants it; seeds stay whole."""
    return float(value) if isinstance(default, float) else value


def check_used(given: Given, tasks: list[str]) -> None:
    """Refuse options that none of the tasks has.

    Raises:
        ValueError: The message names the tasks that have the option.
    """
    for option in given:
        if not set(tasks) & set(OPTIONS[option]):
            raise ValueError(f"{option} is an option of {', '.join(OPTIONS[option])} only")


def option(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of an option of tasks and its values."""
    name, _, values = text.partition("=")
    if name not in OPTIONS or not values:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME=V1,V2,... with NAME out of {', '.join(OPTIONS)}"
        )
    return name, [_number(value) for value in values.split(",")]


def _number(text: str) -> float:
    """A number, whole where it is written so."""
    try:
        value = int(text) if text.isdecimal() else float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def merge(pairs: list[tuple[str, list[float]]]) -> Given:
    """Values by name; those of a name given twice add up."""
    merged: Given = {}
    for name, values in pairs:
        merged[name] = list(dict.fromkeys([*merged.get(name, []), *values]))
    return merged
