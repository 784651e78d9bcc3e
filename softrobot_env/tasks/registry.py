"""Tasks by name."""

from collections.abc import Callable, Mapping
from dataclasses import replace as with_fields
from functools import lru_cache, partial
from inspect import signature

from softrobot_env.core.registry import (
    Registry,
    check_name,
    is_path,
    load_given,
    load_plugins,
    outside,
)
from softrobot_env.robots import RobotParams, as_number, find_robot

from .generic import GENERIC_TASKS, generic_tasks
from .spec import OPTIONS, Maker, Task, defaults

#: Tasks that were registered for one robot.
EVERY_TASK: Registry[Maker] = Registry("task", {})

#: Robot -> its own tasks, which precede those for any robot.
OWN_TASKS: dict[RobotParams, dict[str, Maker]] = {}


class TasksOf(Registry[Maker]):
    """The tasks of a robot: its own, and those that any robot can be given."""

    def __init__(self, robot: RobotParams) -> None:
        super().__init__("task", {})
        self._robot = robot

    def registered(self) -> dict[str, Maker]:
        """See `Registry`."""
        return generic_tasks(self._robot) | self.own()

    def own(self) -> dict[str, Maker]:
        """The robot's own tasks."""
        load_plugins()
        return OWN_TASKS.get(self._robot, {})


def tasks_of(robot: RobotParams | str) -> TasksOf:
    """The tasks of a robot: its own, and those for any robot; raises the errors of `find_robot`.

    Args:
        robot: The robot, the name of one, or a file that describes it.
    """
    return TasksOf(find_robot(robot))


def register_task(
    name: str,
    maker: Callable[..., Task],
    robot: RobotParams | str | None = None,
    *,
    replace: bool = False,
) -> None:
    """Add a task.

    Args:
        name: Its name.
        maker: Makes the task from its options, keyword arguments that are numbers with defaults.
            The maker of a task for any robot takes the robot as its first argument.
        robot: The robot that the task belongs to, or its name or file; the task can then be found
            by name alone unless another task has this name. By default the task is for any robot.
        replace: Whether it may replace another task of this name.

    Raises:
        ValueError: The name is taken, or the maker has a wrong signature.
        TypeError: The maker is not a function.
        OSError: The robot's file cannot be read.
    """
    check_name("task", name)
    check_maker(name, maker, takes_robot=robot is None)
    if robot is None:
        GENERIC_TASKS.register(name, maker, replace)
        return
    robot = find_robot(robot)
    own = OWN_TASKS.setdefault(robot, {})
    if name in own and not replace:
        raise ValueError(
            f"robot {robot.name!r} has a task {name!r} already; replace=True replaces it"
        )
    replaced = own.get(name)
    own[name] = maker
    if EVERY_TASK.registered().get(name) in (None, replaced):
        EVERY_TASK.register(name, maker, replace=True)


def check_maker(name: str, maker: Callable[..., Task], takes_robot: bool) -> None:
    """Raise TypeError or ValueError unless the maker can make a task."""
    if not callable(maker):
        raise TypeError(f"the maker of task {name!r} must be a function, got {maker!r}")
    first = needed(maker)
    if len(first) != takes_robot:
        wanted = "the robot alone" if takes_robot else "nothing, which is for one robot,"
        raise ValueError(
            f"the maker of task {name!r} must take {wanted} before options that have defaults, got "
            f"a function of {', '.join(first) or 'nothing'}"
        )


