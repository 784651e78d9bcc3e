"""Figs. 6.14 to 6.22 of the thesis anew, and error against policy time."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.benchmarks.controllers.cases import PCC, Row
from softrobot_env.benchmarks.controllers.cost_plot import error_against_time
from softrobot_env.benchmarks.controllers.curves import (
    COLOURS,
    MODULI,
    OTHER,
    Curve,
    draw_arms,
    draw_curvatures,
    draw_inputs,
    draw_path,
    draw_tip,
    finish,
    new_figure,
)
from softrobot_env.benchmarks.controllers.rows import moduli, names, one, select
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.evaluation.thesis import CONTROLLERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Policies in Figs. 6.14 to 6.19: the thesis' controllers, and ours to compare.
_COMPARED = (*CONTROLLERS, "lq_adaptive")

#: Policies whose behaviour with another Young's modulus is shown, and names of their figures.
_VARIED = {
    "qs_nn": "fig_6_20",
    "lqi": "fig_6_21",
    "mpc": "fig_6_22",
    "lq_adaptive": "robustness_lq_adaptive",
    "mpc_preview": "robustness_mpc_preview",
}

#: [s] of a step response that is shown from near, and as a whole.
_STEP_WINDOWS = (1.0, 5.0)


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw as PNG what there are rows for.

    Args:
        rows: Rows of `benchmarks.controllers.run`.
        path: A file in the folder of the figures, which have names of their own (`fig_6_14.png`).
    """
    for name, draw in _figures(rows):
        figure = draw()
        if figure is not None:
            figure.savefig(Path(path).with_name(f"{name}.png"), dpi=130)


def _figures(rows: list[Row]) -> Iterator[tuple[str, Callable[[], "Figure | None"]]]:
    step = _compared(rows, "step", 0.05)
    yield "fig_6_14", lambda: _step(step)
    swing, lshape = (_compared(rows, task) for task in ("swing", "lshape"))
    yield "fig_6_15", lambda: _tracking(swing, "Fig. 6.15  swing, PCC plant")
    yield "fig_6_16", lambda: _inputs(swing, "Fig. 6.16  swing, PCC plant")
    yield "fig_6_17", lambda: _arms(swing, "Fig. 6.17  the arm at the end of the swing, PCC plant")
    yield "fig_6_18", lambda: _plane(lshape, "Fig. 6.18  L-shape, PCC plant")
    yield "fig_6_19", lambda: _inputs(lshape, "Fig. 6.19  L-shape, PCC plant")
    for policy, name in _VARIED.items():
        curves = _varied(rows, policy)
        number = name.removeprefix("fig_").replace("_", ".")
        title = f"Fig. {number}" if policy in CONTROLLERS else "As Figs. 6.20 to 6.22"
        text = f"{title}  swing of {policy} with another Young's modulus, PCC plant"
        yield name, lambda c=curves, t=text: _tracking(c, t) if len(c) > 1 else None
    yield "error_against_time", lambda: error_against_time(rows)


def _compared(rows: list[Row], task: str, width: float | None = None) -> list[Curve]:
    mine = select(rows, setting="thesis", task=task, step_width=width)
    shown = [name for name in names(mine) if name in _COMPARED]
    return [_curve(one(mine, policy=name), name, COLOURS.get(name, OTHER)) for name in shown]


def _varied(rows: list[Row], policy: str) -> list[Curve]:
    mine = select(rows, plant=PCC, task="swing", policy=policy, feedback="state")
    found = {factor: one(mine, modulus=factor) for factor in moduli(mine)}
    return [
        _curve(row, variation_label(row) or "nominal E", MODULI.get(factor, OTHER))
        for factor, row in found.items()
        if row is not None
    ]


def _curve(row: Row, label: str, colour: str) -> Curve:
    failed = f" (failed at {row['trace']['time'][-1]:.2f} s)" if row["failure"] else ""
    return Curve(label + failed, colour, row["trace"])


def _step(curves: list[Curve]) -> "Figure | None":
    if not curves:
        return None
    figure, axes = new_figure(2, 2, (10, 6))
    for column, end in enumerate(_STEP_WINDOWS):
        draw_tip(axes[:, column], curves, end)
    return finish(figure, axes, "Fig. 6.14  step of 50 mm, PCC plant")


def _tracking(curves: list[Curve], title: str) -> "Figure | None":
    if not curves:
        return None
    figure, axes = new_figure(3, 1, (8, 8))
    draw_tip(axes[:, 0], curves)
    return finish(figure, axes, title)


def _inputs(curves: list[Curve], title: str) -> "Figure | None":
    if not curves:
        return None
    figure, axes = new_figure(curves[0].trace["inputs"].shape[1], 1, (8, 7.5))
    draw_inputs(axes[:, 0], curves)
    return finish(figure, axes, f"{title}: tendon force (positive: upper tendon)")


def _arms(curves: list[Curve], title: str) -> "Figure | None":
    if not curves:
        return None
    figure, axes = new_figure(1, 2, (12, 4.6))
    draw_arms(axes[0, 0], curves)
    draw_curvatures(axes[0, 1], curves)
    return finish(figure, axes, title)


def _plane(curves: list[Curve], title: str) -> "Figure | None":
    """Tip and error over time on the left, the path in the plane on the right."""
    if not curves:
        return None
    figure, axes = new_figure(3, 2, (12, 8))
    draw_tip(axes[:, 0], curves)
    grid = axes[0, 1].get_gridspec()
    for axis in axes[:, 1]:
        axis.remove()
    draw_path(figure.add_subplot(grid[:, 1]), curves)
    return finish(figure, axes[:, :1], title)
