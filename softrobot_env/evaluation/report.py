"""Flat rows, and their three forms: report.json, report.md and a terminal table."""

import json
import math
import platform
from collections.abc import Callable
from dataclasses import asdict, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from softrobot_env.evaluation.metrics import (
    StepMetrics,
    TrackingMetrics,
    step_metrics,
    tracking_metrics,
)
from softrobot_env.evaluation.thesis import FIGURES, POLICY_TIME, ThesisFigure
from softrobot_env.rollout import Rollout
from softrobot_env.tasks import Task

Row = dict[str, Any]

_PACKAGES = ("softrobot_env", "mujoco", "gymnasium", "numpy", "scipy")

#: Columns left to the report, so that a table fits into 80 characters.
_TERMINAL_HIDES = ("policy_time_p99",)
_STEP_HIDES = ("e_mean", "e_rms", "e_max", "e_final")

#: Variation -> how people read it: factors, and amounts in people's units.
_VARIATIONS: dict[str, Callable[[float], str]] = {
    "youngs_modulus": lambda v: f"E x {v:g}",
    "density": lambda v: f"rho x {v:g}",
    "damping_time": lambda v: f"mu x {v:g}",
    "tendon_radius": lambda v: f"r_t x {v:g}",
    "tendon_friction": lambda v: f"friction {v:g} N",
    "tension_gain": lambda v: f"gain x {v:g}",
    "delay": lambda v: f"delay {1e3 * v:g} ms",
    "sensor_noise": lambda v: f"noise x {v:g}",
}

#: Column -> (heading, factor from SI, digits) of the tables people read.
_COLUMNS = {
    "e_mean": ("mean mm", 1e3, 2),
    "e_rms": ("rms mm", 1e3, 2),
    "e_max": ("max mm", 1e3, 2),
    "e_final": ("final mm", 1e3, 3),
    "rise_time": ("rise s", 1.0, 3),
    "settling_time": ("settling s", 1.0, 2),
    "overshoot": ("overshoot %", 100.0, 1),
    "steady_state_error": ("steady %", 100.0, 2),
    "policy_time_median": ("policy us", 1e6, 1),
    "policy_time_p99": ("p99 us", 1e6, 1),
    "realtime_factor": ("times real", 1.0, 0),
}


def make_row(
    rollout: Rollout, task: Task, policy: str, plant: str, variation: dict[str, float]
) -> Row:
    """One row of `evaluate`; after a failure every metric of the motion is None."""
    failed = rollout.failure is not None
    tracking = _metrics(TrackingMetrics, None if failed else tracking_metrics(rollout))
    step = None
    if task.step_width is not None and not failed:
        step = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    return {
        "task": task.name,
        "step_width": task.step_width,
        "policy": policy,
        "robot": task.robot.name,
        "plant": plant,
        "variation": dict(variation),
        **tracking,
        **_metrics(StepMetrics, step),
        "policy_time_median": float(np.median(rollout.policy_time)),
        "policy_time_p99": float(np.percentile(rollout.policy_time, 99)),
        "realtime_factor": float(rollout.time[-1] / rollout.wall_time),
        "remarks": _remarks(rollout.policy_status),
        "failure": rollout.failure,
    }


def _remarks(status: np.ndarray) -> dict[str, float]:
    """Share of the decisions in which the policy had each reason not to do what it wanted."""
    reasons, counts = np.unique(status, return_counts=True)
    return {str(r): float(c / len(status)) for r, c in zip(reasons, counts, strict=True) if r}


def _metrics(kind: type, values: TrackingMetrics | StepMetrics | None) -> Row:
    return {f.name: None for f in fields(kind)} if values is None else asdict(values)


def write_json(path: Path, rows: list[Row], command: str) -> None:
    """Write `{"meta": ..., "rows": ...}`, a row per line; `command` is what made them.

    Raises:
        ValueError: A row holds NaN or infinity; failed runs must say None and why.
    """
    meta = json.dumps(metadata(command), indent=1)
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    path.write_text(f'{{"meta": {meta},\n"rows": [\n{lines}\n]}}\n', encoding="utf-8")


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
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor()


