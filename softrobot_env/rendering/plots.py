"""Pictures of the recorded episodes of one task, made of a file that has what they show."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from pathlib import Path

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import read_tree, write_tree
from softrobot_env.core.files import file_name
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.robots import centerline
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.tasks import Task

from .curves import (
    Curve,
    draw_path,
    draw_shapes,
    draw_stacked,
    draw_tip,
    end_errors,
    least_error,
    most_input,
    policy_curves,
    spread_of_errors,
    typical_error,
    varied_curves,
)
from .figures import Figure, add_title, finish, new_figure, save

#: End of the names of files that have what pictures show.
DRAWN = "_drawn.npz"

#: A step response is shown for this long [s]; later it only decays.
_STEP_WINDOW = 6.0

#: Episodes in a picture: more cannot be told apart.
_MOST = 6

#: Instants of an episode in a picture, about.
_SAMPLES = 1000

#: Panels side by side in the view from above, and the side [in] of one.
_COLUMNS, _SIDE = 4, 2.6


@dataclass(frozen=True)
class _Comparison:
    """What pictures of episodes on the same task show.

    Attributes:
        title: Task and robot for people.
        varied: Whether the episodes are of one policy on several robots.
        count: Number of episodes that there were; those of `rollouts` err least.
        rollouts: Episodes by name.
        driven: (T, k) of each, reduced inputs [N] or lengths pulled in by servos [m].
        shapes: (n, 3) [m] of each at its end; None of a spatial robot.
        path: (m, 3) [m] of the reference.
        axes: Coordinates of the tip, such as "xz".
        drive: "tension" or "length".
        begin: [s], of what is shown.
        jumps: Whether the reference is set points.
        step: Whether it is a step.
    """

    title: str
    varied: bool
    count: int
    rollouts: dict[str, Rollout]
    driven: dict[str, ndarray]
    shapes: dict[str, ndarray] | None
    path: ndarray
    axes: str
    drive: str
    begin: float
    jumps: bool
    step: bool

    @cached_property
    def curves(self) -> list[Curve]:
        """The episodes in today's colours."""
        return (varied_curves if self.varied else policy_curves)(self.rollouts)

    def shown(self, rollout: Rollout) -> slice:
        """Samples after the approach, and the beginning of a step response."""
        begin = int(np.searchsorted(rollout.time, self.begin))
        end = int(np.searchsorted(rollout.time, _STEP_WINDOW)) if self.step else None
        return slice(begin, end)

    def titled(self, message: str) -> str:
        """A message with what it is about."""
        some = f" ({len(self.rollouts)} of {self.count} that err least)"
        return f"{self.title}{some if len(self.rollouts) < self.count else ''}: {message}"


def plot_task(
    rollouts: Mapping[str, Rollout],
    task: Task,
    title: str,
    out: Path,
    stem: str,
    varied: bool = False,
) -> list[Path]:
    """Write three pictures of episodes on the same task, and what they show for `redraw`.

    Args:
        rollouts: The episodes by policy, or by robot; of more than six, those that err least are
            drawn.
        task: Their task.
        title: Task and robot for people.
        out: Folder to write to.
        stem: Start of the file names.
        varied: Whether they are by robot, of one policy.

    Returns:
        Paths of `<stem>_tip.png` (tip and error over time), then `<stem>_inputs.png` (reduced
        tendon inputs over time) or, of a robot driven by length, `<stem>_lengths.png` (lengths that
        the servos pulled in), and of a planar robot `<stem>_shapes.png` (path of the tip and final
        shapes), of a spatial one `<stem>_path.png` (path of the tip from above). Where the
        trajectory has an approach, they begin after it.
    """
    found = _compared(rollouts, task, title, varied)
    path = Path(out) / file_name(f"{stem}{DRAWN}")
    path.parent.mkdir(parents=True, exist_ok=True)
    records = {name: vars(rollout.slim()) for name, rollout in found.rollouts.items()}
    write_tree(path, vars(found) | {"rollouts": records})
    return redraw(path)


def pictures(
    rollouts: Mapping[str, Rollout], task: Task, title: str, varied: bool = False
) -> dict[str, Figure]:
    """The pictures of `plot_task` by the ends of their names, such as "tip"."""
    return _drawn(_compared(rollouts, task, title, varied))


def _compared(rollouts: Mapping[str, Rollout], task: Task, title: str, varied: bool) -> _Comparison:
    robot = task.robot
    least = sorted(rollouts, key=lambda name: typical_error(rollouts[name]))[:_MOST]
    chosen = {name: rollouts[name] for name in rollouts if name in least}
    thin = {k: r.thinned(r.time[-1] / _SAMPLES) for k, r in chosen.items()}
    by_length = robot.drive.kind == "length"
    inputs = None if by_length else TendonMap(robot)
    return _Comparison(
        title=title,
        varied=varied,
        count=len(rollouts),
        rollouts=thin,
        driven={
            k: r.tendon_length if by_length else inputs.reduced(r.tendon_tension)
            for k, r in thin.items()
        },
        shapes={k: centerline(robot, r.curvature[-1]) for k, r in chosen.items()}
        if robot.is_planar
        else None,
        path=task.trajectory.path(),
        axes=task.axes,
        drive=robot.drive.kind,
        begin=float(getattr(task.trajectory, "approach", 0.0)),
        jumps=bool(getattr(task.trajectory, "jumps", False)),
        step=task.step_width is not None,
    )


