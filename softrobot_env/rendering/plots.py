"""Plots of recorded episodes, in the manner of thesis Figs. 6.14 to 6.22."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.rendering.figures import SMALLEST_ERROR, add_legend, new_figure, save, styles
from softrobot_env.robots import centerline
from softrobot_env.rollout import Rollout
from softrobot_env.tasks import Task
from softrobot_env.tendon_map import TendonMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    return save(figures, out, stem)


def _shown(rollout: Rollout, task: Task) -> slice:
    """Samples to show over time."""
    if task.step_width is None:
        return slice(None)
    return slice(0, int(np.searchsorted(rollout.time, _STEP_WINDOW)))


def _plot_tip(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    figure, axes = new_figure(3, 1, (7.0, 7.0))
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
    for label, rollout, colour in styles(rollouts):
        shown = _shown(rollout, task)
        series = (rollout.tip[:, 0], rollout.tip[:, 2], rollout.error)
        for axis, values in zip(axes, series, strict=True):
            axis.plot(rollout.time[shown], 1e3 * values[shown], color=colour, label=label)
    for axis, text in zip(axes, ("tip x in mm", "tip z in mm", "error in mm"), strict=True):
        axis.set_ylabel(text)
    axes[-1].set_yscale("log")
    axes[-1].set_ylim(bottom=SMALLEST_ERROR)
    axes[-1].set_xlabel("time in s")
    add_legend(figure, axes[0])
    figure.suptitle(task.label)
    return figure


def _plot_inputs(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    tendon_map = TendonMap(task.robot)
    count = tendon_map.n_inputs
    figure, axes = new_figure(count, 1, (7.0, 1.5 + 1.8 * count))
    for label, rollout, colour in styles(rollouts):
        shown = _shown(rollout, task)
        reduced = tendon_map.reduced(rollout.tendon_tension)
        for axis, values in zip(axes, reduced.T, strict=True):
            axis.plot(rollout.time[shown], values[shown], color=colour, label=label)
    for number, axis in enumerate(axes, 1):
        axis.set_ylabel(f"pair {number} in N")
    axes[-1].set_xlabel("time in s")
    add_legend(figure, axes[0])
    figure.suptitle(f"{task.label}: tendon tension (positive: upper tendon)")
    return figure


def _plot_shapes(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    figure, (axis,) = new_figure(1, 1, (6.0, 5.0))
    reference = task.trajectory.path()
    axis.plot(1e3 * reference[:, 0], 1e3 * reference[:, 2], "k--", linewidth=1, label="reference")
    drawn = styles(rollouts)
    for order, (label, rollout, colour) in enumerate(drawn):
        tip = 1e3 * rollout.tip
        axis.plot(tip[:, 0], tip[:, 2], color=colour, linewidth=0.8, alpha=0.7)
        shape = 1e3 * centerline(task.robot, rollout.curvature[-1])
        # Later lines are thinner, so that equal shapes show beneath one another.
        width = 2 + min(1.8, 9 / len(drawn)) * (len(drawn) - 1 - order)
        axis.plot(shape[:, 0], shape[:, 2], color=colour, linewidth=width, label=label)
    axis.set_aspect("equal")
    axis.set_xlabel("x in mm")
    axis.set_ylabel("z in mm")
    add_legend(figure, axis)
    figure.suptitle(f"{task.label}: path of the tip and final shape")
    return figure
