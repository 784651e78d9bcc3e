"""Figures of the accuracy benchmark: error against run time, and against resolution."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.benchmarks.accuracy import rule_plots as accuracy_rule_plots
from softrobot_env.benchmarks.accuracy.cases import pyelastica_rod, spiral, tension_step
from softrobot_env.benchmarks.accuracy.plot_parts import (
    STYLE,
    draw_front,
    draw_legend,
    family,
    plain_ticks,
)
from softrobot_env.benchmarks.accuracy.rig import cases as rig_accuracy_cases
from softrobot_env.benchmarks.accuracy.rig import plots as rig_accuracy_plots
from softrobot_env.benchmarks.accuracy.rows import Row
from softrobot_env.benchmarks.accuracy.rule_plots import label_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Thesis, Tab. 2.2 (i7-6700K, compiled MATLAB; its errors are in m according to the audit): pieces,
#: run times [s] with ode15s at 0.9 mm, then with implicit Euler at 10, 1 and 0.1 mm.
_THESIS = {
    "pcc/lumped": (2, 0.105, (0.0633, 0.263, 2.35)),
    "cosserat": (7, 0.828, (0.301, 1.26, 9.88)),
    "ancf": (2, 9.69, (24.0, 40.6, 377.0)),
}
_THESIS_NAMES = {"pcc/lumped": "PCC 2", "cosserat": "CR 7", "ancf": "ANCF 2"}
_ODE15S_ERROR, _EULER_ERRORS = 0.9, (10, 1, 0.1)  # mm

_MOTIONS = {
    spiral.CASE: "Spiral in 3-D under a turning tip force",
    tension_step.CASE: "Tension step of the tendon arm",
    pyelastica_rod.CASE: "Spiral without damping",
}
_REAL_TIME = 3000  # ms

_STATIC_TITLES = {
    "self_weight_weak": "self-weight, weak",
    "self_weight_stiff": "self-weight, stiff",
    "tip_moment_1Nm": "tip moment 1 N m",
    "tip_force_3N": "tip force 3 N",
    "tendon_static": "tendon in a channel",
    "tendon_guided": "tendon through guides",
}
_NUMBER_TITLES = {
    "bending_frequency_weak": "1st bending frequency, weak",
    "bending_frequency_stiff": "1st bending frequency, stiff",
    "torsion_static": "twist under a moment",
    "torsion_frequency": "1st torsional frequency",
}

#: The chain's rule in the figure of all models.
_RULE = "mujoco_chain/balanced2"

#: Errors [mm, %] below are drawn at this value.
_FLOORS = (1e-5, 1e-6)


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw error against run time; beside it, against resolution and by hinge rule.

    Args:
        rows: Rows of `benchmarks.accuracy.run`.
        path: File of the first picture. The others have its name with "_static", "_rules" and
            "_rig".
    """
    path = Path(path)
    rig_accuracy_plots.plot(rows, path.with_stem(f"{path.stem}_rig"))
    rows = [row for row in rows if row["case"] not in rig_accuracy_cases.CASES]
    _work_precision(rows, path)
    _resolution(rows, path.with_stem(f"{path.stem}_static"))
    accuracy_rule_plots.plot(rows, path.with_stem(f"{path.stem}_rules"))


