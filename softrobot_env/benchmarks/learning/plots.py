"""Learning curves of `benchmarks.learning`."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.learning.run import Row
from softrobot_env.benchmarks.records import groups
from softrobot_env.rendering.figures import add_title, label_lines, new_figure, save, style_of

_LABELS = {
    "reward": "mean reward of the checks",
    "max_mm": "largest error of the checks [mm]",
}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the checks over environment steps: median of the seeds, and all that lies between."""
    figure, (axes,) = new_figure(1, 2, (9.5, 4.2))
    last: dict[str, float] = {}
    learned = groups((row for row in rows if row.curve), "policy")
    for axis, (entry, label) in zip(axes, _LABELS.items(), strict=True):
        ends = []
        for (name,), mine in learned.items():
            steps, values = _common([row.curve for row in mine], entry)
            style = style_of(name)
            line = {**style.curve, "marker": "."}
            last[name] = float(np.median(values, axis=0)[-1])
            ends.append((name, last[name], style.colour))
            axis.plot(steps / 1e6, np.median(values, axis=0), **line)
            least, most = values.min(axis=0), values.max(axis=0)
            axis.fill_between(steps / 1e6, least, most, color=style.colour, alpha=0.2, lw=0)
        axis.set(xlabel="environment steps [million]", ylabel=label)
        axis.locator_params(axis="x", nbins=5)
        if entry == "max_mm":
            axis.set_yscale("log")
        label_lines(axis, ends)
    least = min(last, key=last.__getitem__)
    add_title(
        figure,
        f"After training {least} errs least: its largest error is {last[least]:.2g} mm",
        "Checks of the mean action during training, swing and L-shape also with E x 0.5 and x 1.5: "
        "median and range of the seeds",
    )
    save(figure, path)


def _common(curves: list[list[dict[str, float]]], entry: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (k,) of the checks of all seeds, and values (seeds, k)."""
    count = min(len(curve) for curve in curves)
    steps = np.array([point["steps"] for point in curves[0][:count]])
    return steps, np.array([[point[entry] for point in curve[:count]] for curve in curves])
