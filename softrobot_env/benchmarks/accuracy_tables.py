"""The accuracy rows as tables that fit a terminal of 100 columns."""

from collections.abc import Callable
from typing import Any

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks import pyelastica_rod, spiral, tension_step
from softrobot_env.benchmarks.accuracy_plots import family, front

Row = dict[str, Any]

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
    static = [r for r in rows if r["kind"] == "static" and r["n"] in _SHOWN]
    numbers = [r for r in rows if r["kind"] == "number" and r["n"] in _SHOWN]
    parts = [
        _pivot("Static tip error in mm", static, lambda row: 1e3 * row["e_mean"]),
        _pivot("Error of frequencies and twist in %", numbers, lambda row: 100 * row["e_relative"]),
        *(_motions(case, title, rows) for case, title in _MOTIONS.items()),
        _static_agreement(rows),
        _agreement(rows),
        _goals(rows),
    ]
    notes = [row for row in rows if row["kind"] == "note"]
    parts += [Text(f"{row['case']}, {row['model']}: {row['reference']}") for row in notes]
    return Group(*(part for part in parts if part is not None))


def _table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in left:
        out.add_column(head)
    for head in right:
        out.add_column(head, justify="right", no_wrap=True)
    return out


def _pivot(
    title: str,
    rows: list[Row],
    error: Callable[[Row], float],
    bad: Callable[[Row], bool] = lambda _: False,
) -> Table:
    """One line per model and resolution, one column per case."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    out = _table(title, ("model",), ("n", *(_SHORT[case] for case in cases)))
    cells: dict[tuple, dict[str, Text]] = {}
    for row in sorted(rows, key=lambda row: row["model"]):
        text = Text(_small(error(row)), style="bold red" if bad(row) else "")
        cells.setdefault((row["model"], row["n"]), {})[row["case"]] = text
    for (model, n), values in cells.items():
        out.add_row(model, str(n), *(values.get(case, "-") for case in cases))
    return out


def _small(value: float) -> str:
    """Two digits; rounding errors as 0."""
    return "0" if abs(value) < 1e-9 else f"{value:.2g}"


def _motions(case: str, title: str, rows: list[Row]) -> Table | None:
    """The runs of each model that no other run of it, whatever its rule, beats."""
    mine = [row for row in rows if (row["case"], row["kind"]) == (case, "dynamic")]
    if not mine:
        return None
    out = _table(
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
                _setting(row),
                *(_millimetres(row[name]) for name in ("e_mean", "e_max", "e_time")),
                f"{1e3 * row['wall_time']:.3g}",
            )
    out.caption = "Errors in mm; step: of the integrator in ms, or its tolerance where it adapts"
    return out


def _setting(row: Row) -> str:
    if row["tolerance"] is None:
        return f"{1e3 * row['timestep']:.3g} ms"
    return f"tol {row['tolerance']:.0e}".replace("e-0", "e-")


def _millimetres(error: float | None) -> str:
    return "-" if error is None else f"{1e3 * error:.2g}"


def _static_agreement(rows: list[Row]) -> Table:
    """Limits of the models: one line per model, one column per case."""
    mine = [r for r in rows if r["kind"] in ("agreement", "physics") and r["case"] in _SHORT]
    return _pivot(
        "Limit of each model less the exact equilibrium of its physics, in % of the length\n"
        "(goal: 0.1, but none for ancf, a continuum: no rod is exact for it unless it is slender)",
        mine,
        lambda row: 100 * row["value"],
        lambda row: row["met"] is False,
    )


def _agreement(rows: list[Row]) -> Table:
    out = _table(
        "Distance of the limits of motions\n(goal: 0.1 % of the length where physics are the same)",
        ("case", "models"),
        ("max [mm]", "share", "met"),
    )
    for row in rows:
        if row["kind"] in ("agreement", "physics") and row["case"] not in _SHORT:
            share = f"{100 * row['value']:.2g} %"
            out.add_row(
                row["case"], row["model"], _millimetres(row["e_max"]), share, _verdict(row["met"])
            )
    return out


def _goals(rows: list[Row]) -> Table:
    out = _table("Goals", ("goal", "by"), ("found", "bound", ""))
    for row in rows:
        if row["kind"] == "goal":
            values = (
                "-" if row[name] is None else f"{row[name]:.3g}" for name in ("value", "limit")
            )
            out.add_row(row["case"], f"{row['model']} {row['n']}", *values, _verdict(row["met"]))
    return out


def _verdict(met: bool | None) -> Text:
    if met is None:
        return Text("-")
    return Text("yes") if met else Text("NO", style="bold red")
