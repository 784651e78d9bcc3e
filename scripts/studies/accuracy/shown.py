"""The accuracy rows as tables that fit a terminal of 100 columns, and as pictures."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from math import ceil, log2
from typing import Any

from rich.table import Table
from rich.text import Text

from softrobot_env.evaluation.models.runs import front
from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import STYLES, Axes, Figure, plain_ticks, style_of
from softrobot_env.rendering.models import draw_front, model_entries
from studies.accuracy import pyelastica_rod, rig, rods, spiral, tension_step
from studies.accuracy.cases import DURATION, Row
from studies.accuracy.space import HEADINGS, ROBOTS, name_of
from studies.lab import Column, groups, lines, pivot, select, table, verdict
from studies.truths import thesis_values as values

#: Resolutions shown; gauss3 and the Cosserat rod have their nearest numbers.
_SHOWN = (6, 9, 12, 18, 24, 36)

#: Case -> title of its column and its panel: at rest, motions, and motions of the rig.
STATIC = {
    "self_weight_weak": "self-weight, weak",
    "self_weight_stiff": "self-weight, stiff",
    "tip_moment_1Nm": "tip moment, 1 N m",
    "tip_force_3N": "tip force, 3 N",
    "tendon_static": "tendon, channel",
    "tendon_guided": "tendon, guides",
}
MOTIONS = {
    spiral.CASE: "Spiral under a turning tip force",
    tension_step.CASE: "Tension step of the arm",
    pyelastica_rod.CASE: "Spiral without damping",
}
RIG_MOTIONS = {rig.STEP: "Rig, length step of 10 mm", rig.CIRCLE: "Rig, fast circle"}
RIG_STATIC = {
    "rig_pull_10mm": "one tendon 10 mm",
    "rig_pull_20mm": "one tendon 20 mm",
    "rig_general": "two tendons 12, 6 mm",
    "rig_slack": "12, 4 mm, third slack",
}
_TITLES = STATIC | RIG_STATIC | {rig.STEP: "step", rig.CIRCLE: "circle"}
_TITLES |= {name_of(case, robot): text for robot in ROBOTS for case, text in HEADINGS.items()}

# ---------------------------------------------------------------- tables


def _by_case(title: str, value: str, factor: float, where: Callable[[Row], bool]) -> Callable:
    """A line per model and resolution, a column per case; misses in red."""

    def cell(rows: list[Row]) -> Text:
        row = rows[0]
        if row.kind == "note":
            return Text("none", "red")
        found = factor * getattr(row, value)
        return Text(_short(found), "bold red" if row.met is False else "")

    make = pivot(title, ("model", "n"), "case", cell, where=where, heading=_heading)
    return lambda rows: make(sorted(rows, key=lambda row: row.model))


def _heading(case: str) -> str:
    """Short name of a case, in narrow lines."""
    what, *which = _TITLES[case].split(", ")
    return "\n".join([*what.replace("-", "- ").split(), *which])


def _in_space(robot: Any) -> Callable:
    """A table of a rod; a model that did not solve a case has a word in place of its error."""
    names = [name_of(case, robot) for case in HEADINGS]
    title = (
        f"{robot.name.upper()} rod in space, length / radius "
        f"{robot.length / robot.outer_radius:.0f}: static tip error in mm (wrenches: mean;\n"
        "none: no equilibrium was found)"
    )
    kinds = "static", "note"
    return _by_case(title, "e_mean", 1e3, lambda row: row.case in names and row.kind in kinds)


def _under_loads(robot: Any) -> Callable:
    """A table of MuJoCo's rods and ours at rest: error and time of each case."""
    names = {rods.case_name(case, robot): text for case, text in rods.HEADINGS.items()}

    def cell(rows: list[Row]) -> Text:
        return Text(f"{_short(1e3 * rows[0].e_mean)} / {_short(1e3 * rows[0].wall_time)}")

    return pivot(
        f"MuJoCo's rods beside ours, {robot.name.upper()} rod: static tip error in mm / time in ms",
        *(("model", "n"), "case", cell),
        where=lambda row: row.case in names and row.kind == "static",
        heading=names.__getitem__,
    )


def _short(value: float) -> str:
    return "0" if abs(value) < 1e-9 else f"{value:.0f}" if value >= 100 else f"{value:.2g}"


def setting(row: Any) -> str:
    """Timestep, or the tolerance of adapted ones."""
    if row.tolerance is None:
        return f"{1e3 * row.timestep:.3g} ms"
    return f"tol {row.tolerance:.0e}".replace("e-0", "e-")


