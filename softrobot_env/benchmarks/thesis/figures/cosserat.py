"""Details of the Cosserat rod: Fig. 2.4 to 2.6."""

import numpy as np

from softrobot_env.benchmarks.records import groups
from softrobot_env.benchmarks.thesis.figures.drawing import (
    draw_model,
    name_ends,
    select,
)
from softrobot_env.benchmarks.thesis.rows import Row
from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILLION,
    Axes,
    Line2D,
    entry,
)

_SOLVERS = {"BDF": BLUE, "Radau, not": VERMILLION, "Radau, projected": GREEN}
_WEIGHTINGS = (BLACK, VERMILLION, PURPLE, ORANGE, BLUE)
_NAMES = {"BDF": "BDF", "Radau, not": "Radau", "Radau, projected": "Radau, projected"}


def _draw_drift(axes: Axes, rows: list[Row]) -> None:
    curves = groups(select(rows, figure="2.4", x_name="time_s"), "case")
    for (case,), mine in curves.items():
        key = next(key for key in _SOLVERS if case.startswith(key))
        line = {"color": _SOLVERS[key], "linestyle": _dashes(case), "linewidth": 1.3}
        axes.plot([row.x for row in mine], [row.y for row in mine], **line, label=_NAMES[key])
    for row in select(rows, figure="2.4", y_name="largest_norm_violation"):
        if row.thesis is not None:
            line = {"color": BLACK, "linestyle": _dashes(row.case), "linewidth": 0.9}
            axes.axhline(row.thesis, label="thesis, projected", **line)
    axes.set(yscale="log", xlabel="time [s]", ylabel="largest violation of the norm")
    name_ends(axes)


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
    name_ends(axes)


def _xi(kind: int) -> str:
    return rf"$\xi_{kind}$"


def _draw_influence(axes: Axes, rows: list[Row]) -> None:
    for moments, dashes, face in (("printed", "-", GREEN), ("conservative", ":", "white")):
        for n, marker in ((3, "s"), (5, "D")):
            mine = select(rows, figure="2.6", case=moments, n=n, y_name="tip_deflection_m")
            line = {"linestyle": dashes, "marker": marker, "markerfacecolor": face}
            draw_model(axes, mine, 1e3, x="x", label=f"{n} pieces,\n{moments}", **line)
    axes.set_xticks(range(1, 6), [_xi(k) for k in range(1, 6)])
    axes.set_ylabel("tip deflection [mm], weak set")
    name_ends(axes)


def _draw_nothing(axes: Axes, rows: list[Row]) -> None:
    axes.set_visible(False)


def legend(rows: list[Row]) -> list[Line2D]:
    """Entries of what lines mean."""
    tolerances = {"-": "Fig. 2.4: relative tolerance 1e-3", ":": "1e-5 (thesis: stricter)"}
    return [entry(text, color=BLACK, linestyle=line) for line, text in tolerances.items()]


def message(rows: list[Row]) -> str:
    """How far quaternions drift with and without projection."""
    drift = {}
    for row in select(rows, figure="2.4", x_name="time_s"):
        how = "not projected" if ", not projected" in row.case else "projected"
        drift[how] = max(row.y, drift.get(how, 0.0))
    told = [f"{value:.1g} when {how}" for how, value in drift.items()]
    return f"Norms of quaternions drift by up to {' and '.join(told)}" if told else "Drift"


COLUMNS, SIZE = 2, (9.5, 7.6)

#: What they show.
SUBJECT = "drift and weighting of the Cosserat rod"
PANELS = {
    "Fig. 2.4  drift of the quaternions, weak set, 5 pieces": _draw_drift,
    "Fig. 2.5  weighting functions": _draw_weightings,
    "Fig. 2.6  their influence, by the moments": _draw_influence,
    "": _draw_nothing,
}
