"""The three forms of flat rows: report.json, report.md and a terminal table."""

import json
import math
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from softrobot_env.core.files import write_text
from softrobot_env.core.registry import load
from softrobot_env.robots import ENTRIES, VARIATIONS, RobotEntry
from softrobot_env.tasks import OPTIONS, owner_of
from softrobot_env.tasks.spec import labelled

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
    return ", ".join(filter(None, (labelled(row["task"], values), own_robot(row))))


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
    name = "ideal" if row["twin"] is None else f"twin {row['twin']}"
    return f"virtual {name}" if row["plant"] == VIRTUAL else name


def identified_label(twin: int | None) -> str:
    """The rig whose identified parameters a policy has, for people, by its seed if it has one."""
    return "a rig without a seed" if twin is None else f"twin {twin}"


def identified_elsewhere(row: Mapping[str, Any]) -> bool:
    """Whether a policy drove another rig than its parameters are of, or perhaps another."""
    if row.get("identified") is None:
        return False
    seedless = row["plant"] == REAL or row["twin"] is None
    return seedless or row["identified"] != f"twin {row['twin']}"


def robot_label(row: Mapping[str, Any]) -> str:
    """Which rig it was, and how the robot differs from the nominal one."""
    return ", ".join(filter(None, (rig_label(row), variation_label(row))))


def robot_heading(row: Mapping[str, Any]) -> str:
    """What `robot_label` tells."""
    return "rig" if _has_twins(row) else "variation"


#: A row as report.json has it, see `EvaluatedRow.columns`.
Row = dict[str, Any]

_PACKAGES = ("softrobot_env", "mujoco", "gymnasium", "numpy", "scipy")

#: Columns left to the report, so that a table fits into 80 characters.
_TERMINAL_HIDES = ("policy_time_p99",)
_STEP_HIDES = ("e_mean", "e_rms", "e_max", "e_final")
_TRACKING_HIDES = ("e_rms", "e_final")

_BOUND = "The thesis gives a steady-state error of 0.01 % as an upper bound."
_TRACKING = "Tracking errors are those after the approach, as in Tabs. 5.2 and 5.3 of the thesis."
_IDENTIFIED = "The identified parameters of the rig are of {}; other rigs differ from it."

#: Column -> (heading, factor from SI, digits) of the tables people read.
_COLUMNS = {
    "e_mean": ("mean mm", 1e3, 2),
    "e_rms": ("rms mm", 1e3, 2),
    "e_max": ("max mm", 1e3, 2),
    "e_final": ("final mm", 1e3, 3),
    "e_mean_tracking": ("tracking mean mm", 1e3, 2),
    "e_max_tracking": ("tracking max mm", 1e3, 2),
    "rise_time": ("rise s", 1.0, 3),
    "settling_time": ("settling s", 1.0, 2),
    "overshoot": ("overshoot %", 100.0, 1),
    "steady_state_error": ("steady %", 100.0, 2),
    "policy_time_median": ("policy µs", 1e6, 1),
    "policy_time_p99": ("p99 µs", 1e6, 1),
    "realtime_factor": ("times real", 1.0, 0),
}


def write_json(path: Path, rows: list[Row], command: str) -> None:
    """Write `{"meta": ..., "rows": ...}`, a row per line; `command` is what made them.

    Raises:
        ValueError: A row holds NaN or infinity; failed runs must say None and why.
    """
    meta = json.dumps(metadata(command), indent=1)
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    write_text(path, f'{{"meta": {meta},\n"rows": [\n{lines}\n]}}\n')


