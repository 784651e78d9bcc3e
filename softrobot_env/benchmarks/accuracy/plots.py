"""Figures of the accuracy benchmark: error against run time, against resolution, by hinge rule."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from softrobot_env.benchmarks.accuracy.cases import spiral, tension_step
from softrobot_env.benchmarks.accuracy.rig.cases import CASES as RIG_CASES
from softrobot_env.benchmarks.accuracy.rows import Row, front
from softrobot_env.benchmarks.accuracy.tables import MOTIONS, NUMBERS, RIG_MOTIONS, STATIC
from softrobot_env.benchmarks.records import select
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
    save,
    style_of,
)
from softrobot_env.scene.quadrature import RULES
from studies.truths import thesis_values as values

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


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw error against run time; beside it, against resolution, by hinge rule, and the rig.

    Args:
        rows: Rows of `benchmarks.accuracy.run`.
        path: File of the first picture. The others have its name with "_static", "_rules" and
            "_rig", which is not written without rows of the rig.
    """
    path = Path(path)
    rig = [row for row in rows if row.case in RIG_CASES and row.kind in ("static", "dynamic")]
    rows = [row for row in rows if row.case not in RIG_CASES]
    figures = {"": _work_precision(rows), "_static": _resolution(rows), "_rules": _rules(rows)}
    for name, figure in (figures | ({"_rig": _rig(rig)} if rig else {})).items():
        save(figure, path.with_stem(path.stem + name))


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


def _rig(rows: list[Row]) -> Figure:
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
    shown = {row.family for row in rows}
    line = {"markersize": 5, "linewidth": 1.4}
    handles = [entry(label_of(m), **style_of(m).points, **line) for m in STYLES if m in shown]
    add_legend(figure, handles)