def _motions(case: str, title: str, left: Sequence = (), right: Sequence = ()) -> Callable:
    """The runs of each model that no other run of it, whatever its rule, beats."""
    make = table(
        f"{title}, 3 s: runs that none of the same model beats",
        *("model", *left, "n", Column("integrator", form=">"), Column("step", setting, ">")),
        *("e_mean", "e_max", "e_time", "wall_time", *right),
        caption="Step: of the integrator in ms, or its tolerance where it adapts",
    )

    def tables(rows: list[Row]) -> list[Table]:
        models = groups(select(rows, case=case, kind="dynamic"), "family").values()
        return make([row for mine in models for row in front(mine)])

    return tables


def _of_limits(row: Row) -> bool:
    return row.kind in ("agreement", "physics")


def _notes(rows: list[Row]) -> list[Text]:
    return [Text(f"{r.case}, {r.model}: {r.reference}") for r in select(rows, kind="note")]


_SPEED = Column("x real time", lambda row: DURATION / row.wall_time, ".0f")

TABLES = (
    _by_case(
        *("Static tip error in mm", "e_mean", 1e3),
        lambda row: row.kind == "static" and row.case in STATIC and row.n in _SHOWN,
    ),
    *map(_in_space, ROBOTS),
    *(_motions(case, title, ("physics",)) for case, title in MOTIONS.items()),
    *map(_under_loads, ROBOTS),
    *(_motions(case, title, right=(_SPEED,)) for case, title in rods.MOTIONS.items()),
    _by_case(
        "Limit of each model less the exact equilibrium of its physics, in % of the length\n"
        "(goal: 0.1, but none for ancf, a continuum: no rod is exact for it unless it is slender)",
        *("value", 100),
        lambda row: _of_limits(row) and row.case in STATIC,
    ),
    table(
        "Distance of the limits of motions\n(goal: 0.1 % of the length where physics are the same)",
        *("case", Column("models", "model"), "e_max"),
        Column("share", lambda row: f"{100 * row.value:.2g} %", ">"),
        Column("met", lambda row: verdict(row.met), ">"),
        where=lambda row: _of_limits(row) and row.case not in (*STATIC, *rig.CASES),
    ),
    _by_case(
        "Rig: static tip error in mm, by the lengths in mm that its tendons are pulled in",
        *("e_mean", 1e3),
        lambda row: row.kind == "static" and row.case in RIG_STATIC,
    ),
    *(_motions(case, title, right=(_SPEED,)) for case, title in RIG_MOTIONS.items()),
    _by_case(
        "Rig: limit of each model less the truth of its physics, in % of length (goal: 0.1)",
        *("value", 100),
        lambda row: row.kind == "agreement" and row.case in rig.CASES,
    ),
    table(
        "Goals",
        *(Column("goal", "case"), Column("by", lambda row: f"{row.model} {row.n}")),
        *(Column("found", "value", ".3g"), Column("bound", "limit", ".3g")),
        Column("", lambda row: verdict(row.met), ">"),
        where={"kind": "goal"},
    ),
    _notes,
)


# ---------------------------------------------------------------- error against run time

_REAL_TIME = 3000  # ms
_RUN_TIME = "run time of 3 s of motion [ms]"

#: [m], mean error for which titles say who is fastest.
_ALLOWED = 1e-3


def _work_precision(titles: dict[str, str], rows: list[Row]) -> Figure | None:
    """A panel for each of some motions."""
    moving = {case: select(rows, kind="dynamic", case=case) for case in titles}
    moving = {case: mine for case, mine in moving.items() if mine}
    if not moving:
        return None
    panels: list[Callable[[Axes], None]] = []
    for case, mine in moving.items():
        panels.append(partial(_draw_motions, rows=mine, title=titles[case]))
        if case == spiral.CASE:
            panels.append(partial(_draw_in_time, rows=mine))
    down = ceil(len(panels) / 2)
    figure, grid = figures.new_figure(down, 2, (10, 4.2 * down))
    for axes, draw in zip(grid.flat, panels, strict=False):
        draw(axes)
        plain_ticks(axes)
        _draw_real_time(axes)
    message, runs = _fastest([*moving.values()]), chain.from_iterable(moving.values())
    figures.add_legend(figure, model_entries(row.family for row in runs))
    figures.add_title(figure, message, "All runs, and the best of each model joined")
    return figure


def _fastest(motions: list[list[Row]]) -> str:
    """Which model is soonest within the error, as a message; one list of rows a motion."""
    soonest = []
    for rows in motions:
        good = [row for row in rows if row.e_mean is not None and row.e_mean <= _ALLOWED]
        if good:
            soonest.append(figures.label_of(min(good, key=lambda row: row.wall_time).family))
    if not soonest:
        return "Error against run time"
    best = max(soonest, key=soonest.count)
    return (
        f"On {soonest.count(best)} of {len(soonest)} motion{'s' * (len(soonest) > 1)} the {best} "
        f"is the first within {1e3 * _ALLOWED:g} mm"
    )


