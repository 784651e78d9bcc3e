"""The accuracy rows as tables that fit a terminal of 100 columns."""

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.accuracy.cases import pyelastica_rod, spiral, tension_step
from softrobot_env.benchmarks.accuracy.plot_parts import family, front
from softrobot_env.benchmarks.accuracy.rig import cases as rig_accuracy_cases
from softrobot_env.benchmarks.accuracy.rig import tables as rig_accuracy_tables
from softrobot_env.benchmarks.accuracy.rows import Row
from softrobot_env.benchmarks.accuracy.table_parts import (
    millimetres,
    new_table,
    pivot,
    setting,
    verdict,
)

#: Resolutions shown; gauss3 and the Cosserat rod have their nearest numbers.
_SHOWN = (6, 9, 12, 18, 24, 36)

_SHORT = {
    "self_weight_weak": "weight\nweak",
    "self_weight_stiff": "weight\nstiff",
    "tip_moment_1Nm": "moment\n1 N m",
    "tip_force_3N": "force\n3 N",
    "tendon_static": "tendon\nchannel",
    "tendon_guided": "tendon\nguides",
    "bending_frequency_weak": "bending f\nweak",
    "bending_frequency_stiff": "bending f\nstiff",
    "torsion_static": "twist",
    "torsion_frequency": "torsion f",
}

_MOTIONS = {
    spiral.CASE: "Spiral, 3 s",
    tension_step.CASE: "Tension step of the arm, 3 s",
    pyelastica_rod.CASE: "Spiral without damping, 3 s",
}


def tables(rows: list[Row]) -> Group:
    """Errors by model and resolution, the best motions, agreement of the models, and goals."""
    rig = [r for r in rows if r["case"] in rig_accuracy_cases.CASES]
    rows = [r for r in rows if r["case"] not in rig_accuracy_cases.CASES]
    static = [r for r in rows if r["kind"] == "static" and r["n"] in _SHOWN]
    numbers = [r for r in rows if r["kind"] == "number" and r["n"] in _SHOWN]
    parts = [
        pivot("Static tip error in mm", static, _SHORT, lambda row: 1e3 * row["e_mean"]),
        pivot(
            "Error of frequencies and twist in %",
            numbers,
            _SHORT,
            lambda row: 100 * row["e_relative"],
        ),
        *(_motions(case, title, rows) for case, title in _MOTIONS.items()),
        _static_agreement(rows),
        _agreement(rows),
        *rig_accuracy_tables.tables(rig),
        _goals(rows),
    ]
    notes = [row for row in rows if row["kind"] == "note"]
    parts += [Text(f"{row['case']}, {row['model']}: {row['reference']}") for row in notes]
    return Group(*(part for part in parts if part is not None))


def _motions(case: str, title: str, rows: list[Row]) -> Table | None:
    """The runs of each model that no other run of it, whatever its rule, beats."""
    mine = [row for row in rows if (row["case"], row["kind"]) == (case, "dynamic")]
    if not mine:
        return None
    out = new_table(
        f"{title}: runs that none of the same model beats",
        ("model", "physics"),
        ("n", "integrator", "step", "e mean", "e max", "e time", "time [ms]"),
    )
    for model in dict.fromkeys(family(row) for row in mine):
        for row in front([row for row in mine if family(row) == model]):
            out.add_row(
                row["model"],
                row["physics"],
                str(row["n"]),
                row["integrator"],
                setting(row),
                *(millimetres(row[name]) for name in ("e_mean", "e_max", "e_time")),
                f"{1e3 * row['wall_time']:.3g}",
            )
    out.caption = "Errors in mm; step: of the integrator in ms, or its tolerance where it adapts"
    return out


def _static_agreement(rows: list[Row]) -> Table:
    """Limits of the models: one line per model, one column per case."""
    mine = [r for r in rows if r["kind"] in ("agreement", "physics") and r["case"] in _SHORT]
    return pivot(
        "Limit of each model less the exact equilibrium of its physics, in % of the length\n"
        "(goal: 0.1, but none for ancf, a continuum: no rod is exact for it unless it is slender)",
        mine,
        _SHORT,
        lambda row: 100 * row["value"],
        lambda row: row["met"] is False,
    )


def _agreement(rows: list[Row]) -> Table:
    out = new_table(
        "Distance of the limits of motions\n(goal: 0.1 % of the length where physics are the same)",
        ("case", "models"),
        ("max [mm]", "share", "met"),
    )
    for row in rows:
        if row["kind"] in ("agreement", "physics") and row["case"] not in _SHORT:
            share = f"{100 * row['value']:.2g} %"
            out.add_row(
                row["case"], row["model"], millimetres(row["e_max"]), share, verdict(row["met"])
            )
    return out


def _goals(rows: list[Row]) -> Table:
    out = new_table("Goals", ("goal", "by"), ("found", "bound", ""))
    for row in rows:
        if row["kind"] == "goal":
            values = (
                "-" if row[name] is None else f"{row[name]:.3g}" for name in ("value", "limit")
            )
            out.add_row(row["case"], f"{row['model']} {row['n']}", *values, verdict(row["met"]))
    return out
