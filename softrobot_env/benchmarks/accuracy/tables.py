"""The accuracy rows as tables that fit a terminal of 100 columns."""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from math import log2

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.accuracy.cases import pyelastica_rod, spiral, tension_step
from softrobot_env.benchmarks.accuracy.rig.cases import CASES as RIG_CASES
from softrobot_env.benchmarks.accuracy.rig.cases import CIRCLE, STEP
from softrobot_env.benchmarks.accuracy.rows import DURATION, Row, front
from softrobot_env.benchmarks.accuracy.space.cases import HEADINGS
from softrobot_env.benchmarks.accuracy.space.statics import ROBOTS, name_of
from softrobot_env.benchmarks.records import groups, select
from softrobot_env.rendering.tables import Column, make_table, new_table, number, verdict

#: Resolutions shown; gauss3 and the Cosserat rod have their nearest numbers.
_SHOWN = (6, 9, 12, 18, 24, 36)

#: Case -> title of its column and its panel: at rest, numbers, motions, and motions of the rig.
STATIC = {
    "self_weight_weak": "self-weight, weak",
    "self_weight_stiff": "self-weight, stiff",
    "tip_moment_1Nm": "tip moment, 1 N m",
    "tip_force_3N": "tip force, 3 N",
    "tendon_static": "tendon, channel",
    "tendon_guided": "tendon, guides",
}
NUMBERS = {
    "bending_frequency_weak": "bending frequency, weak",
    "bending_frequency_stiff": "bending frequency, stiff",
    "torsion_static": "twist",
    "torsion_frequency": "torsional frequency",
}
MOTIONS = {
    spiral.CASE: "Spiral under a turning tip force",
    tension_step.CASE: "Tension step of the arm",
    pyelastica_rod.CASE: "Spiral without damping",
}
RIG_MOTIONS = {STEP: "Rig, length step of 10 mm", CIRCLE: "Rig, fast circle"}

#: Headings of the rig's cases: lengths [mm] that its tendons are pulled in.
_RIG_LENGTHS = {
    "rig_pull_10mm": "10 mm",
    "rig_pull_20mm": "20 mm",
    "rig_general": "12, 6, 0",
    "rig_slack": "12, 4, -25",
    STEP: "step",
    CIRCLE: "circle",
}

#: Case of a rod in space -> its heading.
_SPACE = {name_of(case, robot): text for robot in ROBOTS for case, text in HEADINGS.items()}

_CAPTION = "Errors in mm; step: of the integrator in ms, or its tolerance where it adapts"


def tables(rows: list[Row]) -> Group:
    """Errors by model and resolution, the best motions, agreement of the models, and goals."""
    rig = [row for row in rows if row.case in RIG_CASES]
    rows = [row for row in rows if row.case not in RIG_CASES]
    space = [row for row in rows if row.case in _SPACE and row.kind in ("static", "note")]
    rows = [row for row in rows if row not in space]
    static = [row for row in select(rows, kind="static") if row.n in _SHOWN]
    numbers = [row for row in select(rows, kind="number") if row.n in _SHOWN]
    parts = [
        _pivot("Static tip error in mm", static, lambda row: 1e3 * row.e_mean),
        _pivot("Error of frequencies and twist in %", numbers, lambda row: 100 * row.e_relative),
        *(_in_space(space) if space else ()),
        *_motions(rows, MOTIONS, (Column("physics"),), ()),
        _static_agreement(rows),
        _agreement(rows),
        *(_rig(rig) if rig else ()),
        make_table("Goals", _GOALS, select(rows, kind="goal")),
    ]
    notes = select(rows, kind="note")
    lines = [f"{row.case}, {row.model}: {row.reference}" for row in notes]
    lines.append("Error in time on robots of all kinds: softrobot benchmark scenes")
    return Group(*parts, *map(Text, lines))


def _pivot(title: str, rows: list[Row], error: Callable[[Row], float]) -> Table:
    """A line per model and resolution, a column per case; misses in red."""
    cases = dict.fromkeys(row.case for row in rows)
    return _by_case(title, rows, cases, lambda row: _small(error(row), row.met is False))


def _by_case(
    title: str, rows: list[Row], cases: Iterable[str], cell: Callable[[Row], Text]
) -> Table:
    out = new_table(title, ("model",), ("n", *map(_heading, cases)))
    lines = groups(sorted(rows, key=lambda row: row.model), "model", "n")
    for (model, n), mine in lines.items():
        cells = {row.case: cell(row) for row in mine}
        out.add_row(model, n, *map(cells.get, cases))
    return out


def _in_space(rows: list[Row]) -> Iterator[Table]:
    """A table for each rod; a model that did not solve a case has a word in place of its error."""
    for robot in ROBOTS:
        names = [name_of(case, robot) for case in HEADINGS]
        yield _by_case(
            f"{robot.name.upper()} rod in space, length / radius "
            f"{robot.length / robot.outer_radius:.0f}: static tip error in mm (wrenches: mean;\n"
            "none: no equilibrium was found)",
            [row for row in rows if row.case in names],
            names,
            _error_in_space,
        )


