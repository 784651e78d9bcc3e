"""Tasks by name."""

from collections.abc import Mapping
from dataclasses import replace

from softrobot_env.registries import Registry
from softrobot_env.robots import RobotParams, as_number
from softrobot_env.tasks.arm import ALL_TASKS
from softrobot_env.tasks.rig import RIG_TASKS
from softrobot_env.tasks.spec import OPTIONS, Maker, Task, defaults

#: Tasks of all robots.
EVERY_TASK: Registry[Maker] = Registry("task", ALL_TASKS | RIG_TASKS)

#: Option -> tasks that have it.
WITH_OPTION = {
    option: tuple(name for name, make in EVERY_TASK.items() if option in defaults(make))
    for option in OPTIONS
}


def make_task(
    name: str,
    step_width: float | None = None,
    /,
    *,
    among: Mapping[str, Maker] = EVERY_TASK,
    robot: str | RobotParams | None = None,
    **options: float | None,
) -> Task:
    """Build a task by name.

    Args:
        name: One of `among`.
        step_width: As the option of that name.
        among: The tasks to choose from.
        **options: Of the step `step_width` [m]; of other tasks `speed` [m/s] where the reference
            is fastest, `seed` of a random
            path or of set points, `period` [s] of a lap, `radius` [m], and `hold` [s] at each set
            point. None is as not given.

    Raises:
        ValueError: Unknown name, an option of another task, or one out of range.
    """
    make = Registry("task", among).find(name)
    given = {"step_width": step_width} | options
    made = defaults(make) | {k: v for k, v in given.items() if v is not None}
    for option, value in made.items():
        if option not in defaults(make):
            raise ValueError(
                f"task {name!r} has no option {option!r}; it has "
                f"{', '.join(defaults(make)) or 'none'}"
            )
        if as_number(value) is None:
            raise ValueError(f"option {option!r} must be a number, got {value!r}")
    return replace(make(**made), options=tuple(made.items()))


def remake_task(task: Task, /, **options: float) -> Task:
    """The task with some options changed; a robot or a start of its own stays.

    Raises:
        ValueError: As `make_task`.
    """
    given = dict(task.options)
    before, made = make_task(task.name, **given), make_task(task.name, **given | options)
    own = {n: getattr(task, n) for n in ("robot", "start_input")}
    return replace(made, **{n: v for n, v in own.items() if v != getattr(before, n)})


def options_of(name: str, _robot: str | RobotParams | None = None) -> tuple[str, ...]:
    """Names of the options of a task; none of an unknown one."""
    return tuple(defaults(EVERY_TASK[name])) if name in EVERY_TASK else ()
