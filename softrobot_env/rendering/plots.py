"""Plots of recorded episodes, in the manner of thesis Figs. 6.14 to 6.22."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.rendering.curves import stacked_curves, styles, tip_curves
from softrobot_env.rendering.figures import REFERENCE, add_legend, new_figure, save
from softrobot_env.robots import centerline
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.tasks import Task

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
    shown = partial(_shown, task)
    tendon_map = TendonMap(task.robot)
    figures = {
        "tip": tip_curves(rollouts, "xz", shown, task.label),
        "inputs": stacked_curves(
            rollouts,
            lambda rollout: tendon_map.reduced(rollout.tendon_tension),
            [f"pair {i} in N" for i in range(1, tendon_map.n_inputs + 1)],
            shown,
            f"{task.label}: tendon tension (positive: upper tendon)",
        ),
        "shapes": _plot_shapes(rollouts, task),
    }
    return [save(figure, out / f"{stem}_{name}.png") for name, figure in figures.items()]


def _shown(task: Task, rollout: Rollout) -> slice:
    """Samples to show over time."""
    if task.step_width is None:
        return slice(None)
    return slice(0, int(np.searchsorted(rollout.time, _STEP_WINDOW)))


def _plot_shapes(rollouts: dict[str, Rollout], task: Task) -> "Figure":
    figure, ((axis,),) = new_figure(1, 1, (6.0, 5.0))
    reference = task.trajectory.path()
    axis.plot(1e3 * reference[:, 0], 1e3 * reference[:, 2], **REFERENCE)
    drawn = styles(rollouts)
    for order, (label, rollout, line) in enumerate(drawn):
        tip = 1e3 * rollout.tip
        axis.plot(tip[:, 0], tip[:, 2], **line, linewidth=0.8, alpha=0.7)
        shape = 1e3 * centerline(task.robot, rollout.curvature[-1])
        # Later lines are thinner, so that equal shapes show beneath one another.
        width = 2 + min(1.8, 9 / len(drawn)) * (len(drawn) - 1 - order)
        axis.plot(shape[:, 0], shape[:, 2], **line, linewidth=width, label=label)
    axis.set_aspect("equal")
    axis.set_xlabel("x in mm")
    axis.set_ylabel("z in mm")
    add_legend(figure, axis)
    figure.suptitle(f"{task.label}: path of the tip and final shape")
    return figure
