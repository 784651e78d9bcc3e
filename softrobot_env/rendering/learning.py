"""Learning curves: closed-loop checks during trainings, over environment steps."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from softrobot_env.rendering.curves import finish
from softrobot_env.rendering.figures import Axes, Style, new_figure, save

#: Checks of a training: environment steps, reward, and largest error [mm].
Checks = list[dict[str, float]]

_LABELS = {"reward": "mean reward of the checks", "max_mm": "largest error [mm]"}


def plot_checks(
    trainings: Mapping[str, tuple[Style, Sequence[Checks]]], title: str, path: Path | str
) -> None:
    """Draw the checks: median of the trainings of one kind, and all that lies between.

    Args:
        trainings: Name of the kind -> how it is drawn, and curves of its trainings.
        title: Above the panels.
        path: PNG to write.
    """
    figure, (axes,) = new_figure(1, 2, (11, 4.2))
    for axis, (entry, label) in zip(axes, _LABELS.items(), strict=True):
        for name, (style, curves) in trainings.items():
            _draw(axis, name, style, [curve for curve in curves if curve], entry)
        axis.set(xlabel="environment steps [million]", ylabel=label)
        axis.locator_params(axis="x", nbins=5)
    axes[1].set_yscale("log")
    save(finish(figure, axes[0], title), path)


def _draw(axis: Axes, name: str, style: Style, curves: list[Checks], entry: str) -> None:
    if not curves:
        return
    steps, values = _common(curves, entry)
    line = {**style.curve, "marker": ".", "label": name}
    axis.plot(steps / 1e6, np.median(values, axis=0), **line)
    least, most = values.min(axis=0), values.max(axis=0)
    axis.fill_between(steps / 1e6, least, most, color=style.colour, alpha=0.2, lw=0)


def _common(curves: list[Checks], entry: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (k,) of the checks that all trainings have, and values (trainings, k)."""
    count = min(len(curve) for curve in curves)
    steps = np.array([point["steps"] for point in curves[0][:count]])
    return steps, np.array([[point[entry] for point in curve[:count]] for curve in curves])
