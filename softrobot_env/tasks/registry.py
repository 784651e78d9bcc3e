"""Tasks by name."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from softrobot_env.registries import Registry
from softrobot_env.robots import RobotParams, as_number, find_robot
from softrobot_env.tasks.arm import ALL_TASKS
from softrobot_env.tasks.generic import generic_tasks
from softrobot_env.tasks.rig import RIG_TASKS
from softrobot_env.tasks.spec import OPTIONS, Maker, Task, defaults

#: Tasks of all robots.
EVERY_TASK: Registry[Maker] = Registry("task", ALL_TASKS | RIG_TASKS)

#: Option -> tasks that have it.
WITH_OPTION = {
    option: tuple(name for name, make in EVERY_TASK.items() if option in defaults(make))
    for option in OPTIONS
}


#: Robot -> its own tasks, before those that any robot can be given.
OWN_TASKS: dict[str, dict[str, Maker]] = {"arm": ALL_TASKS, "rig": RIG_TASKS}


def tasks_of(robot: RobotParams | str) -> Registry[Maker]:
    """The tasks of a robot: its own, and those that any robot can be given; errors as `find_robot`.

    Args:
        robot: The robot, the name of one, or a file that describes it.
    """
    robot = find_robot(robot) if isinstance(robot, str) else robot
    return Registry("task", generic_tasks(robot) | OWN_TASKS.get(robot.name, {}))


def make_task(
    name: str,
    step_width: float | None = None,
    /,
    *,
    robot: RobotParams | str | None = None,
    among: Mapping[str, Maker] = EVERY_TASK,
    **options: float | None,
) -> Task:
    """Build a task by name.

    Args:
        name: One of `tasks_of(robot)`; without a robot one of `among`.
        step_width: As the option of that name.
        robot: The robot, the name of one, or a file that describes it.
        among: The tasks to choose from without a robot.
        **options: Of the step `step_width` [m]; of other tasks `speed` [m/s] where the reference
            is fastest, `seed` of a random path or of set points, `period` [s] of a lap,
            `radius` [m], and `hold` [s] at each set point. None is as not given.

    Raises:
        ValueError: Unknown name, an option of another task, or one out of range; or the robot
            cannot do the task, or does not reach as far.
        OSError: The robot's file cannot be read.
    """
    if robot is not None:
        among = tasks_of(robot)
    make = Registry("task", among).find(name)
    return _made(name, make, {"step_width": step_width} | options)


def remake_task(task: Task, /, **options: float) -> Task:
    """The task with some options changed; a robot or start that was replaced by hand stays.

    Raises:
        ValueError: As `make_task`.
    """
    make = task.maker or EVERY_TASK.find(task.name)
    before = _as_it_was(task.name, make, task.options)
    made = _made(task.name, make, dict(task.options) | options)
    replaced = {
        name: getattr(task, name)
        for name in ("robot", "start_input")
        if getattr(task, name) != getattr(before, name)
    }
    return replace(made, **replaced)


@lru_cache(maxsize=64)
def _as_it_was(name: str, make: Maker, options: tuple[tuple[str, float], ...]) -> Task:
    return _made(name, make, dict(options))


def _made(name: str, make: Maker, options: Mapping[str, float | None]) -> Task:
    """The task with options, of which None is as not given."""
    known = defaults(make)
    given = {option: value for option, value in options.items() if value is not None}
    for option, value in given.items():
        if option not in known:
            raise ValueError(
                f"task {name!r} has no option {option!r}; it has {', '.join(known) or 'none'}"
            )
        if as_number(value) is None:
            raise ValueError(f"option {option!r} must be a number, got {value!r}")
    task = make(**given)
    return replace(task, options=task.options or tuple((known | given).items()), maker=make)


def options_of(name: str, robot: RobotParams | str | None = None) -> tuple[str, ...]:
    """Names of the options of a task, see `make_task`; none of an unknown one."""
    among = EVERY_TASK if robot is None else tasks_of(robot)
    return tuple(defaults(among[name])) if name in among else ()
