"""Motion of the tip on the spiral: Fig. 2.20 to 2.22."""

import numpy as np

from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.figures.drawing import (
    draw_level,
    draw_models,
    name_ends,
    note_at,
    select,
    set_pieces_axis,
)
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.figures import Axes, Line2D, entry, label_of, style_of


def _draw_distances(axes: Axes, rows: list[Row]) -> None:
    draw_models(axes, rows, "2.20", "spiral", "mean_distance_m", 1e3)
    for (bound, _), dashes, text in (
        (values.CHOSEN_BOUND, "--", "thesis' limit for Tab. 2.2"),
        (values.FINEST_BOUND, ":", "thesis' bound for the finest"),
    ):
        draw_level(axes, 1e3 * bound, linestyle=dashes)
        note_at(axes, (20, 1e3 * bound), text, ha="right")
    axes.set(yscale="log", ylabel="mean distance to the mean of the models [mm]")
    set_pieces_axis(axes)
    name_ends(axes)


def _draw_tip_over_time(axes: Axes, rows: list[Row]) -> None:
    _draw_tips(axes, rows, ("time", "x"))
    axes.set(xlabel="time [s]", ylabel="tip, x [mm]")


def _draw_tip_path(axes: Axes, rows: list[Row]) -> None:
    _draw_tips(axes, rows, ("x", "y"))
    axes.set(xlabel="tip, x [mm]", ylabel="tip, y [mm]", aspect="equal")


def _draw_tips(axes: Axes, rows: list[Row], names: tuple[str, str]) -> None:
    """Two of time, x and y for all models and their mean."""
    for model in ("mean of models", *MODELS):
        series, n = _series(rows, model)
        axes.plot(*(series[name] for name in names), **_line(model, n))


def _line(model: str, n: int | None) -> dict:
    """Matplotlib's keywords of a model with n pieces, or of the mean of all."""
    if n is None:
        return {"color": "0.75", "linewidth": 3, "label": model}
    label = f"{label_of(model)}, {n} pieces (Figs. 2.21, 2.22)"
    return style_of(model).curve | {"linewidth": 1.2, "label": label}


def legend(rows: list[Row]) -> list[Line2D]:
    """Entries of the motions."""
    shown = [(model, _series(rows, model)[1]) for model in ("mean of models", *MODELS)]
    return [entry(**_line(model, n)) for model, n in shown]


def message(rows: list[Row]) -> str:
    """How far the tips of the finest models are from their mean."""
    off = []
    for model in MODELS:
        mine = select(rows, figure="2.20", model=model, y_name="mean_distance_m")
        if mine:
            finest = max(mine, key=lambda row: row.n)
            off.append(
                (finest.y, f"{1e3 * finest.y:.2g} mm ({label_of(model)}, {finest.n} pieces)")
            )
    if not off:
        return "Tips on the spiral"
    return f"The finest models' tips are {min(off)[1]} to {max(off)[1]} from the mean of all"


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
