"""What rows of a report are called for people."""

from collections.abc import Mapping
from typing import Any

from softrobot_env.robots import ENTRIES, VARIATIONS, RobotEntry
from softrobot_env.tasks import OPTIONS, owner_of
from softrobot_env.tasks.spec import option_text

#: Plants of rows that are no simulation: the rig, and a virtual one, over a serial line.
REAL, VIRTUAL = "real", "virtual"


def option_columns(options: Mapping[str, float]) -> dict[str, float | None]:
    """Columns of a row for the options of any task, None where the task has none.

    Options that only a user's task has are together in the column `more_options`, if any.
    """
    own = {name: value for name, value in options.items() if name not in OPTIONS}
    columns = {option.column: options.get(name) for name, option in OPTIONS.items()}
    return columns | ({"more_options": own} if own else {})


def task_label(row: Mapping[str, Any]) -> str:
    """Task with its options, and the robot unless it is one of the thesis, for people."""
    values = {name: row.get(option.column) for name, option in OPTIONS.items()}
    values |= row.get("more_options") or {}
    told = [option_text(name, value) for name, value in values.items() if value is not None]
    return ", ".join(filter(None, (" ".join([row["task"], *told]), own_robot(row))))


def own_robot(row: Mapping[str, Any]) -> str:
    """The robot of a row; empty where its tasks tell it."""
    entry = entry_of_row(row)
    return row["robot"] if entry is None else "" if entry.named_by_tasks else entry.robot.name


def entry_of_row(row: Mapping[str, Any]) -> RobotEntry | None:
    """What is known of a row's robot, which the task tells where the row does not."""
    robot = row.get("robot")
    if robot is None and (owner := owner_of(row["task"])) is not None:
        robot = owner.name
    return ENTRIES.get(robot)


def _has_twins(row: Mapping[str, Any]) -> bool:
    entry = entry_of_row(row)
    return entry is not None and entry.twin is not None


def variation_label(row: Mapping[str, Any]) -> str:
    """Varied parameters for people, empty when nominal."""
    return ", ".join(VARIATIONS[name].shown(value) for name, value in row["variation"].items())


def rig_label(row: Mapping[str, Any]) -> str:
    """Which rig it was, for people; empty for other robots."""
    if not _has_twins(row):
        return ""
    if row["plant"] == REAL:
        return "real"
    name = "ideal" if row["twin"] is None else _twin_label(row["twin"])
    return f"virtual {name}" if row["plant"] == VIRTUAL else name


def learnt_label(twin: int | None) -> str:
    """The rig whose identified parameters a policy has, for people, by its seed if it has one."""
    return "a rig without a seed" if twin is None else _twin_label(twin)


def learnt_elsewhere(row: Mapping[str, Any]) -> bool:
    """Whether a policy drove another rig than its parameters are of, or perhaps another."""
    if row.get("learnt") is None:
        return False
    seedless = row["plant"] == REAL or row["twin"] is None
    return seedless or row["learnt"] != _twin_label(row["twin"])


def _twin_label(seed: int) -> str:
    return f"twin {seed}"


def robot_label(row: Mapping[str, Any]) -> str:
    """Which rig it was, and how the robot differs from the nominal one."""
    return ", ".join(filter(None, (rig_label(row), variation_label(row))))


def robot_heading(row: Mapping[str, Any]) -> str:
    """What `robot_label` tells."""
    return "rig" if _has_twins(row) else "variation"
