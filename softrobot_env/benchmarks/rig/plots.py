"""Figs. 5.10 to 5.14 of the thesis anew, and what goes beyond."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.benchmarks.controllers.curves import new_figure
from softrobot_env.benchmarks.jobs import Row
from softrobot_env.benchmarks.rig.cases import FAST, SLOW
from softrobot_env.benchmarks.rig.tables import episodes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: One colour per policy in every figure.
_COLOURS = {
    "rig_nn": "#D55E00",
    "inverse_dynamics": "#0072B2",
    "inverse_dynamics_ahead": "#56B4E9",
    "hybrid": "#009E73",
    "hybrid_ahead": "#E69F00",
    "hybrid_flexible": "#CC79A7",
    "hybrid_calibrated": "#882255",
}

#: Name of the figure -> title, period and policies of its paths.
_PATHS = {
    "fig_5_10": ("Fig. 5.10", SLOW, ("rig_nn", "inverse_dynamics", "hybrid")),
    "fig_5_11": ("Fig. 5.11", FAST, ("rig_nn",)),
    "fig_5_12": ("Fig. 5.12", FAST, ("inverse_dynamics", "hybrid")),
    "beyond": ("Beyond the thesis", FAST, ("hybrid", "hybrid_flexible", "hybrid_calibrated")),
}

_REFERENCE = {"color": "black", "linestyle": (0, (4, 2)), "linewidth": 0.9, "zorder": 5}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw as PNG what there are rows for.

    Args:
        rows: Rows of `benchmarks.rig.run`.
        path: A file in the folder of the figures, which have names of their own (`fig_5_10.png`).
    """
    traces = {(r["policy"], r["period"]): r["trace"] for r in episodes(rows) if "trace" in r}
    path = Path(path)
    for name, (title, period, policies) in _PATHS.items():
        mine = {p: traces[p, period] for p in policies if (p, period) in traces}
        if mine:
            _draw_tracking(mine, f"{title}  triangle, T = {period:g} s", path.with_stem(name))
    pair = [traces.get((name, FAST)) for name in ("rig_nn", "hybrid")]
    if None not in pair:
        _draw_parts(*pair, path.with_stem("fig_5_13"))
    forces = [row for row in rows if row.get("figure", "").startswith("5.14")]
    if forces:
        _draw_forces(forces, path.with_stem("fig_5_14"))


def _draw_tracking(traces: dict[str, dict], title: str, path: Path) -> None:
    """Paths on the left, errors over time on the right."""
    figure, axes = new_figure(1, 2, (10.5, 4.8))
    left, right = axes[0]
    one = next(iter(traces.values()))
    lap = (
        one["time"] <= one["time"][-1] * 2 / 7
    )  # the first; the dashes of several laps would fill each other
    for name, trace in traces.items():
        line = {"color": _COLOURS[name], "linewidth": 1.1, "label": name}
        left.plot(*(1e3 * trace["tip"]).T, **line)
        right.plot(trace["time"], 1e3 * trace["error"], **line)
    left.plot(*(1e3 * one["reference"][lap]).T, **_REFERENCE, label="reference")
    left.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    right.set(xlabel="time after the approach [s]", ylabel="error [mm]")
    right.set_ylim(bottom=0)
    _finish(figure, left, title, path)


def _draw_parts(network: dict, hybrid: dict, path: Path) -> None:
    """Both parts of the first tendon's length: what the hybrid adds is the dynamic one."""
    figure, axes = new_figure(1, 1, (9.0, 4.2))
    axis = axes[0, 0]
    quasi_static, both = (1e3 * trace["lengths"][:, 0] for trace in (network, hybrid))
    curves = (
        ("quasi-static part: network", quasi_static, _COLOURS["rig_nn"]),
        ("dynamic part: inverse dynamics", both - quasi_static, _COLOURS["inverse_dynamics"]),
        ("hybrid", both, _COLOURS["hybrid"]),
    )
    for label, values, colour in curves:
        axis.plot(network["time"], values, color=colour, linewidth=1.2, label=label)
    axis.set(xlabel="time after the approach [s]", ylabel="$s_1$ [mm]")
    _finish(figure, axis, f"Fig. 5.13  length of tendon 1, triangle, T = {FAST:g} s", path)


def _draw_forces(rows: list[Row], path: Path) -> None:
    """Effective tendon force and its phase over the angular velocity."""
    figure, axes = new_figure(2, 1, (7.5, 5.6))
    for axis, name in zip(axes[:, 0], ("effective_force_N", "phase_rad"), strict=True):
        mine = [row for row in rows if row["y_name"] == name]
        x, y = (np.array([row[key] for row in mine]) for key in ("x", "y"))
        axis.plot(
            x, np.degrees(y) if name == "phase_rad" else y, color=_COLOURS["inverse_dynamics"]
        )
        axis.set_xscale("log")
    for row in rows:
        if row["y_name"] == "omega_of_least_force_rad_s":
            _mark(axes[0, 0], row["y"], "least force")
        if row["y_name"] == "omega_of_balance_rad_s":
            _mark(axes[1, 0], row["y"], "stiffness and inertia in balance")
    axes[0, 0].set(yscale="log", ylabel="effective force [N]")
    axes[1, 0].set(xlabel="angular velocity [rad/s]", ylabel="ahead of the output [deg]")
    axes[1, 0].set_yticks([0, 45, 90, 135, 180])
    for axis in axes[:, 0]:
        axis.legend(fontsize=9, frameon=False)
    figure.suptitle("Fig. 5.14  circle of 90 mm", fontsize=11)
    figure.savefig(path, dpi=130)


def _mark(axis: "Axes", x: float, what: str) -> None:
    axis.axvline(x, color="0.4", linewidth=0.9, ls=(0, (4, 2)), label=f"{what}: {x:.2g} rad/s")


def _finish(figure: object, axis: "Axes", title: str, path: Path) -> None:
    """Title, legend below the axes, file."""
    handles, labels = axis.get_legend_handles_labels()
    figure.suptitle(title, fontsize=11)
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9
    )
    figure.savefig(path, dpi=130)
