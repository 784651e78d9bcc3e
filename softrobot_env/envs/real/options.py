"""Checks of what users pass to the real rig's environment and to its `reset`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from softrobot_env.envs.options import positive
from softrobot_env.hardware.robot_file.model import RobotFile, rig_file
from softrobot_env.hardware.robot_file.toml import read_robot_file
from softrobot_env.tasks.rig import RigTask, make_rig_task, remake_rig_task

#: Options of `reset`; also the list in error messages.
OPTIONS = {
    "duration": "duration [s] of the episode instead of the task's",
    "task": "dict of options of the task, as those of the environment",
    "clear_fault": "True to clear the fault that ended the last episode",
}


def choose_task(task: str | RigTask, options: dict[str, float]) -> RigTask:
    """The task, built if it is a name.

    Raises:
        ValueError: A bad name or option, or a task that does not start at rest.
    """
    if isinstance(task, str):
        task = make_rig_task(task, **options)
    elif options:
        raise ValueError(f"options of a task need its name, got a task and {', '.join(options)}")
    if any(task.start_length):
        raise ValueError(f"task {task.label!r} does not start with all tendons at length zero")
    return task


def task_for(task: RigTask, given: dict[str, Any]) -> RigTask:
    """The task of an episode, with the options of its `reset`."""
    changes = given.get("task", {})
    if not isinstance(changes, dict):
        raise ValueError(f"option 'task' must be a dict, got {changes!r}")
    if changes:
        task = remake_rig_task(task, **changes)
    return replace(task, duration=positive("duration", given.get("duration", task.duration)))


def choose_robot_file(
    given: str | Path | RobotFile | None, port: str | None, task: RigTask
) -> RobotFile:
    """The robot file, read if it is a path, with another `port` if one is given.

    Raises:
        ValueError: What the file must not say, or another number of tendons than the task's.
        FileNotFoundError: No such file.
    """
    if given is None:
        file = rig_file()
    else:
        file = given if isinstance(given, RobotFile) else read_robot_file(Path(given))
    tendons = len(task.robot.tendons)
    if len(file.tendons) != tendons:
        raise ValueError(
            f"robot {file.name!r} has {len(file.tendons)} tendons, the task's robot {tendons}"
        )
    return file if port is None else replace(file, port=port)


def wants_clear(given: dict[str, Any]) -> bool:
    """Whether the options of a `reset` ask to clear a fault.

    Raises:
        ValueError: They say neither True nor False.
    """
    clear = given.get("clear_fault", False)
    if not isinstance(clear, bool):
        raise ValueError(f"option 'clear_fault' must be True or False, got {clear!r}")
    return clear


def check_limits(max_missed: int, oldest: float) -> None:
    """Raise ValueError for a number of missed periods or an age [s] that cannot be meant."""
    if isinstance(max_missed, bool) or not isinstance(max_missed, int) or max_missed < 0:
        raise ValueError(f"max_missed must be a whole number from 0, got {max_missed!r}")
    positive("oldest", oldest)


def check_timing(file: RobotFile, control_period: float) -> None:
    """Raise ValueError for a control period [s] that does not fit to a robot file.

    It must be longer than what the board waits to answer, and leave the watchdog some patience.
    """
    if control_period <= file.state_delay:
        raise ValueError(
            f"control_period must be longer than the state delay of {file.state_delay:g} s, got "
            f"{control_period:g} s"
        )
    if control_period > file.watchdog / 2:
        raise ValueError(
            f"control_period must be at most half of the watchdog of {file.watchdog:g} s, got "
            f"{control_period:g} s"
        )
