"""Tasks: a robot, a reference, a duration and a start."""

from softrobot_env.tasks.arm import ALL_TASKS, STEP_WIDTHS, TASKS, UNSEEN_TASKS, equal_input
from softrobot_env.tasks.registry import (
    EVERY_TASK,
    WITH_OPTION,
    find_maker,
    known_tasks,
    make_task,
    options_of,
    register_task,
    remake_task,
    tasks_of,
    with_option,
)
from softrobot_env.tasks.rig import RIG_TASKS
from softrobot_env.tasks.rig_trajectories import SetPoints
from softrobot_env.tasks.spec import LONGEST, OPTIONS, Maker, Option, Task, defaults

__all__ = [
    "ALL_TASKS",
    "EVERY_TASK",
    "LONGEST",
    "OPTIONS",
    "RIG_TASKS",
    "STEP_WIDTHS",
    "TASKS",
    "UNSEEN_TASKS",
    "WITH_OPTION",
    "Maker",
    "Option",
    "SetPoints",
    "Task",
    "defaults",
    "equal_input",
    "find_maker",
    "known_tasks",
    "make_task",
    "options_of",
    "register_task",
    "remake_task",
    "tasks_of",
    "with_option",
]
