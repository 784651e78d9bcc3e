"""Order of integration of the ANCF element: Fig. 2.8 and 2.9."""

from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.figures.drawing import (
    GREY,
    draw_level,
    draw_model,
    name_ends,
    note_at,
    select,
)
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import BLUE, GREEN, THESIS, VERMILLION, Axes, Line2D


def _draw_errors(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.8", y_name="relative_rms_error")
    for reference, color, marker, by in (
        ("order 20", GREEN, "^", "\n(thesis)"),
        ("exact", VERMILLION, "o", ""),
    ):
        curve = select(mine, case=f"legendre, against {reference}")
        label = f"against {reference}{by}"
        draw_model(axes, curve, x="x", color=color, marker=marker, label=label)
    draw_level(axes, 1e-3, linestyle="--")
    note_at(axes, (20, 1e-3), "0.1 %", ha="right")
    axes.axvline(values.ORDER, color=GREY, linewidth=1, linestyle=":")
    axes.text(values.ORDER + 0.2, 0.25, "thesis' choice", color=GREY, fontsize=8)
    _set_axes(axes, "relative rms error of the elastic force")


def _draw_times(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.9", case="legendre")
    draw_model(axes, mine, 1e6, x="x", label="Gauss-Legendre")
    for case, color, dashes, label in (
        ("exact", VERMILLION, "-", "moments, exact"),
        ("chebyshev", BLUE, "--", "Gauss-Chebyshev,\nexact"),
    ):
        for row in select(rows, figure="2.9", case=case):
            draw_level(axes, 1e6 * row.y, color=color, linestyle=dashes, label=label)
    printed = values.ORDER, 1e6 * values.ORDER_TIME
    axes.plot(*printed, **THESIS | {"label": "_"})
    note_at(axes, printed, "thesis", ha="center", xytext=(0, 8))
    _set_axes(axes, "time per evaluation [µs]")


def _set_axes(axes: Axes, y: str) -> None:
    axes.set(yscale="log", xlabel="order of Gauss-Legendre", ylabel=y)
    axes.set_xticks(range(0, 21, 2))
    name_ends(axes)


def legend(rows: list[Row]) -> list[Line2D]:
    """None: all lines have their names."""
    return []


def message(rows: list[Row]) -> str:
    """What the thesis' order errs, and costs over exact moments."""
    chosen = {"case": "legendre, against exact", "y_name": "relative_rms_error"}
    errors = [r.y for r in select(rows, figure="2.8", **chosen) if r.x == values.ORDER]
    times = [r.y for r in select(rows, figure="2.9", case="legendre") if r.x == values.ORDER]
    exact = [r.y for r in select(rows, figure="2.9", case="exact")]
    if not (errors and times and exact):
        return "Quadrature of elastic forces"
    return (
        f"Order {values.ORDER}, the thesis' choice, errs by {100 * errors[0]:.2g} % and takes "
        f"{times[0] / exact[0]:.2g} times as long as exact moments"
    )


COLUMNS, SIZE = 2, (10.0, 4.4)

#: What they show.
SUBJECT = "quadrature of elastic forces, error and time"
PANELS = {
    "Fig. 2.8  error of the elastic force, one element": _draw_errors,
    "Fig. 2.9  time, with damping and inertia": _draw_times,
}
