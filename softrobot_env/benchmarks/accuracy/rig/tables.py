"""The rows of the rig in the accuracy benchmark as tables."""

from math import log2

from rich.table import Table

from softrobot_env.benchmarks.accuracy.plot_parts import family, front
from softrobot_env.benchmarks.accuracy.rig.cases import CIRCLE, DURATION, STATIC, STEP
from softrobot_env.benchmarks.accuracy.rows import Row
from softrobot_env.benchmarks.accuracy.table_parts import millimetres, new_table, pivot, setting

_SHORT = {
    "rig_pull_10mm": "10 mm",
    "rig_pull_20mm": "20 mm",
    "rig_general": "12, 6, 0",
    "rig_slack": "12, 4, -25",
    STEP: "step",
    CIRCLE: "circle",
}
_MOTIONS = {STEP: "a length step of 10 mm", CIRCLE: "a fast circle"}


def tables(rows: list[Row]) -> list[Table]:
    """Errors at rest and their order, the best motions, and agreement of the limits."""
    if not rows:
        return []
    static = [row for row in rows if row["kind"] == "static"]
    limits = [row for row in rows if row["kind"] == "agreement"]
    return [
        pivot(
            "Rig: static tip error in mm, by the lengths in mm that its tendons are pulled in",
            static,
            _SHORT,
            lambda row: 1e3 * row["e_mean"],
        ),
        _times(static),
        *(_motions(_MOTIONS[case], mine) for case, mine in _moving(rows).items()),
        pivot(
            "Rig: limit of each model less the truth of its physics, in % of length (goal: 0.1)",
            limits,
            _SHORT,
            lambda row: 100 * row["value"],
            lambda row: row["met"] is False,
        ),
    ]


def _times(rows: list[Row]) -> Table:
    """One line per model and resolution: cost, and order of the error from the one before."""
    out = new_table(
        "Rig: time of an equilibrium, and order of its error, 1 / n^order (10 mm pulled in)",
        ("model", "physics"),
        ("n", "time [ms]", "order"),
    )
    before: Row | None = None
    for row in (row for row in rows if row["case"] == next(iter(STATIC))):
        same = before is not None and before["model"] == row["model"]
        order = f"{_order(before, row):.2f}" if same else "-"
        time = f"{1e3 * row['wall_time']:.3g}"
        out.add_row(row["model"], row["physics"], str(row["n"]), time, order)
        before = row
    return out


def _order(coarse: Row, fine: Row) -> float:
    return log2(coarse["e_max"] / fine["e_max"]) / log2(fine["n"] / coarse["n"])


def _moving(rows: list[Row]) -> dict[str, list[Row]]:
    """Rows of the motions by case."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row["kind"] == "dynamic":
            found.setdefault(row["case"], []).append(row)
    return found


def _motions(title: str, mine: list[Row]) -> Table:
    """The runs of each model that no other run of it, whatever its rule, beats."""
    out = new_table(
        f"Rig: {title}, {DURATION:g} s: runs that none of the same model beats",
        ("model",),
        ("n", "integrator", "step", "e mean", "e max", "e time", "time [ms]", "x real time"),
    )
    for model in dict.fromkeys(family(row) for row in mine):
        for row in front([row for row in mine if family(row) == model]):
            out.add_row(
                row["model"],
                str(row["n"]),
                row["integrator"],
                setting(row),
                *(millimetres(row[name]) for name in ("e_mean", "e_max", "e_time")),
                f"{1e3 * row['wall_time']:.3g}",
                f"{DURATION / row['wall_time']:.0f}",
            )
    out.caption = "Errors in mm; step: of the integrator in ms, or its tolerance where it adapts"
    return out
