"""Reports of flat rows: report.json, and readable labels of its columns."""

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from softrobot_env.core import sources
from softrobot_env.core.files import write_text
from softrobot_env.robots import ENTRIES, VARIATIONS, RobotEntry
from softrobot_env.tasks import OPTIONS, owner_of
from softrobot_env.tasks.spec import labelled

#: Plants of rows that are not simulations: the rig, and a virtual one, over a serial line.
REAL, VIRTUAL = "real", "virtual"


def option_columns(options: Mapping[str, float]) -> dict[str, float | None]:
    """Columns of a row for the options of any task, None where the task does not have them.

    Options that only a user's task has are collected in the column `more_options`, if any.
    """
    own = {name: value for name, value in options.items() if name not in OPTIONS}
    columns = {option.column: options.get(name) for name, option in OPTIONS.items()}
    return columns | ({"more_options": own} if own else {})


def task_label(row: Mapping[str, Any]) -> str:
    """Label of a task with its options, and the robot unless it is one of the thesis."""
    values = {name: row.get(option.column) for name, option in OPTIONS.items()}
    values |= row.get("more_options") or {}
    return ", ".join(filter(None, (labelled(row["task"], values), own_robot(row))))


def own_robot(row: Mapping[str, Any]) -> str:
    """The robot of a row; empty if the task implies it."""
    entry = entry_of_row(row)
    return row["robot"] if entry is None else "" if entry.named_by_tasks else entry.robot.name


def entry_of_row(row: Mapping[str, Any]) -> RobotEntry | None:
    """Registry entry of a row's robot, implied by the task if the row does not name it."""
    robot = row.get("robot")
    if robot is None and (owner := owner_of(row["task"])) is not None:
        robot = owner.name
    return ENTRIES.get(robot)


def _has_twins(row: Mapping[str, Any]) -> bool:
    entry = entry_of_row(row)
    return entry is not None and entry.twin is not None


def variation_label(row: Mapping[str, Any]) -> str:
    """Label of varied parameters and of the delay known to the policy; empty if nominal."""
    varied = [VARIATIONS[name].shown(value) for name, value in row["variation"].items()]
    if row.get("known_delay"):
        varied.append(f"known {VARIATIONS['delay'].shown(row['known_delay'])}")
    if row.get("real_drive"):
        varied.append("real drive")
    return ", ".join(varied)


def rig_label(row: Mapping[str, Any]) -> str:
    """Label of the rig; empty for other robots."""
    if not _has_twins(row):
        return ""
    if row["plant"] == REAL:
        return "real"
    name = "ideal" if row["twin"] is None else f"twin {row['twin']}"
    return f"virtual {name}" if row["plant"] == VIRTUAL else name


def identified_label(twin: int | None) -> str:
    """Label of the rig whose identified parameters a policy uses, by its seed if it has one."""
    return "a rig without a seed" if twin is None else f"twin {twin}"


def identified_elsewhere(row: Mapping[str, Any]) -> bool:
    """Whether a policy drove, or may have driven, another rig than the identified one."""
    if row.get("identified") is None:
        return False
    seedless = row["plant"] == REAL or row["twin"] is None
    return seedless or row["identified"] != f"twin {row['twin']}"


def robot_label(row: Mapping[str, Any]) -> str:
    """Label of the rig, and of the robot's differences from the nominal one."""
    return ", ".join(filter(None, (rig_label(row), variation_label(row))))


def robot_heading(row: Mapping[str, Any]) -> str:
    """Heading of the column of `robot_label`."""
    return "rig" if _has_twins(row) else "variation"


def beside_real_drives(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows extended by the mean error [m] of the same episodes with a real drive, if any."""
    changing = {"real_drive", "remarks", "failure"}

    def key(row: dict[str, Any]) -> str:
        said = {k: v for k, v in row.items() if k not in changing and not isinstance(v, float)}
        return str((said, task_label(row), row["known_delay"]))

    real = {key(row): row["e_mean"] for row in rows if row["real_drive"]}
    return [row | {"e_mean_real_drive": real.get(key(row))} for row in rows]


#: A row in the format of report.json, see `EvaluatedRow.columns`.
Row = dict[str, Any]

_PACKAGES = ("softrobot_env", "mujoco", "gymnasium", "numpy", "scipy")


def write_json(path: Path, rows: list[Row], command: str) -> None:
    """Write `{"meta": ..., "rows": ...}`, a row per line; `command` is the one that made them.

    Raises:
        ValueError: A row holds NaN or infinity; failed runs must hold None and the reason.
    """
    meta = json.dumps(metadata(command), indent=1)
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    write_text(path, f'{{"meta": {meta},\n"rows": [\n{lines}\n]}}\n')


def metadata(command: str) -> dict[str, Any]:
    """Versions, machine and command of this run, its CPU time [s], and its dependencies."""
    return {
        "command": command,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpu": _cpu_name(),
        "versions": {name: _version(name) for name in _PACKAGES},
        "seconds": round(sources.cpu_seconds(), 1),
        "sources": sources.recorded(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()
