"""Tasks: a robot, a reference, a duration and a start."""

from softrobot_env.core.registry import served

from .registry import (
    EVERY_TASK,
    find_maker,
    known_tasks,
    made_by,
    make_task,
    owner_of,
    register_task,
    remake_task,
    tasks_of,
    with_option,
)
from .spec import LONGEST, OPTIONS, Maker, Option, Task, defaults
from .trajectories import SetPoints

__getattr__ = served(__name__)

__all__ = [
    "EVERY_TASK",
    "LONGEST",
    "OPTIONS",
    "Maker",
    "Option",
    "SetPoints",
    "Task",
    "defaults",
    "find_maker",
    "known_tasks",
    "made_by",
    "make_task",
    "owner_of",
    "register_task",
    "remake_task",
    "tasks_of",
    "with_option",
]
