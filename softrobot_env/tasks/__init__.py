"""Tasks: a robot, a reference, a duration and a start."""

from softrobot_env.tasks.arm import (
    ALL_TASKS,
    LONGEST,
    STEP_WIDTHS,
    TASKS,
    UNSEEN_TASKS,
    Task,
    equal_input,
    make_task,
)

__all__ = [
    "ALL_TASKS",
    "LONGEST",
    "STEP_WIDTHS",
    "TASKS",
    "UNSEEN_TASKS",
    "Task",
    "equal_input",
    "make_task",
]
