"""The accuracy rows as tables that fit a terminal of 100 columns."""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from math import log2
from typing import Any

from rich.table import Table
from rich.text import Text

from softrobot_env.evaluation.models.runs import front
from softrobot_env.rendering.figures import (
    STYLES,
    Axes,
    Figure,
    SubFigure,
    add_legend,
    add_panels,
    add_title,
    entry,
    label_of,
    new_figure,
    plain_ticks,
    style_of,
)
from softrobot_env.rendering.models import model_entries
from softrobot_env.rendering.tables import Column, make_table, new_table, number, verdict
from softrobot_env.scene.quadrature import RULES
from studies.accuracy import pyelastica_rod, spiral, tension_step
from studies.accuracy.cases import DURATION, Row
from studies.accuracy.rig import CASES as RIG_CASES
from studies.accuracy.rig import CIRCLE, STEP
from studies.accuracy.space import HEADINGS, ROBOTS, name_of
from studies.lab import groups, select
from studies.truths import thesis_values as values

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


def tables(rows: list[Row]) -> Iterator[Table | Text]:
    """Errors by model and resolution, the best motions, agreement of the models, goals, notes."""
    rig = [row for row in rows if row.case in RIG_CASES]
    rows = [row for row in rows if row.case not in RIG_CASES]
    space = [row for row in rows if row.case in _SPACE and row.kind in ("static", "note")]
    rows = [row for row in rows if row not in space]
    static = [row for row in select(rows, kind="static") if row.n in _SHOWN]
    numbers = [row for row in select(rows, kind="number") if row.n in _SHOWN]
    yield _pivot("Static tip error in mm", static, lambda row: 1e3 * row.e_mean)
    yield _pivot("Error of frequencies and twist in %", numbers, lambda row: 100 * row.e_relative)
    if space:
        yield from _in_space(space)
    yield from _motions(rows, MOTIONS, (Column("physics"),), ())
    yield _static_agreement(rows)
    yield _agreement(rows)
    if rig:
        yield from _rig_tables(rig)
    yield make_table("Goals", _GOALS, select(rows, kind="goal"))
    for row in select(rows, kind="note"):
        yield Text(f"{row.case}, {row.model}: {row.reference}")


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


def _rig_tables(rows: list[Row]) -> Iterator[Table]:
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


# ---------------------------------------------------------------- pictures

_REAL_TIME = 3000  # ms
_RUN_TIME = "run time of 3 s of motion [ms]"

_RIG_STATIC = {
    "rig_pull_10mm": "one tendon 10 mm",
    "rig_pull_20mm": "one tendon 20 mm",
    "rig_general": "two tendons 12, 6 mm",
    "rig_slack": "12, 4 mm, third slack",
}

#: Cases whose truth is the same for all hinge rules.
_RULE_CASES = (*STATIC,)[:5]

#: Chains shown by hinge rule; gauss3 has other numbers and goes to the nearest.
_NEAREST = {9: 6, 18: 12, 36: 24}

#: Line styles and whether markers are filled, by integrator.
_LINES = {"implicitfast": ("-", True), "discrete": (":", False)}

#: The chain's rule in figures of all models.
_RULE = "mujoco_chain/balanced2"

#: [m], mean error for which titles say who is fastest.
_ALLOWED = 1e-3

#: Errors [mm, %] below are drawn at this value.
_FLOORS = (1e-5, 1e-6)

#: Joints of the chain in titles.
_TOLD = 24

_PIECES = "pieces (chain: joints)"


# ---------------------------------------------------------------- error against run time


