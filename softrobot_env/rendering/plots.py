"""Pictures of the recorded episodes of one task."""

from collections.abc import Sequence
from functools import partial
from math import ceil
from pathlib import Path

import numpy as np

from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.rendering.curves import (
    Curve,
    Values,
    draw_path,
    draw_shapes,
    draw_stacked,
    draw_tip,
    finish,
)
from softrobot_env.rendering.figures import Figure, add_legend, new_figure, save
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.tasks import Task

#: A step response is shown for this long [s]; later it only decays.
_STEP_WINDOW = 6.0

#: Episodes in a picture: more cannot be told apart.
_MOST = 6

#: Panels side by side in the view from above, and the side [in] of one.
_COLUMNS, _SIDE = 4, 2.6


def plot_task(curves: Sequence[Curve], task: Task, title: str, out: Path, stem: str) -> list[Path]:
    """Write three pictures of episodes on the same task.

    Args:
        curves: The episodes; of more than six, those that err least are drawn.
        task: Their task.
        title: Task and robot for people.
        out: Folder to write to.
        stem: Start of the file names.

    Returns:
        Paths of `<stem>_tip.png` (tip and error over time), then `<stem>_inputs.png` (reduced
        tendon inputs over time) or, of a robot driven by length, `<stem>_lengths.png` (lengths that
        the servos pulled in), and of a planar robot `<stem>_shapes.png` (path of the tip and final
        shapes), of a spatial one `<stem>_path.png` (path of the tip from above). Where the
        trajectory has an approach, they begin after it.
    """
    if len(curves) > _MOST:
        title = f"{title}, the {_MOST} of {len(curves)} that err least"
        least = sorted(curves, key=_typical_error)[:_MOST]
        curves = [curve for curve in curves if any(curve is one for one in least)]
    robot = task.robot
    figures = {"tip": _tip(curves, task, title)}
    if robot.drive.kind == "length":
        names = [f"tendon {i} [mm]" for i in range(1, len(robot.tendons) + 1)]
        text = f"{title}: length pulled in by the servos"
        figures["lengths"] = _stacked(curves, lambda r: 1e3 * r.tendon_length, names, task, text)
    else:
        inputs = TendonMap(robot)
        what = "pair" if robot.is_planar else "input"
        names = [f"{what} {i} [N]" for i in range(1, inputs.n_inputs + 1)]
        text = f"{title}: tendon tension (positive: upper tendon)"
        if not robot.is_planar:
            text = f"{title}: reduced inputs of the tendons"
        figures["inputs"] = _stacked(
            curves, lambda r: inputs.reduced(r.tendon_tension), names, task, text
        )
    if robot.is_planar:
        figures["shapes"] = _shapes(curves, task, title)
    else:
        figures["path"] = _paths(curves, task, title)
    return [save(figure, out / f"{stem}_{name}.png") for name, figure in figures.items()]


def _typical_error(curve: Curve) -> float:
    """Root mean square error [m] of an episode; of one that failed it counts more than any."""
    rollout = curve.rollout
    return np.inf if rollout.failure else float(np.sqrt(np.mean(rollout.error**2)))


def _shown(task: Task, rollout: Rollout) -> slice:
    """Samples to show: those after the approach, and the beginning of a step response."""
    begin = int(np.searchsorted(rollout.time, getattr(task.trajectory, "approach", 0.0)))
    if task.step_width is None:
        return slice(begin, None)
    return slice(begin, int(np.searchsorted(rollout.time, _STEP_WINDOW)))


def _tip(curves: Sequence[Curve], task: Task, title: str) -> Figure:
    count = len(task.axes) + 1
    figure, axes = new_figure(count, 1, (7.0, 1.0 + 2.0 * count))
    draw_tip(axes[:, 0], curves, task.axes, partial(_shown, task))
    return finish(figure, axes[0, 0], title)


def _stacked(
    curves: Sequence[Curve], values: Values, names: list[str], task: Task, title: str
) -> Figure:
    figure, axes = new_figure(len(names), 1, (7.0, 1.5 + 1.8 * len(names)))
    draw_stacked(axes[:, 0], curves, values, names, partial(_shown, task))
    return finish(figure, axes[0, 0], title)


def _shapes(curves: Sequence[Curve], task: Task, title: str) -> Figure:
    """Final shapes, and thin paths of the tips beneath them."""
    figure, ((axis,),) = new_figure(1, 1, (6.0, 5.0))
    draw_shapes(axis, curves, task.robot)
    entries = axis.get_legend_handles_labels()[0]
    thin = [Curve(c.name, c.rollout, {**c.line, "linewidth": 0.8, "alpha": 0.7}) for c in curves]
    draw_path(axis, thin, task.trajectory.path())
    figure.suptitle(f"{title}: path of the tip and final shape", fontsize=11)
    add_legend(figure, [*entries, axis.lines[-1]])
    return figure


def _paths(curves: Sequence[Curve], task: Task, title: str) -> Figure:
    """One panel for each episode: laps would cover those of other policies."""
    columns = min(_COLUMNS, len(curves))
    rows = ceil(len(curves) / columns)
    size = (1.0 + _SIDE * columns, 1.2 + _SIDE * rows)
    figure, axes = new_figure(rows, columns, size, share=True)
    figure.get_layout_engine().set(h_pad=0.1)  # inches, between ticks and titles
    reference = task.trajectory.path()
    if getattr(task.trajectory, "approach", 0.0):
        reference = reference[1:]  # the first point is the start of the approach
    jumps = getattr(task.trajectory, "jumps", False)
    style = {"linestyle": "none", "marker": "+"} if jumps else {}
    for axis, curve in zip(axes.flat, curves, strict=False):
        draw_path(axis, [curve], reference, "xy", partial(_shown, task), **style)
        axis.set(xlabel="", ylabel="")
        axis.set_title(curve.label, fontsize="medium")
        axis.tick_params(labelbottom=True)  # also above an empty place
    for axis in axes.flat[len(curves) :]:
        axis.set_visible(False)
    figure.supxlabel("x [mm]", fontsize="medium")
    figure.supylabel("y [mm]", fontsize="medium")
    what = "path of the tip from above, reference in black"
    figure.suptitle(f"{title}:{' ' if columns > 2 else chr(10)}{what}", fontsize=11)
    return figure
