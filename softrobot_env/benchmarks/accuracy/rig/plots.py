"""Figure of the rig in the accuracy benchmark: error at rest, and error against run time."""

from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.benchmarks.accuracy.plot_parts import (
    STYLE,
    draw_front,
    draw_legend,
    family,
    plain_ticks,
)
from softrobot_env.benchmarks.accuracy.rig.cases import CIRCLE, DURATION, STEP
from softrobot_env.benchmarks.accuracy.rows import Row
from softrobot_env.benchmarks.accuracy.rule_plots import label_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

_STATIC_TITLES = {
    "rig_pull_10mm": "one tendon 10 mm",
    "rig_pull_20mm": "one tendon 20 mm",
    "rig_general": "two tendons 12, 6 mm",
    "rig_slack": "12, 4 mm, third slack",
}
_MOTION_TITLES = {STEP: "Length step of 10 mm", CIRCLE: "Fast circle"}

#: The chain's rule where each model has one line.
_RULE = "mujoco_chain/balanced2"


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the rows of the rig as PNG.

    Args:
        rows: Rows of `benchmarks.accuracy.run`; without the rig's no file is written.
        path: File to write.
    """
    from matplotlib.figure import Figure

    cases = (*_STATIC_TITLES, *_MOTION_TITLES)
    mine = [row for row in rows if row["case"] in cases and row["kind"] in ("static", "dynamic")]
    if not mine:
        return
    figure = Figure(figsize=(11, 8.2), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.25])
    _draw_static(upper, [row for row in mine if row["kind"] == "static"])
    _draw_motions(lower, [row for row in mine if row["kind"] == "dynamic"])
    draw_legend(figure, {family(row) for row in mine})
    figure.savefig(path, dpi=150)


def _draw_static(figure: "SubFigure", rows: list[Row]) -> None:
    figure.suptitle("Spatial rig at rest: tip error to the exact solution of each physics")
    panels = figure.subplots(1, len(_STATIC_TITLES), sharex=True, sharey=True)
    for axes, (case, title) in zip(panels, _STATIC_TITLES.items(), strict=True):
        for model, (color, marker, _) in STYLE.items():
            name = _RULE if model == "mujoco_chain" else model
            line = [row for row in rows if (row["case"], row["model"]) == (case, name)]
            x, y = [row["n"] for row in line], [1e3 * row["e_mean"] for row in line]
            axes.plot(x, y, color=color, marker=marker, markersize=4.5, linewidth=1.3)
        label_axes(axes, title, "pieces (chain: joints)")
        _pieces(axes)
    panels[0].set_ylabel("tip error [mm]")
    plain_ticks(panels[0])
    _pieces(panels[0])


def _pieces(axes: "Axes") -> None:
    ticks = [1, 2, 4, 8, 16, 32]
    axes.set_xticks(ticks, labels=[str(n) for n in ticks])
    axes.set_xticks([], minor=True)


def _draw_motions(figure: "SubFigure", rows: list[Row]) -> None:
    figure.suptitle("In motion: all runs, and the best of each model joined")
    shown = {case: title for case, title in _MOTION_TITLES.items() if _of(rows, case)}
    panels = figure.subplots(1, max(1, len(shown)), squeeze=False, sharey=True)[0]
    for axes, (case, title) in zip(panels, shown.items(), strict=False):
        for model in STYLE:
            mine = [row for row in _of(rows, case) if family(row) == model]
            draw_front(axes, model, mine, "e_mean")
        label_axes(axes, title, f"run time of {DURATION:g} s of motion [ms]")
        plain_ticks(axes)
    panels[0].set_ylabel("mean tip error [mm]")


def _of(rows: list[Row], case: str) -> list[Row]:
    return [row for row in rows if row["case"] == case]