def _work_precision(rows: list[Row]) -> Figure:
    moving = select(rows, kind="dynamic")
    panels: list[Callable[[Axes], None]] = []
    for case, title in MOTIONS.items():
        mine = select(moving, case=case)
        if mine:
            panels.append(lambda axes, rows=mine, title=title: _draw_motions(axes, rows, title))
        if mine and case == spiral.CASE:
            panels.append(lambda axes, rows=mine: _draw_in_time(axes, rows))
    columns = 2 if len(panels) == 4 else max(1, len(panels))
    size = (10, 8.4) if columns == 2 else (5.0 * columns, 5.2)
    figure, grid = new_figure(-(-len(panels) // columns), columns, size)
    for axes, draw in zip(grid.flat, panels, strict=True):
        draw(axes)
        plain_ticks(axes)
        _draw_real_time(axes)
    _add_model_legend(figure, moving)
    shown = [select(moving, case=case) for case in MOTIONS if select(moving, case=case)]
    add_title(figure, _fastest(shown), "All runs, and the best of each model joined")
    return figure


def _fastest(motions: list[list[Row]]) -> str:
    """Which model is soonest within the error, as a message; one list of rows a motion."""
    soonest = []
    for rows in motions:
        good = [row for row in rows if row.e_mean is not None and row.e_mean <= _ALLOWED]
        if good:
            soonest.append(label_of(min(good, key=lambda row: row.wall_time).family))
    if not soonest:
        return "Error against run time"
    best = max(soonest, key=soonest.count)
    count = soonest.count(best)
    return (
        f"On {count} of {len(soonest)} motion{'s' * (len(soonest) > 1)} the {best} is the first "
        f"within {1e3 * _ALLOWED:g} mm"
    )


def _draw_motions(axes: Axes, rows: list[Row], title: str) -> None:
    for model in STYLES:
        _draw_front(axes, model, select(rows, family=model), "e_mean")
    _label(axes, title, _RUN_TIME)
    axes.set_ylabel("mean tip error [mm]")


def _draw_front(axes: Axes, model: str, rows: list[Row], error: str) -> None:
    """All runs of a model as faint points, those that none beats joined."""
    for chosen, line in (
        (rows, {"linestyle": "", "markersize": 3, "alpha": 0.35, "markeredgewidth": 0}),
        (front(rows, error), {"linewidth": 1.4, "markersize": 5}),
    ):
        _draw(axes, chosen, "wall_time", error, **style_of(model).points, **line)


def _draw(
    axes: Axes, rows: Iterable[Row], x: str, y: str = "e_mean", floor: float = 0.0, **line: Any
) -> None:
    """Errors [mm], or [%] if relative, over n or run times [ms]."""
    scale = {"n": 1, "wall_time": 1e3, "e_relative": 100}
    axes.plot(
        [scale[x] * getattr(row, x) for row in rows],
        [max(floor, scale.get(y, 1e3) * getattr(row, y)) for row in rows],
        **line,
    )


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
    for model in ("pcc/lumped", "cosserat", "ancf"):
        name = model.split("/")[0]
        pieces, (time, _, euler) = values.CHOSEN[name], values.TIMES[name]
        _draw_front(axes, model, select(rows, model=model, n=pieces), "e_time")
        style = style_of(model)
        grey = {"color": "0.5", "marker": style.marker, "markeredgecolor": style.colour}
        errors = [1e3 * error for error in values.EULER_ACCURACIES]
        axes.plot([1e3 * t for t in euler], errors, **grey, linestyle=":", markersize=6)
        axes.plot(1e3 * time, 1e3 * values.ADAPTIVE_ACCURACY, **grey, markersize=10)
        text = f"{ {'cosserat': 'CR'}.get(name, name.upper()) } {pieces}"
        offset = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center", "va": "bottom"}
        axes.annotate(text, (1e3 * euler[0], errors[0]), **offset, **small)
    _label(axes, "The same, error in time alone, pieces of the thesis", _RUN_TIME)
    axes.set_ylabel("largest tip error [mm]")
    axes.set_ylim(top=5e3 * max(values.EULER_ACCURACIES))  # room for the names
    text = "grey: thesis,\nlarge ode15s,\nsmall implicit Euler"
    axes.text(0.98, 0.03, text, ha="right", va="bottom", transform=axes.transAxes, **small)


# ---------------------------------------------------------------- error against resolution


def _resolution(rows: list[Row]) -> Figure:
    figure, _ = new_figure(0, 0, (12, 6.4))
    upper, lower = figure.subfigures(2, 1)
    _draw_resolutions(upper, rows, STATIC, "e_mean", _FLOORS[0]).set_ylabel("tip error [mm]")
    _draw_resolutions(lower, rows, NUMBERS, "e_relative", _FLOORS[1]).set_ylabel("error [%]")
    _add_model_legend(figure, [row for row in rows if row.kind in ("static", "number")])
    chains = select(rows, kind="static", model=_RULE, n=_TOLD)
    known = [row.e_mean for row in chains if row.e_mean is not None and row.case in STATIC]
    message = "Errors fall with the resolution"
    if known:
        message = f"At rest the chain with {_TOLD} joints errs by {1e3 * max(known):.2g} mm at most"
    add_title(
        figure,
        message,
        "Each model to the exact solution of its own physics (less than "
        f"{_FLOORS[0]:g} mm or {_FLOORS[1]:g} %: at the bottom)",
    )
    return figure


def _draw_resolutions(
    part: SubFigure, rows: list[Row], titles: dict[str, str], error: str, floor: float
) -> Axes:
    """A panel for each case, with a line for each model; returns the first panel."""
    panels = add_panels(part, 1, len(titles), share=True)[0]
    for axes, (case, title) in zip(panels, titles.items(), strict=True):
        for model in STYLES:
            name = _RULE if model == "mujoco_chain" else model
            mine = [
                r for r in select(rows, case=case, model=name) if r.kind in ("static", "number")
            ]
            line = {"markersize": 4.5, "linewidth": 1.3}
            _draw(axes, mine, "n", error, floor, **style_of(model).points, **line)
        _label(axes, title, _PIECES)
        _set_ticks(axes, (3, 6, 12, 24, 48))
    if floor:
        panels[0].set_ylim(bottom=floor / 2)
    return panels[0]


# ---------------------------------------------------------------- hinge rules


def _rules(rows: list[Row]) -> Figure:
    """Tip error of the chain against hinges at rest, above error against run time in motion."""
    chains = [row for row in rows if row.is_chain]
    figure, _ = new_figure(0, 0, (10, 7.6))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.15])
    add_title(figure, _best_rule(select(chains, kind="static")))
    _draw_static_rules(upper, select(chains, kind="static"))
    _draw_moving_rules(lower, select(chains, kind="dynamic", case=tension_step.CASE))
    point = {"markersize": 4, "linewidth": 1.2}
    shown = {row.model.partition("/")[2] for row in chains}
    rules = [entry(rule, **style_of(rule).points | point) for rule in RULES if rule in shown]
    integrators = [
        entry(
            f"lower panels: {name}",
            color="0.3",
            marker="o",
            linestyle=line,
            markerfacecolor="0.3" if filled else "white",
            **point,
        )
        for name, (line, filled) in _LINES.items()
    ]
    add_legend(figure, [*rules, *integrators])
    return figure


