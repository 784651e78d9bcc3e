"""Plots of recorded episodes, in the manner of thesis Figs. 6.14 to 6.22."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.robots import centerline
from softrobot_env.rollout import Rollout
from softrobot_env.tasks import Task
from softrobot_env.tendon_map import TendonMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Okabe and Ito's palette, readable with colour-blindness and in print, without the black of the
#: reference and with three more.
_COLOURS = (
    "#7F7F7F",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#6A3D9A",
    "#8C510A",
)

#: Lower end [mm] of the error axis.
_SMALLEST_ERROR = 1e-2

#: A step response is shown for this long [s]; later it only decays.
_STEP_WINDOW = 6.0


def plot_task(rollouts: dict[str, Rollout], task: Task, out: Path, stem: str) -> list[Path]:
    """Write three pictures of episodes on the same task.

    Args:
        rollouts: Episodes by the label to show.
        task: Their task.
        out: Folder to write to.
        stem: Start of the file names.

    Returns:
        Paths of `<stem>_tip.png` (tip and error over time), `<stem>_inputs.png` (reduced tendon
        inputs over time) and `<stem>_shapes.png` (path of the tip and final shapes).
    """
    figures = {
        "tip": _plot_tip(rollouts, task),
        "inputs": _plot_inputs(rollouts, task),
        "shapes": _plot_shapes(rollouts, task),
    }
    paths = []
    for name, figure in figures.items():
        paths.append(out / f"{stem}_{name}.png")
        figure.savefig(paths[-1], dpi=150)
    return paths


def _figure(
    rows: int, columns: int, size: tuple[float, float]
) -> tuple["Figure", Sequence["Axes"]]:
    try:
        from matplotlib.figure import Figure  # not pyplot: no display, no global state
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install softrobot_env[viz]") from error

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.grid(True, color="0.9", linewidth=0.8)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _styles(rollouts: dict[str, Rollout]) -> list[tuple[str, Rollout, str]]:
    """(label, episode, colour); a failure is told in the label."""
    return [
        (f"{label} (failed at {r.time[-1]:.2f} s)" if r.failure else label, r, colour)
        for (label, r), colour in zip(
            rollouts.items(), _cycle(_COLOURS, len(rollouts)), strict=True
        )
    ]


def _cycle(colours: tuple[str, ...], count: int) -> list[str]:
    return [colours[i % len(colours)] for i in range(count)]


def _add_legend(figure: "Figure", axis: "Axes") -> None:
    """One legend for all axes, below them."""
    handles, labels = axis.get_legend_handles_labels()
    columns = min(4, len(labels))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize="small")


def _shown(rollout: Rollout, task: Task) -> slice:
    """Samples to show over time."""
    if task.step_width is None:
        return slice(None)
    return slice(0, int(np.searchsorted(rollout.time, _STEP_WINDOW)))


def _plot_tip(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    figure, axes = _figure(3, 1, (7.0, 7.0))
    longest = max(rollouts.values(), key=lambda r: r.time[-1])
    shown = _shown(longest, task)
    for axis, index in zip(axes, (0, 2), strict=False):
        axis.plot(
            longest.time[shown],
            1e3 * longest.reference[shown, index],
            "k--",
            zorder=3,
            label="reference",
        )
    for label, rollout, colour in _styles(rollouts):
        shown = _shown(rollout, task)
        series = (rollout.tip[:, 0], rollout.tip[:, 2], rollout.error)
        for axis, values in zip(axes, series, strict=True):
            axis.plot(rollout.time[shown], 1e3 * values[shown], color=colour, label=label)
    for axis, text in zip(axes, ("tip x in mm", "tip z in mm", "error in mm"), strict=True):
        axis.set_ylabel(text)
    axes[-1].set_yscale("log")
    axes[-1].set_ylim(bottom=_SMALLEST_ERROR)
    axes[-1].set_xlabel("time in s")
    _add_legend(figure, axes[0])
    figure.suptitle(task.label)
    return figure


def _plot_inputs(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    tendon_map = TendonMap(task.robot)
    count = tendon_map.n_inputs
    figure, axes = _figure(count, 1, (7.0, 1.5 + 1.8 * count))
    for label, rollout, colour in _styles(rollouts):
        shown = _shown(rollout, task)
        reduced = tendon_map.reduced(rollout.tendon_tension)
        for axis, values in zip(axes, reduced.T, strict=True):
            axis.plot(rollout.time[shown], values[shown], color=colour, label=label)
    for number, axis in enumerate(axes, 1):
        axis.set_ylabel(f"pair {number} in N")
    axes[-1].set_xlabel("time in s")
    _add_legend(figure, axes[0])
    figure.suptitle(f"{task.label}: tendon tension (positive: upper tendon)")
    return figure


def _plot_shapes(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    figure, (axis,) = _figure(1, 1, (6.0, 5.0))
    reference = task.trajectory.path()
    axis.plot(1e3 * reference[:, 0], 1e3 * reference[:, 2], "k--", linewidth=1, label="reference")
    styles = _styles(rollouts)
    for order, (label, rollout, colour) in enumerate(styles):
        tip = 1e3 * rollout.tip
        axis.plot(tip[:, 0], tip[:, 2], color=colour, linewidth=0.8, alpha=0.7)
        shape = 1e3 * centerline(task.robot, rollout.curvature[-1])
        # Later lines are thinner, so that equal shapes show beneath one another.
        width = 2 + min(1.8, 9 / len(styles)) * (len(styles) - 1 - order)
        axis.plot(shape[:, 0], shape[:, 2], color=colour, linewidth=width, label=label)
    axis.set_aspect("equal")
    axis.set_xlabel("x in mm")
    axis.set_ylabel("z in mm")
    _add_legend(figure, axis)
    figure.suptitle(f"{task.label}: path of the tip and final shape")
    return figure
