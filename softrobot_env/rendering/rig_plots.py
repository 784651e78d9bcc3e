"""Plots of recorded episodes of the spatial test rig, as thesis Figs. 5.10 to 5.13 have them."""

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.rendering.figures import SMALLEST_ERROR, add_legend, new_figure, save, styles
from softrobot_env.rig_tasks import RigTask
from softrobot_env.rollout import Rollout

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
    figures = {
        "tip": _plot_tip(rollouts, task, title),
        "lengths": _plot_lengths(rollouts, task, title),
        "path": _plot_path(rollouts, task, title),
    }
    return save(figures, out, stem)


def _shown(rollout: Rollout, task: RigTask) -> slice:
    """Samples to show."""
    return slice(int(rollout.time.searchsorted(getattr(task.trajectory, "approach", 0.0))), None)


def _plot_tip(rollouts: dict[str, Rollout], task: RigTask, title: str) -> "Figure":
    figure, axes = new_figure(3, 1, (7.0, 7.0))
    longest = max(rollouts.values(), key=lambda r: r.time[-1])
    shown = _shown(longest, task)
    for index, axis in enumerate(axes[:2]):
        wanted = 1e3 * longest.reference[shown, index]
        axis.plot(longest.time[shown], wanted, "k--", linewidth=1, zorder=3, label="reference")
    for label, rollout, colour in styles(rollouts):
        shown = _shown(rollout, task)
        series = (rollout.tip[:, 0], rollout.tip[:, 1], rollout.error)
        for axis, values in zip(axes, series, strict=True):
            axis.plot(rollout.time[shown], 1e3 * values[shown], color=colour, label=label)
    for axis, text in zip(axes, ("tip x in mm", "tip y in mm", "error in mm"), strict=True):
        axis.set_ylabel(text)
    axes[-1].set_yscale("log")
    axes[-1].set_ylim(bottom=SMALLEST_ERROR)
    axes[-1].set_xlabel("time in s")
    add_legend(figure, axes[0])
    figure.suptitle(title)
    return figure


def _plot_lengths(rollouts: dict[str, Rollout], task: RigTask, title: str) -> "Figure":
    count = len(task.robot.tendons)
    figure, axes = new_figure(count, 1, (7.0, 1.5 + 1.8 * count))
    for label, rollout, colour in styles(rollouts):
        shown = _shown(rollout, task)
        for axis, values in zip(axes, 1e3 * rollout.tendon_length.T, strict=True):
            axis.plot(rollout.time[shown], values[shown], color=colour, label=label)
    for number, axis in enumerate(axes, 1):
        axis.set_ylabel(f"tendon {number} in mm")
    axes[-1].set_xlabel("time in s")
    add_legend(figure, axes[0])
    figure.suptitle(f"{title}: length pulled in by the servos")
    return figure


def _plot_path(rollouts: dict[str, Rollout], task: RigTask, title: str) -> "Figure":
    """One panel for each episode: laps would cover those of other policies."""
    columns = min(_COLUMNS, len(rollouts))
    rows = ceil(len(rollouts) / columns)
    size = (1.0 + _SIDE * columns, 1.2 + _SIDE * rows)
    figure, axes = new_figure(rows, columns, size, share=True)
    figure.get_layout_engine().set(h_pad=0.1)  # inches, between ticks and titles
    for axis, (label, rollout, colour) in zip(axes, styles(rollouts), strict=False):
        shown = _shown(rollout, task)
        axis.plot(*1e3 * rollout.tip[shown, :2].T, color=colour, linewidth=1)
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
