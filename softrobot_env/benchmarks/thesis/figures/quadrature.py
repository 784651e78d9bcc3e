"""Order of integration of the ANCF element: Fig. 2.8 and 2.9."""

from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.figures.drawing import (
    GREY,
    add_legend,
    draw_level,
    draw_model,
    select,
)
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import BLUE, GREEN, THESIS, VERMILLION, Axes


def _draw_errors(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.8", y_name="relative_rms_error")
    for reference, color, marker, by in (
        ("order 20", GREEN, "^", " (thesis)"),
        ("exact", VERMILLION, "o", ""),
    ):
        curve = select(mine, case=f"legendre, against {reference}")
        label = f"Gauss-Legendre, against {reference}{by}"
        draw_model(axes, curve, x="x", color=color, marker=marker, label=label)
    draw_level(axes, 1e-3, linestyle="--")
    axes.axvline(values.ORDER, color=GREY, linewidth=1, linestyle=":")
    axes.text(values.ORDER + 0.2, 0.25, "thesis' choice", color=GREY, fontsize=8)
    _set_axes(axes, "relative rms error of the elastic force", "lower left")


def _draw_times(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.9", case="legendre")
    draw_model(axes, mine, 1e6, x="x", label="Gauss-Legendre")
    for case, color, dashes, label in (
        ("exact", VERMILLION, "-", "moments, exact"),
        ("chebyshev", BLUE, "--", "Gauss-Chebyshev, exact"),
    ):
        for row in select(rows, figure="2.9", case=case):
            draw_level(axes, 1e6 * row.y, color=color, linestyle=dashes, label=label)
    printed = THESIS | {"label": f"thesis, order {values.ORDER}"}
    axes.plot(values.ORDER, 1e6 * values.ORDER_TIME, **printed)
    _set_axes(axes, r"time per evaluation [$\mu$s]", "center right")


def _set_axes(axes: Axes, y: str, place: str) -> None:
    axes.set(yscale="log", xlabel="order", ylabel=y)
    axes.set_xticks(range(0, 21, 2))
    add_legend(axes, loc=place)


COLUMNS, SIZE = 2, (9.5, 4.6)

#: What they show.
SUBJECT = "quadrature of elastic forces, error and time"
PANELS = {
    "Fig. 2.8  error of the elastic force, one element": _draw_errors,
    "Fig. 2.9  time per evaluation (with damping and inertia)": _draw_times,
}