def _work_precision(rows: list[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    moving = [row for row in rows if row["kind"] == "dynamic"]
    panels: list[Callable[[Axes], None]] = []
    for case, title in _MOTIONS.items():
        mine = [row for row in moving if row["case"] == case]
        if mine:
            panels.append(lambda axes, rows=mine, title=title: _motions(axes, rows, title))
        if mine and case == spiral.CASE:
            panels.append(lambda axes, rows=mine: _in_time(axes, rows))
    columns = 2 if len(panels) == 4 else len(panels)
    size = (12, 9.2) if columns == 2 else (5.3 * max(1, columns), 5.2)
    figure = Figure(figsize=size, layout="constrained")
    lines = -(-len(panels) // max(1, columns))
    grid = figure.subplots(lines, columns, squeeze=False) if panels else np.empty((0, 0))
    for axes, draw in zip(grid.flat, panels, strict=True):
        draw(axes)
        plain_ticks(axes)
        _real_time(axes)
    draw_legend(figure, {family(row) for row in moving})
    figure.suptitle("Error against run time: all runs, and the best of each model joined")
    figure.savefig(path, dpi=150)


def _motions(axes: "Axes", rows: list[Row], title: str) -> None:
    for model in STYLE:
        draw_front(axes, model, [row for row in rows if family(row) == model], "e_mean")
    label_axes(axes, title, "run time of 3 s of motion [ms]")
    axes.set_ylabel("mean tip error [mm]")


def _real_time(axes: "Axes") -> None:
    """Mark where a run takes as long as the motion."""
    if axes.get_xlim()[1] > _REAL_TIME:
        axes.axvline(_REAL_TIME, color="0.6", linewidth=1, linestyle="--", zorder=0)
        axes.annotate(
            "real time",
            (_REAL_TIME, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(-3, 0),
            textcoords="offset points",
            rotation=90,
            ha="right",
            fontsize=8,
            color="0.4",
        )


def _in_time(axes: "Axes", rows: list[Row]) -> None:
    """Error of the integrators alone, on the discretisations of the thesis, with its own."""
    for model, (pieces, time, euler) in _THESIS.items():
        mine = [r for r in rows if (r["model"], r["n"]) == (model, pieces)]
        draw_front(axes, model, mine, "e_time")
        color, marker, _ = STYLE[model]
        grey = {"color": "0.5", "marker": marker, "markeredgecolor": color}
        axes.plot([1e3 * t for t in euler], _EULER_ERRORS, **grey, linestyle=":", markersize=6)
        axes.plot(1e3 * time, _ODE15S_ERROR, **grey, markersize=10)
        axes.annotate(
            f"thesis\n{_THESIS_NAMES[model]}",
            (1e3 * time, _ODE15S_ERROR),
            xytext=(0, -9),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=8,
            color="0.35",
        )
    title = "The same, error in time alone, pieces of the thesis"
    label_axes(axes, title, "run time of 3 s of motion [ms]")
    axes.set_ylabel("largest tip error [mm]")
    axes.text(
        0.98,
        0.03,
        "grey: thesis,\nlarge ode15s,\nsmall implicit Euler",
        ha="right",
        va="bottom",
        fontsize=8,
        color="0.35",
        transform=axes.transAxes,
    )


def _resolution(rows: list[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 6.6), layout="constrained")
    shown = [row for row in rows if row["kind"] in ("static", "number")]
    for part, titles, floor in zip(
        figure.subfigures(2, 1), (_STATIC_TITLES, _NUMBER_TITLES), _FLOORS, strict=True
    ):
        panels = part.subplots(1, len(titles), sharex=True, sharey=True)
        for axes, (case, title) in zip(panels, titles.items(), strict=True):
            _draw_resolution(axes, [r for r in shown if r["case"] == case], floor)
            label_axes(axes, title, "pieces (chain: joints)")
            axes.set_xticks([3, 6, 12, 24, 48], labels=["3", "6", "12", "24", "48"])
            axes.set_xticks([], minor=True)
        panels[0].set_ylim(bottom=floor / 2)
        panels[0].set_ylabel("error [%]" if titles is _NUMBER_TITLES else "tip error [mm]")
    draw_legend(figure, {family(row) for row in shown})
    figure.suptitle(
        "Error against resolution, each model to the exact solution of its own physics "
        f"(less than {_FLOORS[0]:g} mm or {_FLOORS[1]:g} %: at the bottom)",
        fontsize=11,
    )
    figure.savefig(path, dpi=150)


def _draw_resolution(axes: "Axes", rows: list[Row], floor: float) -> None:
    for model, (color, marker, _) in STYLE.items():
        name = _RULE if model == "mujoco_chain" else model
        mine = [r for r in rows if r["model"] == name]
        error = [
            1e3 * r["e_mean"] if r["e_relative"] is None else 100 * r["e_relative"] for r in mine
        ]
        axes.plot(
            [r["n"] for r in mine],
            [max(e, floor) for e in error],
            color=color,
            marker=marker,
            markersize=4.5,
            linewidth=1.3,
        )
