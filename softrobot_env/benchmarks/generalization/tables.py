"""The rows of the generalization benchmark as tables that fit a report of 110 columns."""

from collections.abc import Iterator, Sequence
from statistics import median

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.generalization.run import (
    DISTURBANCES,
    NOMINAL,
    PARAMETERS,
    SPEEDS,
    TASKS,
    Row,
    Variation,
    variation_name,
)
from softrobot_env.benchmarks.records import names, select
from softrobot_env.evaluation.labels import task_label
from softrobot_env.rendering.tables import Column, make_table, pivot_table
from studies.quantities import cell, number

_ERRORS = {"e_max": "largest error in mm", "e_rms": "rms error in mm"}
_STEP = {"overshoot": "overshoot in %", "settling_time": "settling time in s"}
_TITLES = {"circle": "circle", "figure_eight": "eight", "swing": "Swing", "lshape": "L-shape"}
_GROUPS = {
    "a robot of other parameters": (NOMINAL, *PARAMETERS),
    "disturbed drives and sensors": (NOMINAL, *DISTURBANCES),
}


def tables(rows: list[Row]) -> Group:
    """Unseen references, random paths, disturbed robots, and what failed."""
    unseen, disturbed = select(rows, part="unseen"), select(rows, part="disturbed")
    parts = [*_unseen_tables(unseen), *_disturbed_tables(disturbed), _failures(rows)]
    return Group(*(part for part in parts if part.row_count), Text(_NOTES))


_NOTES = (
    "Episodes start at rest under the inputs that hold the arm's closed statics on the reference. "
    "The chain's tip is then some tenths of a millimetre off, 0.32 mm in the unseen tasks, which "
    "bounds the largest error from below. An overshoot has no value, and a dash, where the tip did "
    "not come nearer to the target in the end. Policy times in the report are those of cores that "
    "are all busy."
)


def _unseen_tables(rows: list[Row]) -> Iterator[Table]:
    for metric, text in _ERRORS.items():
        columns = {
            f"{_TITLES[task]}\n{speed:g} m/s": (metric, {"task": task, "speed": speed})
            for task in ("circle", "figure_eight")
            for speed in SPEEDS[task]
        }
        yield _table(f"Unseen references: {text}", rows, columns)
    columns = {
        f"{name}\n{speed:g} m/s": (metric, {"task": "random", "speed": speed})
        for metric, name in (("e_max", "max"), ("e_rms", "rms"))
        for speed in SPEEDS["random"]
    }
    yield _table("Random paths: median / worst of the seeds, errors in mm", rows, columns)


def _disturbed_tables(rows: list[Row]) -> Iterator[Table]:
    for task, width in TASKS:
        mine = select(rows, task=task, step_width=width)
        metrics = _ERRORS if width is None else _STEP
        title = _TITLES.get(task) or f"Step of {1e3 * width:g} mm"
        for metric, text in metrics.items():
            for group, (nominal, *varied) in _GROUPS.items():
                columns = {_heading(v): (metric, {"variation": v}) for v in (nominal, *varied)}
                if any(row.variation in varied for row in mine):
                    yield _table(f"{title} on {group}: {text}", mine, columns)


def _heading(variation: Variation) -> str:
    return variation_name(variation).replace(" ", "\n", 1)


def _table(title: str, rows: list[Row], columns: dict[str, tuple[str, dict]]) -> Table:
    """A line per policy, a column for a metric of the rows with given values of some fields.

    Columns that nothing was run for are left out.
    """
    columns = {head: what for head, what in columns.items() if select(rows, **what[1])}

    def shown(policy: str, what: tuple[str, dict]) -> str:
        metric, fields = what
        return _cell(select(rows, policy=policy, **fields), metric)

    return pivot_table(title, "policy", names(rows) if columns else (), columns, shown)


def _cell(rows: Sequence[Row], metric: str) -> str:
    """A value, or median and worst of several seeds; how many failed if any did."""
    if len(rows) <= 1:
        return cell(rows[0] if rows else None, metric)
    failed = sum(row.failure is not None for row in rows)
    if failed:
        return f"{failed} of {len(rows)} failed"
    values = [getattr(row, metric) for row in rows]
    return f"{number(median(values), metric)} / {number(max(values), metric)}"


def _failures(rows: list[Row]) -> Table:
    columns = (
        Column("policy"),
        Column("task", lambda row: task_label(row.row())),
        Column("variation", lambda row: variation_name(row.variation)),
        Column("failure"),
    )
    return make_table("Failed", columns, (row for row in rows if row.failure is not None))