def needed(maker: Callable[..., Task]) -> list[str]:
    """Parameters of a maker without defaults."""
    return [n for n, p in signature(maker).parameters.items() if p.default is p.empty]


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
        name: One of `tasks_of(robot)`, without a robot one of `among`; or your own task as
            `package.module:name` or `file.py:name`: a `Task`, or a maker as in `register_task`.
        step_width: See the option of that name.
        robot: The robot, the name of one, or a file that describes it.
        among: The tasks to choose from without a robot.
        **options: For the step `step_width` [m]; for other tasks the largest `speed` [m/s], or the
            `frequency` of laps over that of the robot's first mode, `seed` of a random path or of
            set points, `period` [s] of a lap, `radius` [m], and `hold` [s] at each set point. None
            counts as not given.

    Raises:
        ValueError: Unknown name, an option of another task, or one out of range; or the robot
            cannot do the task, or does not reach as far.
        OSError: The robot's file cannot be read.
    """
    return made_by(find_maker(name, robot, among), name, {"step_width": step_width} | options)


def find_maker(
    name: str, robot: RobotParams | str | None = None, among: Mapping[str, Maker] = EVERY_TASK
) -> Maker:
    """The maker of a task; arguments and errors as in `make_task`."""
    if robot is None and not is_path(name):
        return (among if isinstance(among, Registry) else Registry("task", among)).find(name)
    robot = None if robot is None else find_robot(robot)
    return _given_maker(name, robot) if is_path(name) else TasksOf(robot).find(name)


def _given_maker(path: str, robot: RobotParams | None) -> Maker:
    """The maker of a task in a user's module or file, for a robot if it takes one."""
    found = load_given("task", path)
    if isinstance(found, Task):
        return _of_robot(path, lambda: found, robot)
    if not callable(found):
        raise ValueError(f"the task {path!r} must be a Task or a function, got {found!r}")
    check_maker(path, found, takes_robot=bool(needed(found)))
    if not needed(found):
        return _of_robot(path, found, robot)
    if robot is None:
        raise ValueError(f"the task {path!r} is for any robot: say which with robot")
    return partial(found, robot)


def _of_robot(path: str, make: Maker, robot: RobotParams | None) -> Maker:
    """The maker of a task with its own robot, which must be the requested one, if any."""
    own = made_by(make, path, {}).robot
    if robot not in (None, own):
        raise ValueError(f"the task {path!r} is for robot {own.name!r}, not {robot.name!r}")
    return make


def remake_task(task: Task, /, **options: float) -> Task:
    """The task with some options changed; a robot or start replaced by hand is kept.

    Raises:
        ValueError: See `make_task`.
    """
    make = task.maker or EVERY_TASK.find(task.name)
    before = _as_it_was(task.name, make, task.options)
    made = made_by(make, task.name, dict(task.options) | options)
    replaced = {
        name: getattr(task, name)
        for name in ("robot", "start_input")
        if getattr(task, name) != getattr(before, name)
    }
    return with_fields(made, **replaced)


def with_option(makers: Mapping[str, Maker]) -> dict[str, tuple[str, ...]]:
    """Option -> names of the tasks that have it."""
    options = dict.fromkeys([*OPTIONS, *(o for make in makers.values() for o in defaults(make))])
    return {o: tuple(n for n, make in makers.items() if o in defaults(make)) for o in options}


def owner_of(name: str) -> RobotParams | None:
    """The first robot with its own task of this name; None without one."""
    load_plugins()
    return next((robot for robot, own in OWN_TASKS.items() if name in own), None)


@lru_cache(maxsize=64)
def _as_it_was(name: str, make: Maker, options: tuple[tuple[str, float], ...]) -> Task:
    return made_by(make, name, dict(options))


def made_by(make: Maker, name: str, options: Mapping[str, float | None]) -> Task:
    """The task made from options, of which None counts as not given.

    Raises:
        ValueError: An option that the task does not have, or one out of range.
    """
    known = defaults(make)
    given = {option: value for option, value in options.items() if value is not None}
    for option, value in given.items():
        if option not in known:
            raise ValueError(
                f"task {name!r} has no option {option!r}; it has {', '.join(known) or 'none'}"
            )
        if as_number(value) is None:
            raise ValueError(f"option {option!r} must be a number, got {value!r}")
    with outside(f"task {name!r}"):
        task = make(**given)
    if not isinstance(task, Task):
        raise ValueError(
            f"the maker of task {name!r} must return a Task, got {type(task).__name__}"
        )
    return with_fields(task, options=task.options or tuple((known | given).items()), maker=make)


def known_tasks() -> list[str]:
    """Names of all tasks: own ones of any robot, and those for every robot."""
    own = (name for makers in OWN_TASKS.values() for name in makers)
    return list(dict.fromkeys([*EVERY_TASK, *GENERIC_TASKS, *own]))
