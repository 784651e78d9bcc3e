"""Motion of the tip on the spiral: Fig. 2.20 to 2.22."""

import numpy as np

from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.figures.drawing import (
    GREY,
    add_legend,
    draw_level,
    draw_models,
    select,
    set_pieces_axis,
)
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.figures import Axes, label_of, style_of


def _draw_distances(axes: Axes, rows: list[Row]) -> None:
    draw_models(axes, rows, "2.20", "spiral", "mean_distance_m", 1e3)
    for (bound, _), dashes, text in (
        (values.CHOSEN_BOUND, "--", "thesis' limit for Tab. 2.2"),
        (values.FINEST_BOUND, ":", "thesis' bound for the finest"),
    ):
        draw_level(axes, 1e3 * bound, linestyle=dashes)
        axes.text(20, 1.03e3 * bound, text, color=GREY, fontsize=8, ha="right")
    axes.set(yscale="log", ylabel="mean distance to the mean of the models [mm]")
    set_pieces_axis(axes)
    add_legend(axes, loc="upper right")


def _draw_tip_over_time(axes: Axes, rows: list[Row]) -> None:
    _draw_tips(axes, rows, ("time", "x"))
    axes.set(xlabel="time [s]", ylabel="tip, x [mm]", ylim=(-78, 78))
    add_legend(axes, loc="lower left")


def _draw_tip_path(axes: Axes, rows: list[Row]) -> None:
    _draw_tips(axes, rows, ("x", "y"))
    axes.set(xlabel="tip, x [mm]", ylabel="tip, y [mm]", aspect="equal")


def _draw_tips(axes: Axes, rows: list[Row], names: tuple[str, str]) -> None:
    """Two of time, x and y for all models and their mean."""
    for model in ("mean of models", *MODELS):
        series, n = _series(rows, model)
        line = {"color": "0.75", "linewidth": 3, "label": model}
        if n is not None:
            line = style_of(model).curve | {"linewidth": 1.2}
            line |= {"label": f"{label_of(model)}, n = {n}"}
        axes.plot(*(series[name] for name in names), **line)


def _series(rows: list[Row], model: str) -> tuple[dict[str, np.ndarray], int | None]:
    """Time [s], x and y [mm] of a model's tip, smoothly interpolated, and its pieces."""
    from scipy.interpolate import CubicSpline

    x = select(rows, figure="2.21", case="spiral", model=model)
    y = select(rows, figure="2.22", case="spiral", model=model, y_name="tip_y_m")
    time = [row.x for row in x]
    fine = np.linspace(time[0], time[-1], 1201)
    splines = (CubicSpline(time, [1e3 * row.y for row in part])(fine) for part in (x, y))
    return dict(zip(("time", "x", "y"), (fine, *splines), strict=True)), x[0].n


COLUMNS, SIZE = 3, (12, 4.9)

#: What they show.
SUBJECT = "the spiral under a turning force"
PANELS = {
    "Fig. 2.20  distance over the number of pieces": _draw_distances,
    "Fig. 2.21  tip over time": _draw_tip_over_time,
    "Fig. 2.22  path of the tip": _draw_tip_path,
}