def _error_in_space(row: Row) -> Text:
    if row.kind == "note":
        return Text("none", "red")
    error = 1e3 * row.e_mean
    return Text(f"{error:.0f}") if error >= 100 else _small(error, False)


def _heading(case: str) -> str:
    """Short name of a case, in narrow lines."""
    if case in _RIG_LENGTHS:
        return _RIG_LENGTHS[case]
    what, *which = (STATIC | NUMBERS | _SPACE)[case].split(", ")
    return "\n".join([*what.replace("-", "- ").split(), *which])


def _small(value: float, bad: bool) -> Text:
    """Two digits; rounding errors as 0."""
    return Text("0" if abs(value) < 1e-9 else f"{value:.2g}", "bold red" if bad else "")


def _setting(row: Row) -> str:
    """Timestep, or the tolerance of adapted ones."""
    if row.tolerance is None:
        return f"{1e3 * row.timestep:.3g} ms"
    return f"tol {row.tolerance:.0e}".replace("e-0", "e-")


def _motions(
    rows: list[Row], titles: dict[str, str], left: tuple[Column, ...], right: tuple[Column, ...]
) -> Iterator[Table]:
    """For each case the runs of each model that no other run of it, whatever its rule, beats."""
    columns = (
        Column("model"),
        *left,
        Column("n", form="d"),
        Column("integrator", form=">"),
        Column("step", _setting, ">"),
        Column("e mean", "e_mean", ".2g", "mm"),
        Column("e max", "e_max", ".2g", "mm"),
        Column("e time", "e_time", ".2g", "mm"),
        Column("time [ms]", "wall_time", ".3g", "ms"),
        *right,
    )
    for case, title in titles.items():
        models = groups(select(rows, case=case, kind="dynamic"), "family")
        best = [row for mine in models.values() for row in front(mine)]
        title = f"{title}, 3 s: runs that none of the same model beats"
        if best:
            yield make_table(title, columns, best, caption=_CAPTION)


def _static_agreement(rows: list[Row]) -> Table:
    """Limits of the models: a line per model, a column per case."""
    mine = [r for r in rows if r.kind in ("agreement", "physics") and r.case in STATIC]
    return _pivot(
        "Limit of each model less the exact equilibrium of its physics, in % of the length\n"
        "(goal: 0.1, but none for ancf, a continuum: no rod is exact for it unless it is slender)",
        mine,
        lambda row: 100 * row.value,
    )


def _agreement(rows: list[Row]) -> Table:
    columns = (
        Column("case"),
        Column("models", "model"),
        Column("max [mm]", "e_max", ".2g", "mm"),
        Column("share", lambda row: f"{100 * row.value:.2g} %", ">"),
        Column("met", lambda row: verdict(row.met), ">"),
    )
    return make_table(
        "Distance of the limits of motions\n(goal: 0.1 % of the length where physics are the same)",
        columns,
        [r for r in rows if r.kind in ("agreement", "physics") and r.case not in STATIC],
    )


_GOALS = (
    Column("goal", "case"),
    Column("by", lambda row: f"{row.model} {row.n}"),
    Column("found", "value", ".3g"),
    Column("bound", "limit", ".3g"),
    Column("", lambda row: verdict(row.met), ">"),
)


# ---------------------------------------------------------------- the rig


def _rig(rows: list[Row]) -> Iterator[Table]:
    """Errors at rest and their order, the best motions, and agreement of the limits."""
    static = select(rows, kind="static")
    yield _pivot(
        "Rig: static tip error in mm, by the lengths in mm that its tendons are pulled in",
        static,
        lambda row: 1e3 * row.e_mean,
    )
    yield _orders(static)
    speed = Column("x real time", lambda row: DURATION / row.wall_time, ".0f")
    yield from _motions(rows, RIG_MOTIONS, (), (speed,))
    yield _pivot(
        "Rig: limit of each model less the truth of its physics, in % of length (goal: 0.1)",
        select(rows, kind="agreement"),
        lambda row: 100 * row.value,
    )


def _orders(rows: list[Row]) -> Table:
    """A line per model and resolution: cost, and order of the error from the one before."""
    out = new_table(
        "Rig: time of an equilibrium, and order of its error, 1 / n^order (10 mm pulled in)",
        ("model", "physics"),
        ("n", "time [ms]", "order"),
    )
    for before, row in pairwise([None, *select(rows, case="rig_pull_10mm")]):
        order = None
        if before is not None and before.model == row.model:
            order = f"{log2(before.e_max / row.e_max) / log2(row.n / before.n):.2f}"
        out.add_row(row.model, row.physics, row.n, number(row.wall_time, ".3g", "ms"), order)
    return out
