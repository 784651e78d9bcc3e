"""Plots of recorded episodes of the spatial test rig, as thesis Figs. 5.10 to 5.13 have them."""

from functools import partial
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.rendering.curves import stacked_curves, styles, tip_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.tasks.rig import RigTask

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Panels side by side in the view from above, and the side [in] of one.
_COLUMNS, _SIDE = 4, 2.6


def plot_rig_task(
    rollouts: dict[str, Rollout], task: RigTask, title: str, out: Path, stem: str
) -> list[Path]:
    """Write three pictures of episodes on the same task.

    Args:
        rollouts: Episodes by the label to show.
        task: Their task.
        title: Task and rig for people.
        out: Folder to write to.
        stem: Start of the file names.

    Returns:
        Paths of `<stem>_tip.png` (tip and error over time), `<stem>_lengths.png` (lengths that the
        servos pulled in over time) and `<stem>_path.png` (path of the tip from above); where the
        trajectory has an approach, they begin after it.
    """
    shown = partial(_shown, task)
    figures = {
        "tip": tip_curves(rollouts, "xy", shown, title),
        "lengths": stacked_curves(
            rollouts,
            lambda rollout: 1e3 * rollout.tendon_length,
            [f"tendon {i} in mm" for i in range(1, len(task.robot.tendons) + 1)],
            shown,
            f"{title}: length pulled in by the servos",
        ),
        "path": _plot_path(rollouts, task, title),
    }
    return [save(figure, out / f"{stem}_{name}.png") for name, figure in figures.items()]


def _shown(task: RigTask, rollout: Rollout) -> slice:
    """Samples to show."""
    return slice(int(rollout.time.searchsorted(getattr(task.trajectory, "approach", 0.0))), None)


def _plot_path(rollouts: dict[str, Rollout], task: RigTask, title: str) -> "Figure":
    """One panel for each episode: laps would cover those of other policies."""
    columns = min(_COLUMNS, len(rollouts))
    rows = ceil(len(rollouts) / columns)
    size = (1.0 + _SIDE * columns, 1.2 + _SIDE * rows)
    figure, grid = new_figure(rows, columns, size, share=True)
    axes = grid.ravel()
    figure.get_layout_engine().set(h_pad=0.1)  # inches, between ticks and titles
    for axis, (label, rollout, line) in zip(axes, styles(rollouts), strict=False):
        shown = _shown(task, rollout)
        axis.plot(*1e3 * rollout.tip[shown, :2].T, **line, linewidth=1)
        _draw_reference(axis, task)
        axis.set_title(label, fontsize="medium")
        axis.set_aspect("equal")
        axis.tick_params(labelbottom=True)  # also above an empty place
    for axis in axes[len(rollouts) :]:
        axis.set_visible(False)
    figure.supxlabel("x in mm", fontsize="medium")
    figure.supylabel("y in mm", fontsize="medium")
    figure.suptitle(f"{title}: path of the tip from above, reference in black")
    return figure


def _draw_reference(axis: "Axes", task: RigTask) -> None:
    """Path of the reference after its approach, or the points it jumps to."""
    path = 1e3 * task.trajectory.path()[:, :2]
    if getattr(task.trajectory, "approach", 0.0):
        path = path[1:]  # the first point is the start of the approach
    style = "k+" if getattr(task.trajectory, "jumps", False) else "k--"
    axis.plot(*path.T, style, linewidth=1)