def redraw(path: Path) -> list[Path]:
    """Draw the pictures again of which a file has what they show.

    Returns:
        Paths of the pictures, see `plot_task`.

    Raises:
        ValueError: The file is damaged, or another one.
    """
    stem, figures = path.name.removesuffix(DRAWN), _drawn(_read(path))
    return [save(figure, path.with_name(f"{stem}_{k}.png")) for k, figure in figures.items()]


def _drawn(found: _Comparison) -> dict[str, Figure]:
    driven = "lengths" if found.drive == "length" else "inputs"
    out = {"tip": _tip(found), driven: _driven(found)}
    if found.shapes is None:
        return out | {"path": _paths(found)}
    return out | {"shapes": _shapes(found, found.shapes)}


def _read(path: Path) -> _Comparison:
    tree = read_tree(path)
    try:
        rollouts = {k: Rollout(**values) for k, values in tree["rollouts"].items()}
        found = _Comparison(**tree | {"rollouts": rollouts})
        named = [found.driven, *([] if found.shapes is None else [found.shapes])]
        if any(values.keys() != rollouts.keys() for values in named) or not rollouts:
            raise ValueError
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not what pictures need, or damaged") from error
    return found


def _tip(found: _Comparison) -> Figure:
    count = len(found.axes) + 1
    figure, axes = new_figure(count, 1, (7.0, 1.0 + 2.0 * count))
    draw_tip(axes[:, 0], found.curves, found.axes, found.shown)
    message = (spread_of_errors if found.varied else least_error)(found.curves)
    return finish(figure, axes[0, 0], found.titled(message))


def _driven(found: _Comparison) -> Figure:
    """Tensions, reduced inputs or lengths over time."""
    by_length, (first, *_) = found.drive == "length", found.driven.values()
    scale = 1e3 if by_length else 1.0
    kind = "tendon" if by_length else "pair" if found.shapes is not None else "input"
    names = [f"{kind} {i} [{'mm' if by_length else 'N'}]" for i in range(1, first.shape[1] + 1)]
    curves = [
        replace(curve, rollout=replace(curve.rollout, action=scale * found.driven[curve.name]))
        for curve in found.curves
    ]
    figure, axes = new_figure(len(names), 1, (7.0, 1.5 + 1.8 * len(names)))
    draw_stacked(axes[:, 0], curves, lambda r: r.action, names, found.shown)
    name, most = most_input(curves, lambda r: r.action, found.shown)
    pulls = "pulls most, up to" if len(curves) > 1 else "pulls up to"
    text = f"{name} {pulls} {most:.3g} {'mm' if by_length else 'N'}"
    note = "negative: the lower tendon of a pair pulls" if kind == "pair" else ""
    return finish(figure, axes[0, 0], found.titled(text), note)


def _shapes(found: _Comparison, shapes: dict[str, ndarray]) -> Figure:
    """Final shapes, and thin paths of the tips beneath them."""
    figure, ((axis,),) = new_figure(1, 1, (7.0, 5.4))
    draw_shapes(axis, found.curves, [shapes[curve.name] for curve in found.curves])
    entries = axis.get_legend_handles_labels()[0]
    thin = [replace(c, line={**c.line, "linewidth": 0.8, "alpha": 0.7}) for c in found.curves]
    draw_path(axis, thin, found.path)
    return finish(figure, [*entries, axis.lines[-1]], found.titled(end_errors(found.curves)))


def _paths(found: _Comparison) -> Figure:
    """One panel for each episode: laps would cover those of other policies."""
    curves = found.curves
    columns = min(_COLUMNS, len(curves))
    rows = ceil(len(curves) / columns)
    size = (1.0 + _SIDE * columns, 1.2 + _SIDE * rows)
    figure, axes = new_figure(rows, columns, size, share=True)
    figure.get_layout_engine().set(h_pad=0.1)  # inches, between ticks and titles
    # The first point is the start of the approach.
    reference = found.path[1:] if found.begin else found.path
    style = {"linestyle": "none", "marker": "+"} if found.jumps else {}
    for axis, curve in zip(axes.flat, curves, strict=False):
        draw_path(axis, [curve], reference, "xy", found.shown, **style)
        axis.set(xlabel="", ylabel="")
        axis.set_title(curve.label, fontsize="medium")
        axis.tick_params(labelbottom=True)  # also above an empty place
    figure.supxlabel("x [mm]", fontsize="medium")
    figure.supylabel("y [mm]", fontsize="medium")
    add_title(figure, found.titled(f"{least_error(found.curves)}; from above, reference in black"))
    return figure
