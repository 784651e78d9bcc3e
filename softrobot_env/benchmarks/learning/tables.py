"""Tables of `benchmarks.learning`: median, least and largest of the seeds."""

from collections.abc import Callable
from statistics import median

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.jobs import Row

#: Tables: title, and heading -> entry of a row, and factor to the unit of the heading.
_TABLES: dict[str, dict[str, tuple[str, float]]] = {
    "nominal robot": {
        "swing max mm": ("swing_max", 1e3),
        "L-shape max mm": ("lshape_max", 1e3),
        "step 50 mm: overshoot %": ("overshoot", 100),
        "settling s": ("settling_time", 1),
    },
    "other robots, disturbances, cost": {
        "E x 0.5 to 1.5: max mm": ("worst_modulus", 1e3),
        "disturbed: max mm": ("worst", 1e3),
        "failures": ("failures", 1),
        "minutes": ("minutes", 1),
    },
}


def tables(rows: list[Row]) -> Group:
    """One row per training."""
    seeds = len({row["seed"] for row in rows})
    parts = [_table(rows, columns, f"{title}: {seeds} seeds") for title, columns in _TABLES.items()]
    return Group(*parts, _notes(rows))


def _table(rows: list[Row], columns: dict[str, tuple[str, float]], title: str) -> Table:
    table = Table("training", *columns, title=f"{title}, median (least to largest)")
    for name in dict.fromkeys(row["policy"] for row in rows):
        mine = [row for row in rows if row["policy"] == name]
        table.add_row(name, *(_cell(mine, *column) for column in columns.values()))
    return table


def _cell(rows: list[Row], entry: str, factor: float) -> str:
    values = [factor * row[entry] for row in rows if row[entry] is not None]
    if not values:
        return "-"
    missing = "" if len(values) == len(rows) else f", {len(rows) - len(values)} never"
    text = _digits(max(values))
    if len(values) == 1:
        return text(values[0]) + missing
    return f"{text(median(values))} ({text(min(values))} to {text(max(values))}{missing})"


def _digits(largest: float) -> Callable[[float], str]:
    return lambda value: f"{value:.0f}" if largest >= 100 else f"{value:.3g}"


def _notes(rows: list[Row]) -> str:
    return (
        f"Trials: swing, L-shape and steps of 50, 100 and 200 mm, {rows[0]['trials']} in all: "
        "nominal, Young's modulus x 0.5 and 1.5, and (disturbed) density x 0.6, damping x 0.5, "
        "tension gain 0.9, friction 0.5 N, delay 10 ms, sensor noise 1 as well. The best network "
        "of a training was chosen by the first kinds of trials, of a randomised one by all. Failed "
        "trials count up to their failure. Minutes on one core, two trainings at a time; a warm "
        "training comes after its imitation."
    )
