"""The accuracy rows as tables that fit a terminal of 100 columns, and as pictures."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise
from math import ceil, log2
from typing import Any

from rich.table import Table
from rich.text import Text

from softrobot_env.evaluation.models.runs import front
from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import STYLES, Axes, Figure, SubFigure, plain_ticks, style_of
from softrobot_env.rendering.models import draw_front, model_entries
from softrobot_env.scene.quadrature import RULES
from studies.accuracy import pyelastica_rod, rig, spiral, tension_step
from studies.accuracy.cases import DURATION, Row
from studies.accuracy.space import HEADINGS, ROBOTS, name_of
from studies.lab import Column, groups, new_table, number, pivot, select, table, verdict
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
RIG_MOTIONS = {rig.STEP: "Rig, length step of 10 mm", rig.CIRCLE: "Rig, fast circle"}
RIG_STATIC = {
    "rig_pull_10mm": "one tendon 10 mm",
    "rig_pull_20mm": "one tendon 20 mm",
    "rig_general": "two tendons 12, 6 mm",
    "rig_slack": "12, 4 mm, third slack",
}
_TITLES = STATIC | NUMBERS | RIG_STATIC | {rig.STEP: "step", rig.CIRCLE: "circle"}
_TITLES |= {name_of(case, robot): text for robot in ROBOTS for case, text in HEADINGS.items()}

# ---------------------------------------------------------------- tables


def _by_case(title: str, value: str, factor: float, where: Callable[[Row], bool]) -> Callable:
    """A line per model and resolution, a column per case; misses in red."""

    def cell(rows: list[Row]) -> Text:
        row = rows[0]
        if row.kind == "note":
            return Text("none", "red")
        found = factor * getattr(row, value)
        text = "0" if abs(found) < 1e-9 else f"{found:.0f}" if found >= 100 else f"{found:.2g}"
        return Text(text, "bold red" if row.met is False else "")

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


def _orders(rows: list[Row]) -> Table:
    """A line per model and resolution: cost, and order of the error from the one before."""
    title = "Rig: time of an equilibrium, and order of its error, 1 / n^order (10 mm pulled in)"
    out = new_table(title, ("model", "physics"), ("n", "time [ms]", "order"))
    for before, row in pairwise([None, *select(rows, case="rig_pull_10mm", kind="static")]):
        order = None
        if before is not None and before.model == row.model:
            order = f"{log2(before.e_max / row.e_max) / log2(row.n / before.n):.2f}"
        out.add_row(row.model, row.physics, row.n, number(row.wall_time, ".3g", "ms"), order)
    return out


def _notes(rows: list[Row]) -> list[Text]:
    return [Text(f"{r.case}, {r.model}: {r.reference}") for r in select(rows, kind="note")]


_SPEED = Column("x real time", lambda row: DURATION / row.wall_time, ".0f")

TABLES = (
    _by_case(
        *("Static tip error in mm", "e_mean", 1e3),
        lambda row: row.kind == "static" and row.case in STATIC and row.n in _SHOWN,
    ),
    _by_case(
        *("Error of frequencies and twist in %", "e_relative", 100),
        lambda row: row.kind == "number" and row.n in _SHOWN,
    ),
    *map(_in_space, ROBOTS),
    *(_motions(case, title, ("physics",)) for case, title in MOTIONS.items()),
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
    _orders,
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


def _work_precision(rows: list[Row]) -> Figure:
    moving = {case: select(rows, kind="dynamic", case=case) for case in MOTIONS}
    panels: list[Callable[[Axes], None]] = []
    for case, mine in moving.items():
        if mine:
            panels.append(partial(_draw_motions, rows=mine, title=MOTIONS[case]))
        if mine and case == spiral.CASE:
            panels.append(partial(_draw_in_time, rows=mine))
    lines = ceil(len(panels) / 2)
    figure, grid = figures.new_figure(lines, 2, (10, 4.2 * lines))
    for axes, draw in zip(grid.flat, panels, strict=False):
        draw(axes)
        plain_ticks(axes)
        _draw_real_time(axes)
    message = _fastest([*filter(None, moving.values())])
    subject = "All runs, and the best of each model joined"
    _finish(figure, select(rows, kind="dynamic"), message, subject)
    return figure


def _finish(figure: Figure, rows: Iterable[Row], message: str, subject: str = "") -> None:
    """Title, and a legend of the models of some rows."""
    figures.add_legend(figure, model_entries(row.family for row in rows))
    figures.add_title(figure, message, subject)


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
    _label(axes, title, _RUN_TIME)
    axes.set_ylabel("mean tip error [mm]")


def _draw_front(axes: Axes, model: str, rows: list[Row], error: str) -> None:
    """All runs of a model as faint points, those that none beats joined."""
    drawn = (lambda row: 1e3 * getattr(row, error)), (lambda row: 1e3 * row.wall_time)
    draw_front(axes, rows, style_of(model).points, error, "wall_time", *drawn)


def _draw(
    axes: Axes, rows: Iterable[Row], x: str, y: str = "e_mean", floor: float = 0.0, **line: Any
) -> None:
    """Errors [mm], or [%] if relative, over n or run times [ms]."""
    factor = 100 if y == "e_relative" else 1e3
    places = [(getattr(r, x) * (1 if x == "n" else 1e3), getattr(r, y)) for r in rows]
    axes.plot([at for at, _ in places], [max(floor, factor * e) for _, e in places], **line)


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
    _label(axes, "The same, error in time alone, pieces of the thesis", _RUN_TIME)
    axes.set_ylabel("largest tip error [mm]")
    axes.set_ylim(top=5 * max(errors))  # room for the names
    text = "grey: thesis,\nlarge ode15s,\nsmall implicit Euler"
    axes.text(0.98, 0.03, text, ha="right", va="bottom", transform=axes.transAxes, **small)


# ---------------------------------------------------------------- error against resolution

#: The chain's rule in figures of all models.
_RULE = "mujoco_chain/balanced2"

#: Errors [mm, %] below are drawn at this value.
_FLOORS = (1e-5, 1e-6)

#: Joints of the chain in titles.
_TOLD = 24


def _resolution(rows: list[Row]) -> Figure:
    figure, _ = figures.new_figure(0, 0, (12, 6.4))
    upper, lower = figure.subfigures(2, 1)
    _draw_resolutions(upper, rows, STATIC, "e_mean", _FLOORS[0])
    _draw_resolutions(lower, rows, NUMBERS, "e_relative", _FLOORS[1])
    chains = select(rows, kind="static", model=_RULE, n=_TOLD)
    known = [row.e_mean for row in chains if row.e_mean is not None and row.case in STATIC]
    message = "Errors fall with the resolution"
    if known:
        message = f"At rest the chain with {_TOLD} joints errs by {1e3 * max(known):.2g} mm at most"
    subject = (
        "Each model to the exact solution of its own physics (less than "
        f"{_FLOORS[0]:g} mm or {_FLOORS[1]:g} %: at the bottom)"
    )
    _finish(figure, [r for r in rows if r.kind in ("static", "number")], message, subject)
    return figure


def _draw_resolutions(
    part: SubFigure, rows: list[Row], titles: dict[str, str], error: str, floor: float
) -> None:
    """A panel for each case, with a line for each model."""
    panels = figures.add_panels(part, 1, len(titles), share=True)[0]
    for axes, (case, title) in zip(panels, titles.items(), strict=True):
        for model in STYLES:
            mine = select(rows, case=case, model=_RULE if model == "mujoco_chain" else model)
            mine = [row for row in mine if row.kind in ("static", "number")]
            line = {"markersize": 4.5, "linewidth": 1.3}
            _draw(axes, mine, "n", error, floor, **style_of(model).points, **line)
        _label(axes, title, "pieces (chain: joints)")
        _set_ticks(axes, (3, 6, 12, 24, 48))
    panels[0].set_ylabel("tip error [mm]" if error == "e_mean" else "error [%]")
    if floor:
        panels[0].set_ylim(bottom=floor / 2)


# ---------------------------------------------------------------- hinge rules

#: Cases whose truth is the same for all hinge rules.
_RULE_CASES = (*STATIC,)[:5]

#: Chains shown by hinge rule; gauss3 has other numbers and goes to the nearest.
_NEAREST = {9: 6, 18: 12, 36: 24}

#: Line styles and faces of markers, by integrator.
_LINES = {"implicitfast": ("-", {}), "discrete": (":", {"markerfacecolor": "white"})}
_POINT = {"markersize": 4, "linewidth": 1.2}


def _rules(rows: list[Row]) -> Figure:
    """Tip error of the chain against hinges at rest, above error against run time in motion."""
    chains = [row for row in rows if row.is_chain]
    figure, _ = figures.new_figure(0, 0, (10, 7.6))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.15])
    figures.add_title(figure, _best_rule(select(chains, kind="static")))
    _draw_static_rules(upper, select(chains, kind="static"))
    _draw_moving_rules(lower, select(chains, kind="dynamic", case=tension_step.CASE))
    shown = {row.model.partition("/")[2] for row in chains}
    entries = [
        figures.entry(rule, **style_of(rule).points | _POINT) for rule in RULES if rule in shown
    ]
    for name, (line, face) in _LINES.items():
        look = {"color": "0.3", "marker": "o", "linestyle": line} | face | _POINT
        entries.append(figures.entry(f"lower panels: {name}", **look))
    figures.add_legend(figure, entries)
    return figure


def _best_rule(rows: list[Row]) -> str:
    """Which rule with two points a piece errs least at rest, as a message."""
    mine = [row for row in select(rows, n=_TOLD) if row.case in _RULE_CASES]
    worst = {
        model: max(row.e_mean for row in own) for (model,), own in groups(mine, "model").items()
    }
    if not worst:
        return "Error against hinges and run time"
    best = min(worst, key=worst.__getitem__)
    usual = ""
    if _RULE in worst and best != _RULE:
        usual = f", {_RULE.partition('/')[2]}, the usual rule, by {1e3 * worst[_RULE]:.2g} mm"
    return (
        f"At rest, with {_TOLD} hinges, {best.partition('/')[2]} errs least, by "
        f"{1e3 * worst[best]:.2g} mm at most{usual}"
    )


def _draw_static_rules(figure: SubFigure, rows: list[Row]) -> None:
    figure.suptitle("Static tip error of the chain, by hinge rule", fontsize=11)
    panels = figures.add_panels(figure, 1, len(_RULE_CASES), share=True)[0]
    for axes, case in zip(panels, _RULE_CASES, strict=True):
        _draw_rules(axes, select(rows, case=case), "n")
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
    for axes, n in zip(figures.add_panels(figure, 1, max(1, len(sizes)))[0], sizes, strict=False):
        mine = [row for row in rows if _NEAREST.get(row.n, row.n) == n]
        for integrator in _LINES:
            _draw_rules(axes, select(mine, integrator=integrator), "wall_time", integrator)
        others = sorted({row.n for row in mine if row.n != n})
        _label(axes, f"{n} hinges" + "".join(f" (gauss3: {k})" for k in others), "run time [ms]")
        plain_ticks(axes, "x")
        axes.set_ylim(0.02, 5)
    figure.axes[0].set_ylabel("mean tip error [mm]")


def _draw_rules(axes: Axes, rows: list[Row], x: str, integrator: str = "implicitfast") -> None:
    """Errors of all rules."""
    dashes, face = _LINES[integrator]
    for rule in RULES:
        mine = select(rows, model=f"mujoco_chain/{rule}")
        line = style_of(rule).points | {"linestyle": dashes} | _POINT | face
        _draw(axes, sorted(mine, key=lambda r: (r.n, -r.timestep)), x, label=rule, **line)


# ---------------------------------------------------------------- the rig


def _rig_figure(rows: list[Row]) -> Figure | None:
    rows = [row for row in rows if row.case in rig.CASES and row.kind in ("static", "dynamic")]
    if not rows:
        return None
    figure, _ = figures.new_figure(0, 0, (10, 8.0))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.25])
    what = "Spatial rig at rest: tip error to the exact solution of each physics"
    upper.suptitle(what, fontsize=10)
    titles = {case: title for case, title in RIG_STATIC.items() if select(rows, case=case)}
    _draw_resolutions(upper, rows, titles, "e_mean", 0)
    for axes in upper.axes:
        _set_ticks(axes, (1, 2, 4, 8, 16, 32))
    plain_ticks(upper.axes[0])
    lower.suptitle("In motion: all runs, and the best of each model joined", fontsize=10)
    moving = groups(select(rows, kind="dynamic"), "case")
    for axes, ((case,), mine) in zip(
        figures.add_panels(lower, 1, max(1, len(moving)))[0], moving.items(), strict=False
    ):
        _draw_motions(axes, mine, RIG_MOTIONS[case])
        plain_ticks(axes)
    _finish(figure, rows, _fastest([*moving.values()]))
    return figure


# ---------------------------------------------------------------- axes


def _label(axes: Axes, title: str, x: str) -> None:
    """Logarithmic axes with a title and a name of x."""
    axes.set(xscale="log", yscale="log", xlabel=x)
    axes.set_title(title, fontsize=9.5)
    axes.tick_params(labelsize=8)


def _set_ticks(axes: Axes, numbers: tuple[int, ...]) -> None:
    axes.set_xticks(numbers, labels=[str(n) for n in numbers])
    axes.set_xticks([], minor=True)


def _of_arm(draw: Callable[[list[Row]], Figure]) -> Callable[[list[Row]], Figure]:
    """A picture of all rows but the rig's."""
    return lambda rows: draw([row for row in rows if row.case not in rig.CASES])


#: Stem of a file -> what draws its figure of rows.
PLOTS = {
    "{}": _of_arm(_work_precision),
    "{}_static": _of_arm(_resolution),
    "{}_rules": _of_arm(_rules),
    "{}_rig": _rig_figure,
}
