"""Error on the swing against the policy time of all controllers."""

from typing import TYPE_CHECKING

from softrobot_env.benchmarks.controllers.cases import Row
from softrobot_env.benchmarks.controllers.curves import COLOURS, OTHER, new_figure
from softrobot_env.benchmarks.controllers.rows import select
from softrobot_env.evaluation.thesis import CONTROLLERS, FIGURES, POLICY_TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Setting -> (label, whether markers are filled).
_SETTINGS = {"mujoco": ("MuJoCo", True), "thesis": ("PCC plant", False)}

_ERRORS = {"e_rms": "rms error on the swing [mm]", "e_max": "largest error on the swing [mm]"}


def error_against_time(rows: list[Row]) -> "Figure | None":
    """Rms and largest error over the median policy time; the thesis gives the largest only."""
    rows = [row for row in select(rows, task="swing", failure=None) if row["setting"] in _SETTINGS]
    if not rows:
        return None
    figure, axes = new_figure(1, 2, (11, 4.8))
    for axis, (metric, text) in zip(axes.flat, _ERRORS.items(), strict=True):
        _draw_ours(axis, rows, metric)
        axis.set_ylabel(text)
        axis.set_xlabel("policy time per decision, median [us]")
        axis.set_xscale("log")
        axis.set_yscale("log")
    _draw_thesis(axes.flat[1])
    _legend(figure, rows)
    return figure


def _draw_ours(axis: "Axes", rows: list[Row], metric: str) -> None:
    for row in rows:
        filled = _SETTINGS[row["setting"]][1]
        colour = COLOURS.get(row["policy"], OTHER)
        face = colour if filled else "white"
        place = 1e6 * row["policy_time_median"], 1e3 * row[metric]
        axis.plot(*place, "o", color=colour, markerfacecolor=face, markersize=7)


def _draw_thesis(axis: "Axes") -> None:
    of_controller = {controller: policy for policy, controller in CONTROLLERS.items()}
    for figure in FIGURES:
        if figure.task == "swing":
            place = 1e6 * POLICY_TIME[figure.controller], 1e3 * figure.e_max
            colour = COLOURS[of_controller[figure.controller]]
            axis.plot(*place, "*", color=colour, markersize=13, markeredgecolor="black")


def _legend(figure: "Figure", rows: list[Row]) -> None:
    from matplotlib.lines import Line2D

    def entry(label: str, colour: str, marker: str = "o", **line: object) -> Line2D:
        return Line2D([], [], color=colour, marker=marker, linestyle="none", label=label, **line)

    shown = dict.fromkeys(row["policy"] for row in rows)
    handles = [entry(policy, COLOURS.get(policy, OTHER)) for policy in shown]
    grey = "0.35"
    for label, filled in _SETTINGS.values():
        handles.append(entry(label, grey, markerfacecolor=grey if filled else "white"))
    handles.append(entry("thesis (colour: its controller)", grey, "*", markersize=11))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=9)