def _best_rule(rows: list[Row]) -> str:
    """Which rule with two points a piece errs least at rest, as a message."""
    worst = {}
    for rule in RULES:
        mine = select(rows, model=f"mujoco_chain/{rule}", n=_TOLD)
        known = [row.e_mean for row in mine if row.case in _RULE_CASES]
        if known:
            worst[rule] = max(known)
    if not worst:
        return "Error against hinges and run time"
    best = min(worst, key=worst.__getitem__)
    usual = _RULE.partition("/")[2]
    told = f", {usual}, the usual rule, by {1e3 * worst[usual]:.2g} mm" if usual in worst else ""
    return (
        f"At rest, with {_TOLD} hinges, {best} errs least, by {1e3 * worst[best]:.2g} mm at most"
        f"{told if best != usual else ''}"
    )


def _draw_static_rules(figure: SubFigure, rows: list[Row]) -> None:
    figure.suptitle("Static tip error of the chain, by hinge rule", fontsize=11)
    panels = add_panels(figure, 1, len(_RULE_CASES), share=True)[0]
    for axes, case in zip(panels, _RULE_CASES, strict=True):
        for rule in RULES:
            _draw_rule(axes, rule, select(rows, case=case), "n")
        axes.plot([6, 48], [20, 20 / 64], color="0.55", linestyle="--", linewidth=1, zorder=0)
        axes.text(20, 3.2, "order 2", color="0.4", fontsize=7.5)
        _label(axes, STATIC[case], "number of hinges")
        _set_ticks(axes, (6, 12, 24, 48))
    panels[0].set_ylabel("tip error [mm]")
    panels[0].set_ylim(5e-7, 20)


