"""Tables of evaluated episodes, for a terminal and for report.md."""

from collections.abc import Sequence
from dataclasses import replace

from rich.table import Table
from rich.text import Text

from softrobot_env.core.registry import load
from softrobot_env.evaluation.report import (
    Row,
    entry_of_row,
    identified_elsewhere,
    robot_heading,
    robot_label,
    task_label,
)

from .tables import Column, make_table

_BOUND = "The thesis gives a steady-state error of 0.01 % as an upper bound."
_TRACKING = "Tracking errors are those after the approach, as in Tabs. 5.2 and 5.3 of the thesis."
_IDENTIFIED = "The identified parameters of the rig are of {}; other rigs differ from it."


def _policy(row: Row) -> Text:
    return Text(f"{row['policy']} FAILED", "red") if row["failure"] else Text(row["policy"])


_POLICY = Column("policy", _policy)

_FIGURES = (
    Column("mean mm", "e_mean", ".2f", "mm"),
    Column("with real drive mm", "e_mean_real_drive", ".2f", "mm"),
    Column("rms mm", "e_rms", ".2f", "mm"),
    Column("max mm", "e_max", ".2f", "mm"),
    Column("final mm", "e_final", ".3f", "mm"),
    Column("tracking mean mm", "e_mean_tracking", ".2f", "mm"),
    Column("tracking max mm", "e_max_tracking", ".2f", "mm"),
    Column("rise s", "rise_time", ".3f"),
    Column("settling s", "settling_time", ".2f"),
    Column("overshoot %", "overshoot", ".1f", "%"),
    Column("steady %", "steady_state_error", ".2f", "%"),
    Column("policy µs", "policy_time_median", ".1f", "µs"),
    Column("p99 µs", "policy_time_p99", ".1f", "µs"),
    Column("times real", "realtime_factor", ".0f"),
)

#: What is left to report.md, so that a table fits into 80 characters.
_TERMINAL_HIDES = ("policy_time_p99",)
_STEP_HIDES = ("e_mean", "e_rms", "e_max", "e_final")
_TRACKING_HIDES = ("e_rms", "e_final")


def tables(rows: Sequence[Row]) -> list[Table]:
    """One table per task for the terminal, which is narrow."""
    return [_table(label, group) for label, group in _by_task(rows)]


def _by_task(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    labels = dict.fromkeys(task_label(row) for row in rows)
    return [(label, [r for r in rows if task_label(r) == label]) for label in labels]


def _table(label: str, rows: list[Row]) -> Table:
    caption, rows = "\n".join(failures(rows)), _ideal(rows)
    shown = _shown(rows)
    hidden = _TERMINAL_HIDES + _STEP_HIDES * (rows[0]["step_width"] is not None)
    hidden += _TRACKING_HIDES * ("e_mean_tracking" in [column.value for column in shown])
    shown = [c for c in shown if c.value not in hidden]
    robots, named = list(dict.fromkeys(map(robot_label, rows))), [_POLICY]
    if len(robots) > 1:
        named.append(Column(robot_heading(rows[0]), robot_label))
    else:
        label = ", ".join(filter(None, (label, *robots)))
    folded = [replace(c, heading=c.heading.replace(" ", "\n", 1)) for c in shown]
    out = make_table(label, [*named, *folded], rows, caption=caption)
    out.pad_edge = False
    for column in out.columns[len(named) :]:
        # Numbers are never cut short; where space lacks, names and headings fold.
        column.no_wrap, column.overflow = False, "fold"
        column.min_width = max(len(cell) for cell in column.cells)
    return out


def _ideal(rows: list[Row]) -> list[Row]:
    """Those without a real drive, which have its figures beside their own."""
    return [row for row in rows if not row.get("real_drive")]


def _shown(rows: Sequence[Row]) -> list[Column]:
    """Columns with a value somewhere."""
    return [c for c in _FIGURES if any(row.get(c.value) is not None for row in rows)]


def status_lines(rows: Sequence[Row]) -> list[str]:
    """One sentence per episode in which the policy could not do what it wanted."""
    out = []
    for row in rows:
        shares = [f"{reason} in {100 * s:.2g} %" for reason, s in row.get("remarks", {}).items()]
        if shares:
            name = " ".join(filter(None, (row["policy"], robot_label(row))))
            out.append(f"{name}, of its decisions: {', '.join(shares)}.")
    return out


def failures(rows: Sequence[Row]) -> list[str]:
    """One sentence per failed episode."""
    return [
        f"{task_label(r)}, {r['policy']} {robot_label(r)} failed: {r['failure']}"
        for r in rows
        if r["failure"]
    ]


def notes(rows: Sequence[Row]) -> list[str]:
    """What has to be known to read the rows of the rig."""
    approached = any(row.get("e_mean_tracking") is not None for row in rows)
    foreign = dict.fromkeys(row["identified"] for row in rows if identified_elsewhere(row))
    return [_TRACKING] * approached + [_IDENTIFIED.format(rig) for rig in foreign]


def markdown(rows: Sequence[Row], command: str) -> str:
    """The rows as Markdown, one table per task, the thesis' figures below ours."""
    parts = ["# Evaluation", f"Command: `{command}`"]
    for label, group in _by_task(rows):
        parts += [f"## {label}", _markdown_table(group), *failures(group), *status_lines(group)]
    parts += [_BOUND] if any(row["step_width"] is not None for row in rows) else []
    return "\n\n".join([*parts, *notes(rows)]) + "\n"


def _markdown_table(rows: list[Row]) -> str:
    rows = _ideal(rows)
    entry = entry_of_row(rows[0])
    if entry is not None and entry.reported is not None:
        rows = [*rows, *load(entry.reported)(rows[0])]
    shown = _shown(rows)
    columns = [_POLICY, Column(robot_heading(rows[0]), robot_label), *shown]
    lines = [[column.heading for column in columns], ["---", "---", *["---:"] * len(shown)]]
    lines += [[column.cell(row).plain for column in columns] for row in rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