def metadata(command: str) -> dict[str, Any]:
    """Versions, machine and command of this run."""
    return {
        "command": command,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpu": _cpu_name(),
        "versions": {name: _version(name) for name in _PACKAGES},
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


def tables(rows: list[Row]) -> list[Table]:
    """One table per task for the terminal."""
    return [_table(label, group) for label, group in _by_task(rows)]


def _by_task(rows: list[Row]) -> list[tuple[str, list[Row]]]:
    labels = dict.fromkeys(task_label(row) for row in rows)
    return [(label, [r for r in rows if task_label(r) == label]) for label in labels]


def _table(label: str, rows: list[Row]) -> Table:
    shown = _terminal_columns(rows)
    robots = list(dict.fromkeys(map(robot_label, rows)))
    listed = len(robots) > 1  # else it stands in the title
    out = Table(
        header_style="bold",
        title=label if listed else ", ".join(filter(None, (label, *robots))),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    for heading in ("policy", robot_heading(rows[0]))[: 1 + listed]:
        out.add_column(heading, overflow="fold")
    for name in shown:
        # Numbers are never cut short; where space lacks, names and headings fold.
        width = max(len(_cell(row, name)) for row in rows)
        heading = _COLUMNS[name][0].replace(" ", "\n", 1)
        out.add_column(heading, justify="right", min_width=width, overflow="fold")
    for row in rows:
        labels = (_policy_label(row), robot_label(row))[: 1 + listed]
        style = "red" if row["failure"] else None
        out.add_row(*labels, *(_cell(row, name) for name in shown), style=style)
    out.caption = "\n".join(failures(rows)) or None
    return out


def _policy_label(row: Row) -> str:
    return f"{row['policy']} FAILED" if row["failure"] else row["policy"]


def status_lines(rows: list[Row]) -> list[str]:
    """One sentence per episode in which the policy could not do what it wanted."""
    out = []
    for row in rows:
        shares = [f"{reason} in {100 * s:.2g} %" for reason, s in row.get("remarks", {}).items()]
        if shares:
            name = " ".join(filter(None, (row["policy"], robot_label(row))))
            out.append(f"{name}, of its decisions: {', '.join(shares)}.")
    return out


def failures(rows: list[Row]) -> list[str]:
    """One sentence per failed episode."""
    return [
        f"{task_label(r)}, {r['policy']} {robot_label(r)} failed: {r['failure']}"
        for r in rows
        if r["failure"]
    ]


def notes(rows: list[Row]) -> list[str]:
    """What has to be known to read the rows of the rig."""
    approached = any(row.get("e_mean_tracking") is not None for row in rows)
    foreign = dict.fromkeys(row["identified"] for row in rows if identified_elsewhere(row))
    return [_TRACKING] * approached + [_IDENTIFIED.format(rig) for rig in foreign]


def markdown(rows: list[Row], command: str) -> str:
    """The rows as Markdown, one table per task, the thesis' figures below ours."""
    parts = ["# Evaluation", f"Command: `{command}`"]
    for label, group in _by_task(rows):
        parts += [f"## {label}", _markdown_table(group), *failures(group), *status_lines(group)]
    parts += [_BOUND] if any(row["step_width"] is not None for row in rows) else []
    parts += notes(rows)
    return "\n\n".join(parts) + "\n"


def _markdown_table(rows: list[Row]) -> str:
    entry = entry_of_row(rows[0])
    reported = [] if entry is None or entry.reported is None else load(entry.reported)(rows[0])
    shown = _shown_columns([*rows, *reported])
    headings = ["policy", robot_heading(rows[0]), *(_COLUMNS[name][0] for name in shown)]
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * 2 + "---:|" * len(shown)]
    for row in [*rows, *reported]:
        cells = [_policy_label(row), robot_label(row), *(_cell(row, name) for name in shown)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _terminal_columns(rows: list[Row]) -> list[str]:
    """Columns of a table on the terminal, which is narrow."""
    shown = _shown_columns(rows)
    hidden = _TERMINAL_HIDES + _STEP_HIDES * (rows[0]["step_width"] is not None)
    hidden += _TRACKING_HIDES * ("e_mean_tracking" in shown)
    return [name for name in shown if name not in hidden]


def _shown_columns(rows: list[Row]) -> list[str]:
    """Columns with a value somewhere."""
    return [name for name in _COLUMNS if any(row.get(name) is not None for row in rows)]


def _cell(row: Row, name: str) -> str:
    value = row.get(name)
    if value is None:
        return "-"
    _, factor, digits = _COLUMNS[name]
    if not math.isfinite(value):
        raise ValueError(f"{name} of {task_label(row)}, {row['policy']} is not finite")
    return f"{factor * value:.{digits}f}"