def task_label(row: Row) -> str:
    """Task, with the step width for people."""
    width = row.get("step_width")
    return row["task"] if width is None else f"{row['task']} {1e3 * width:g} mm"


def variation_label(row: Row) -> str:
    """Varied parameters for people, empty when nominal."""
    return ", ".join(_VARIATIONS[name](value) for name, value in row["variation"].items())


def tables(rows: list[Row]) -> list[Table]:
    """One table per task for the terminal."""
    return [_table(label, group) for label, group in _by_task(rows)]


def _by_task(rows: list[Row]) -> list[tuple[str, list[Row]]]:
    labels = dict.fromkeys(task_label(row) for row in rows)
    return [(label, [r for r in rows if task_label(r) == label]) for label in labels]


def _table(label: str, rows: list[Row]) -> Table:
    hidden = _TERMINAL_HIDES + (_STEP_HIDES if rows[0]["step_width"] is not None else ())
    shown = [name for name in _shown_columns(rows) if name not in hidden]
    varied = any(row["variation"] for row in rows)
    out = Table(
        header_style="bold",
        title=label,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    for heading in ("policy", "variation")[: 1 + varied]:
        out.add_column(heading, overflow="fold")
    for name in shown:
        # Numbers are never cut short; where space lacks, names and headings fold.
        width = max(len(_cell(row, name)) for row in rows)
        heading = _COLUMNS[name][0].replace(" ", "\n", 1)
        out.add_column(heading, justify="right", min_width=width, overflow="fold")
    for row in rows:
        labels = (_policy_label(row), variation_label(row))[: 1 + varied]
        style = "red" if row["failure"] else None
        out.add_row(*labels, *(_cell(row, name) for name in shown), style=style)
    out.caption = "\n".join(failures(rows)) or None
    return out


def _policy_label(row: Row) -> str:
    return f"{row['policy']} FAILED" if row["failure"] else row["policy"]


def remarks(rows: list[Row]) -> list[str]:
    """One sentence per episode in which the policy could not do what it wanted."""
    out = []
    for row in rows:
        shares = [f"{reason} in {100 * s:.2g} %" for reason, s in row.get("remarks", {}).items()]
        if shares:
            name = " ".join(filter(None, (row["policy"], variation_label(row))))
            out.append(f"{name}, of its decisions: {', '.join(shares)}.")
    return out


def failures(rows: list[Row]) -> list[str]:
    """One sentence per failed episode."""
    return [
        f"{task_label(r)}, {r['policy']} {variation_label(r)} failed: {r['failure']}"
        for r in rows
        if r["failure"]
    ]


def markdown(rows: list[Row], command: str) -> str:
    """The rows as Markdown, one table per task, the thesis' figures below ours."""
    parts = ["# Evaluation", f"Command: `{command}`"]
    for label, group in _by_task(rows):
        parts += [f"## {label}", _markdown_table(group), *failures(group), *remarks(group)]
    parts.append("The thesis gives a steady-state error of 0.01 % as an upper bound.")
    return "\n\n".join(parts) + "\n"


def _markdown_table(rows: list[Row]) -> str:
    reported = [_thesis_row(figure) for figure in FIGURES if _same_task(figure, rows[0])]
    shown = _shown_columns([*rows, *reported])
    lines = [
        "| " + " | ".join(["policy", "variation", *(_COLUMNS[n][0] for n in shown)]) + " |",
        "|" + "---|" * 2 + "---:|" * len(shown),
    ]
    for row in [*rows, *reported]:
        cells = [_policy_label(row), variation_label(row), *(_cell(row, name) for name in shown)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _same_task(figure: ThesisFigure, row: Row) -> bool:
    return (figure.task, figure.step_width) == (row["task"], row["step_width"])


def _thesis_row(figure: ThesisFigure) -> Row:
    return {
        **asdict(figure),
        "policy": f"{figure.controller} (thesis, PCC plant)",
        "policy_time_median": POLICY_TIME[figure.controller],
        "variation": {},
        "failure": None,
    }


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
