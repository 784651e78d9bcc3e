"""Tables of `benchmarks.learning`: median, least and largest of the seeds."""

from rich.console import Group

from softrobot_env.benchmarks.learning.run import Row
from softrobot_env.benchmarks.records import groups
from softrobot_env.rendering.tables import PlainTable, pivot_table, spread

#: Tables: title, and heading -> field of a row, and factor to the unit of the heading.
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
    """One line per training."""
    trainings = {name: mine for (name,), mine in groups(rows, "policy").items()}
    seeds = len({row.seed for row in rows})
    parts = [_table(trainings, columns, title, seeds) for title, columns in _TABLES.items()]
    return Group(*parts, _notes(rows))


def _table(
    trainings: dict[str, list[Row]],
    columns: dict[str, tuple[str, float]],
    title: str,
    seeds: int,
) -> PlainTable:
    title = f"{title}: {seeds} seeds, median (least to largest)"
    return pivot_table(title, "training", trainings, columns, lambda rows, what: _cell(rows, *what))


def _cell(rows: list[Row], name: str, factor: float) -> str:
    found = [getattr(row, name) for row in rows]
    values = [None if value is None else factor * value for value in found]
    return spread(values, ".0f" if max((v for v in values if v), default=0) >= 100 else ".3g")


def _notes(rows: list[Row]) -> str:
    return (
        f"Closed-loop checks: swing, L-shape and steps of 50, 100 and 200 mm, {rows[0].trials} in "
        "all: nominal, Young's modulus x 0.5 and 1.5, and (disturbed) density x 0.6, damping x "
        "0.5, tension gain 0.9, friction 0.5 N, delay 10 ms, sensor noise 1 as well. The best "
        "network of a training was chosen by the first kinds of checks, of a randomised one by "
        "all. Failed checks count up to their failure. Minutes on one core, two trainings at a "
        "time; a warm training comes after its imitation."
    )
