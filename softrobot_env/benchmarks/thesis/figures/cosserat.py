"""Details of the Cosserat rod: Fig. 2.4 to 2.6."""

import numpy as np

from softrobot_env.benchmarks.records import groups
from softrobot_env.benchmarks.thesis.figures.drawing import add_legend, draw_model, select
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILLION, Axes

_SOLVERS = {"BDF": BLUE, "Radau, not": VERMILLION, "Radau, projected": GREEN}
_WEIGHTINGS = (BLACK, VERMILLION, PURPLE, ORANGE, BLUE)
_BELOW = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15), "ncols": 1}


def _draw_drift(axes: Axes, rows: list[Row]) -> None:
    curves = groups(select(rows, figure="2.4", x_name="time_s"), "case")
    for (case,), mine in curves.items():
        solver, projection, tolerance = case.split(", ")
        axes.plot(
            [row.x for row in mine],
            [row.y for row in mine],
            color=next(c for key, c in _SOLVERS.items() if case.startswith(key)),
            linestyle=_dashes(case),
            linewidth=1.3,
            label=f"{solver}, {projection}, rel. tolerance {float(tolerance):.0e}",
        )
    for row in select(rows, figure="2.4", y_name="largest_norm_violation"):
        if row.thesis is not None:
            dashes = _dashes(row.case)
            which = "stricter" if dashes == ":" else "its first"
            line = {"color": BLACK, "linestyle": dashes, "linewidth": 0.9}
            axes.axhline(row.thesis, label=f"thesis, projected, {which} tolerance", **line)
    axes.set(yscale="log", xlabel="time [s]", ylabel="largest violation of the norm")
    add_legend(axes, **_BELOW)


def _dashes(case: str) -> str:
    """Line style by the tolerance."""
    return ":" if case.endswith("1e-05") else "-"


def _draw_weightings(axes: Axes, rows: list[Row]) -> None:
    for kind, color in enumerate(_WEIGHTINGS, start=1):
        mine = select(rows, figure="2.5", case=f"xi_{kind}")
        theta = [np.degrees(row.x) for row in mine]
        axes.plot(theta, [row.y for row in mine], color=color, linewidth=1.3, label=_xi(kind))
    axes.set(xlim=(0, 90), ylim=(0.9, 3), ylabel="weighting")
    axes.set_xlabel("half the angle between sections [deg]")
    add_legend(axes, loc="upper left")


def _xi(kind: int) -> str:
    return rf"$\xi_{kind}$"


def _draw_influence(axes: Axes, rows: list[Row]) -> None:
    for moments, dashes, face in (("printed", "-", GREEN), ("conservative", ":", "white")):
        for n, marker in ((3, "s"), (5, "D")):
            mine = select(rows, figure="2.6", case=moments, n=n, y_name="tip_deflection_m")
            line = {"linestyle": dashes, "marker": marker, "markerfacecolor": face}
            draw_model(axes, mine, 1e3, x="x", label=f"{n} pieces, {moments} moments", **line)
    axes.set_xticks(range(1, 6), [_xi(k) for k in range(1, 6)])
    axes.set_ylabel("tip deflection [mm], weak set")
    add_legend(axes, **_BELOW)


COLUMNS, SIZE = 3, (11, 4.9)

#: What they show.
SUBJECT = "drift and weighting of the Cosserat rod"
PANELS = {
    "Fig. 2.4  drift of the quaternions, weak set, 5 pieces": _draw_drift,
    "Fig. 2.5  weighting functions": _draw_weightings,
    "Fig. 2.6  their influence on the deflection": _draw_influence,
}
