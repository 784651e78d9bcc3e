"""Curves of recorded episodes over time, for robots of any kind."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.rendering.figures import REFERENCE, add_legend, new_figure, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Samples of an episode to show.
Shown = Callable[[Rollout], slice]

_AXES = "xyz"

#: Lower end [mm] of the error axis.
_SMALLEST_ERROR = 1e-2


def tip_curves(rollouts: dict[str, Rollout], axes: str, shown: Shown, title: str) -> "Figure":
    """Two coordinates of the tip, "xz" for instance, with their reference, and the error."""
    figure, grid = new_figure(3, 1, (7.0, 7.0))
    panels = grid[:, 0]
    longest = max(rollouts.values(), key=lambda r: r.time[-1])
    indices = [_AXES.index(name) for name in axes]
    part = shown(longest)
    for panel, index in zip(panels, indices, strict=False):
        wanted = 1e3 * longest.reference[part, index]
        panel.plot(longest.time[part], wanted, **REFERENCE)
    for label, rollout, line in styles(rollouts):
        part = shown(rollout)
        series = (*(rollout.tip[:, index] for index in indices), rollout.error)
        for panel, values in zip(panels, series, strict=True):
            panel.plot(rollout.time[part], 1e3 * values[part], **line, label=label)
    names = (*(f"tip {name} in mm" for name in axes), "error in mm")
    for panel, name in zip(panels, names, strict=True):
        panel.set_ylabel(name)
    panels[-1].set_yscale("log")
    panels[-1].set_ylim(bottom=_SMALLEST_ERROR)
    return _finish(figure, panels, title)


def stacked_curves(
    rollouts: dict[str, Rollout],
    values: Callable[[Rollout], np.ndarray],
    names: list[str],
    shown: Shown,
    title: str,
) -> "Figure":
    """The columns of `values` (samples, k), one below the other, with their k names."""
    figure, grid = new_figure(len(names), 1, (7.0, 1.5 + 1.8 * len(names)))
    panels = grid[:, 0]
    for label, rollout, line in styles(rollouts):
        part = shown(rollout)
        for panel, column in zip(panels, values(rollout).T, strict=True):
            panel.plot(rollout.time[part], column[part], **line, label=label)
    for panel, name in zip(panels, names, strict=True):
        panel.set_ylabel(name)
    return _finish(figure, panels, title)


def styles(rollouts: dict[str, Rollout]) -> list[tuple[str, Rollout, dict[str, Any]]]:
    """(label, episode, keywords of its lines); a failure is told in the label."""
    return [
        (
            f"{label} (failed at {r.time[-1]:.2f} s)" if r.failure else label,
            r,
            style_of(label).curve,
        )
        for label, r in rollouts.items()
    ]


def _finish(figure: "Figure", panels: np.ndarray, title: str) -> "Figure":
    panels[-1].set_xlabel("time in s")
    add_legend(figure, panels[0])
    figure.suptitle(title)
    return figure