def _draw_motions(axes: Axes, rows: list[Row], title: str) -> None:
    for model in STYLES:
        _draw_front(axes, model, select(rows, family=model), "e_mean")
    _label(axes, title)
    axes.set_ylabel("mean tip error [mm]")


def _draw_front(axes: Axes, model: str, rows: list[Row], error: str) -> None:
    """All runs of a model as faint points, those that none beats joined."""
    drawn = (lambda row: 1e3 * getattr(row, error)), (lambda row: 1e3 * row.wall_time)
    draw_front(axes, rows, style_of(model).points, error, "wall_time", *drawn)


def _draw_real_time(axes: Axes) -> None:
    """Mark where a run takes as long as the motion."""
    if axes.get_xlim()[1] > _REAL_TIME:
        axes.axvline(_REAL_TIME, color="0.6", linewidth=1, linestyle="--", zorder=0)
        place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        text = {"rotation": 90, "ha": "right", "fontsize": 8, "color": "0.4"}
        axes.annotate("real time", (_REAL_TIME, 0.02), xytext=(-3, 0), **place, **text)


def _draw_in_time(axes: Axes, rows: list[Row]) -> None:
    """Error of the integrators alone, on the discretisations of the thesis, with its own."""
    small = {"fontsize": 8, "color": "0.35"}
    errors = [1e3 * error for error in values.EULER_ACCURACIES]
    for model in ("pcc/lumped", "cosserat", "ancf"):
        name, style = model.split("/")[0], style_of(model)
        pieces, (time, _, *euler) = values.CHOSEN[name], values.TIMES[name]
        _draw_front(axes, model, select(rows, model=model, n=pieces), "e_time")
        grey = {"color": "0.5", "marker": style.marker, "markeredgecolor": style.colour}
        axes.plot([1e3 * t for t in euler], errors, **grey, linestyle=":", markersize=6)
        axes.plot(1e3 * time, 1e3 * values.ADAPTIVE_ACCURACY, **grey, markersize=10)
        text = f"{ {'cosserat': 'CR'}.get(name, name.upper()) } {pieces}"
        offset = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center", "va": "bottom"}
        axes.annotate(text, (1e3 * euler[0], errors[0]), **offset, **small)
    _label(axes, "The same, error in time alone, pieces of the thesis")
    axes.set_ylabel("largest tip error [mm]")
    axes.set_ylim(top=5 * max(errors))  # room for the names
    text = "grey: thesis,\nlarge ode15s,\nsmall implicit Euler"
    axes.text(0.98, 0.03, text, ha="right", va="bottom", transform=axes.transAxes, **small)


def _label(axes: Axes, title: str) -> None:
    """Logarithmic axes with a title, over run times."""
    axes.set(xscale="log", yscale="log", xlabel=_RUN_TIME)
    axes.set_title(title, fontsize=9.5)
    axes.tick_params(labelsize=8)


def _finish_rules(axes: Axes, rows: list[Row], _: str) -> None:
    axes.set_title(STATIC[rows[0].case])
    first = axes.get_subplotspec().is_first_col()
    axes.set(xlabel="hinges", ylabel="tip error [mm]" if first else "")
    axes.set_xticks((6, 12, 24, 48), labels=("6", "12", "24", "48"))


def _least_order(rows: list[Row]) -> str:
    """The least order of a rule at rest, by its coarsest and finest chain of a case."""
    orders = []
    for mine in groups(rows, "case", "rule").values():
        coarse, *_, fine = sorted(mine, key=lambda row: row.n)
        orders.append(log2(coarse.e_mean / fine.e_mean) / log2(fine.n / coarse.n))
    return f"Tip errors at rest fall at least as n^-{min(orders):.1f} with every hinge rule"


#: Stem of a file -> what draws its figure of rows.
PLOTS = {
    "{}": partial(_work_precision, MOTIONS),
    "{}_rig": partial(_work_precision, RIG_MOTIONS),
    "{}_mujoco": partial(_work_precision, rods.MOTIONS),
    "{}_rules": lines(
        *("n", "e_mean", "rule"),
        panel="case",
        where=lambda row: row.kind == "static" and row.rule and row.case in (*STATIC,)[:5],
        title=_least_order,
        subject="Tip error of the chain over its number n of hinges",
        log="xy",
        columns=5,
        size=(2.6, 2.7),
        legend=True,
        decorate=_finish_rules,
    ),
}
