"""Curves of episodes, in the manner of thesis Figs. 6.14 to 6.22."""

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.benchmarks.controllers.cases import Trace
from softrobot_env.robots import ARM, centerline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: One colour per policy in every figure: Okabe and Ito's, readable with colour-blindness.
COLOURS = {
    "qs_nn": "#D55E00",
    "lqi": "#0072B2",
    "mpc": "#009E73",
    "lq_adaptive": "#CC79A7",
    "lq_preview": "#E69F00",
    "mpc_preview": "#882255",
    "feedforward": "#56B4E9",
    "feedforward_pi": "#999999",
}

#: Colours of factors on Young's modulus: warm where the robot is softer than known.
MODULI = {0.5: "#D55E00", 0.75: "#E69F00", 1.0: "#009E73", 1.25: "#56B4E9", 1.5: "#0072B2"}

#: Colour of what has none of its own.
OTHER = "#666666"

_REFERENCE = {
    "color": "black",
    "linestyle": (0, (4, 2)),
    "linewidth": 0.9,
    "label": "reference",
    "zorder": 5,  # above the curves, which would hide it
}

#: Lower end [mm] of an axis of errors.
_SMALLEST = 1e-3

_MOST_COLUMNS = 9  # of a legend


@dataclass(frozen=True)
class Curve:
    """An episode to draw.

    Attributes:
        label: For the legend.
        colour: Matplotlib's.
        trace: See `controllers_cases.Trace`.
    """

    label: str
    colour: str
    trace: Trace


def new_figure(rows: int, columns: int, size: tuple[float, float]) -> tuple["Figure", np.ndarray]:
    """A figure of `size` [inch] with axes (rows, columns)."""
    from matplotlib.figure import Figure  # not pyplot: no display, no global state

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        style(axis)
    return figure, axes


def style(axis: "Axes") -> None:
    """Light grid, no box."""
    axis.grid(True, color="0.9", linewidth=0.7)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def finish(figure: "Figure", axes: np.ndarray, title: str) -> "Figure":
    """Title, and one legend below all axes, where it covers nothing."""
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.suptitle(title, fontsize=11)
    columns = ceil(len(labels) / ceil(len(labels) / _MOST_COLUMNS))
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )
    return figure


def draw_tip(axes: np.ndarray, curves: list[Curve], end: float | None = None) -> None:
    """Position x and z of the tip on two axes, the error on a third if there is one.

    Args:
        axes: (2,) or (3,).
        curves: The episodes.
        end: [s] to show; all unless given.
    """
    longest = max(curves, key=lambda curve: curve.trace["time"][-1]).trace
    shown = longest["time"] <= (np.inf if end is None else end)
    for axis, index, name in zip(axes, (0, 2), "xz", strict=False):
        axis.plot(longest["time"][shown], 1e3 * longest["reference"][shown, index], **_REFERENCE)
        _draw(axis, curves, lambda trace, i=index: 1e3 * trace["tip"][:, i], end)
        axis.set_ylabel(f"tip {name} [mm]")
    if len(axes) == 3:
        _draw(axes[2], curves, lambda trace: 1e3 * trace["error"], end)
        axes[2].set_yscale("log")
        axes[2].set_ylim(bottom=_SMALLEST)
        axes[2].set_ylabel("error [mm]")
    axes[-1].set_xlabel("time [s]")


def _draw(axis: "Axes", curves: list[Curve], values: object, end: float | None = None) -> None:
    for curve in curves:
        time = curve.trace["time"]
        shown = time <= (np.inf if end is None else end)
        line = {"color": curve.colour, "linewidth": 1.2, "label": curve.label}
        axis.plot(time[shown], values(curve.trace)[shown], **line)


def draw_inputs(axes: np.ndarray, curves: list[Curve]) -> None:
    """Force of every tendon pair over time, one axis each."""
    for pair, axis in enumerate(axes):
        _draw(axis, curves, lambda trace, k=pair: trace["inputs"][:, k])
        axis.set_ylabel(f"$u_{pair + 1}$ [N]")
    axes[-1].set_xlabel("time [s]")


def draw_arms(axis: "Axes", curves: list[Curve]) -> None:
    """Shape of the arm at the end of each episode, and the path of the reference."""
    reference = 1e3 * curves[0].trace["reference"]
    axis.plot(reference[:, 0], reference[:, 2], **_REFERENCE)
    for order, curve in enumerate(curves):
        shape = 1e3 * centerline(ARM, curve.trace["curvature"])
        line = {"color": curve.colour, "linewidth": _width(order, curves), "label": curve.label}
        axis.plot(shape[:, 0], shape[:, 2], solid_capstyle="butt", **line)
    _plane(axis)


def _width(order: int, curves: list[Curve]) -> float:
    """Later lines are thinner, so that equal ones show beneath one another."""
    return 1.5 + 1.3 * (len(curves) - 1 - order)


def draw_curvatures(axis: "Axes", curves: list[Curve]) -> None:
    """Curvature along the arm at the end of each episode."""
    for order, curve in enumerate(curves):
        values = curve.trace["curvature"]
        edges = np.linspace(0, 1e3 * ARM.length, len(values) + 1)
        line = {"color": curve.colour, "linewidth": _width(order, curves)}
        axis.stairs(values, edges, baseline=None, **line)
    axis.set_xlabel("arc length from the base [mm]")
    axis.set_ylabel("curvature [1/m]")


def draw_path(axis: "Axes", curves: list[Curve]) -> None:
    """Path of the tip in the plane."""
    style(axis)
    for curve in curves:
        tip = 1e3 * curve.trace["tip"]
        axis.plot(tip[:, 0], tip[:, 2], color=curve.colour, linewidth=1.2)
    reference = 1e3 * curves[0].trace["reference"]
    axis.plot(reference[:, 0], reference[:, 2], **_REFERENCE)
    _plane(axis)


def _plane(axis: "Axes") -> None:
    axis.set_aspect("equal")
    axis.set_xlabel("x [mm]")
    axis.set_ylabel("z [mm]")