def _draw_moving_rules(figure: SubFigure, rows: list[Row]) -> None:
    figure.suptitle(
        "Tension step of the arm, 3 s: mean tip error against run time, "
        "timesteps 10, 5, 2 and 1 ms from left to right",
        fontsize=11,
    )
    sizes = sorted({_NEAREST.get(row.n, row.n) for row in rows})
    for axes, n in zip(add_panels(figure, 1, max(1, len(sizes)))[0], sizes, strict=False):
        mine = [row for row in rows if _NEAREST.get(row.n, row.n) == n]
        for integrator in _LINES:
            for rule in RULES:
                same = select(mine, integrator=integrator)
                _draw_rule(axes, rule, same, "wall_time", integrator)
        others = sorted({row.n for row in mine if row.n != n})
        title = f"{n} hinges" + "".join(f" (gauss3: {k})" for k in others)
        _label(axes, title, "run time [ms]")
        plain_ticks(axes, "x")
        axes.set_ylim(0.02, 5)
    figure.axes[0].set_ylabel("mean tip error [mm]")


def _draw_rule(
    axes: Axes, rule: str, rows: list[Row], x: str, integrator: str = "implicitfast"
) -> None:
    """One rule's errors."""
    mine = select(rows, model=f"mujoco_chain/{rule}")
    dashes, filled = _LINES[integrator]
    line = style_of(rule).points | {"linestyle": dashes, "linewidth": 1.2, "markersize": 4}
    line |= {} if filled else {"markerfacecolor": "white"}
    _draw(axes, sorted(mine, key=lambda r: (r.n, -r.timestep)), x, label=rule, **line)


# ---------------------------------------------------------------- the rig


def _rig_figure(rows: list[Row]) -> Figure | None:
    rows = [row for row in rows if row.case in RIG_CASES and row.kind in ("static", "dynamic")]
    if not rows:
        return None
    figure, _ = new_figure(0, 0, (10, 8.0))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.25])
    motions = [select(rows, kind="dynamic", case=case) for case in RIG_MOTIONS]
    add_title(figure, _fastest([mine for mine in motions if mine]))
    what = "Spatial rig at rest: tip error to the exact solution of each physics"
    upper.suptitle(what, fontsize=10)
    titles = {case: title for case, title in _RIG_STATIC.items() if select(rows, case=case)}
    _draw_resolutions(upper, rows, titles, "e_mean", 0).set_ylabel("tip error [mm]")
    for axes in upper.axes:
        _set_ticks(axes, (1, 2, 4, 8, 16, 32))
    plain_ticks(upper.axes[0])
    lower.suptitle("In motion: all runs, and the best of each model joined", fontsize=10)
    moving = select(rows, kind="dynamic")
    shown = {case: title for case, title in RIG_MOTIONS.items() if select(moving, case=case)}
    for axes, case in zip(add_panels(lower, 1, max(1, len(shown)))[0], shown, strict=False):
        _draw_motions(axes, select(moving, case=case), shown[case])
        plain_ticks(axes)
    _add_model_legend(figure, rows)
    return figure


# ---------------------------------------------------------------- axes and legend


def _label(axes: Axes, title: str, x: str) -> None:
    """Logarithmic axes with a title and a name of x."""
    axes.set(xscale="log", yscale="log", xlabel=x)
    axes.set_title(title, fontsize=9.5)
    axes.tick_params(labelsize=8)


def _set_ticks(axes: Axes, numbers: tuple[int, ...]) -> None:
    axes.set_xticks(numbers, labels=[str(n) for n in numbers])
    axes.set_xticks([], minor=True)


def _add_model_legend(figure: Figure, rows: list[Row]) -> None:
    """Legend of the models of some rows."""
    add_legend(figure, model_entries(row.family for row in rows))


def _of_arm(draw: Callable[[list[Row]], Figure]) -> Callable[[list[Row]], Figure]:
    """A picture of all rows but the rig's."""
    return lambda rows: draw([row for row in rows if row.case not in RIG_CASES])


#: Stem of a file -> what draws its figure of rows.
PLOTS = {
    "{}": _of_arm(_work_precision),
    "{}_static": _of_arm(_resolution),
    "{}_rules": _of_arm(_rules),
    "{}_rig": _rig_figure,
}
