"""Learning curves of `benchmarks.learning`."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.learning.run import Row
from softrobot_env.benchmarks.records import groups
from softrobot_env.rendering.curves import finish
from softrobot_env.rendering.figures import new_figure, save, style_of

_LABELS = {
    "reward": "mean reward of the checks",
    "max_mm": "largest error on swing and L-shape [mm]",
}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the checks over environment steps: median of the seeds, and all that lies between."""
    figure, (axes,) = new_figure(1, 2, (11, 4.2))
    learned = groups((row for row in rows if row.curve), "policy")
    for axis, (entry, label) in zip(axes, _LABELS.items(), strict=True):
        for (name,), mine in learned.items():
            steps, values = _common([row.curve for row in mine], entry)
            style = style_of(name)
            line = {**style.curve, "marker": ".", "label": name}
            axis.plot(steps / 1e6, np.median(values, axis=0), **line)
            least, most = values.min(axis=0), values.max(axis=0)
            axis.fill_between(steps / 1e6, least, most, color=style.colour, alpha=0.2, lw=0)
        axis.set(xlabel="environment steps [million]", ylabel=label)
        axis.locator_params(axis="x", nbins=5)
    axes[1].set_yscale("log")
    title = "Closed-loop checks of the mean action during training: median and range of the seeds"
    save(finish(figure, axes[0], title), path)


def _common(curves: list[list[dict[str, float]]], entry: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (k,) of the checks of all seeds, and values (seeds, k)."""
    count = min(len(curve) for curve in curves)
    steps = np.array([point["steps"] for point in curves[0][:count]])
    return steps, np.array([[point[entry] for point in curve[:count]] for curve in curves])
