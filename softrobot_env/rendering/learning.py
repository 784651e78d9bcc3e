"""Learning curves: closed-loop checks during trainings, over environment steps."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy import ndarray

from .figures import Axes, Figure, Style, add_title, label_lines, new_figure

#: Checks of a training: environment steps, reward, and largest error [mm].
Checks = list[dict[str, float]]

_LABELS = {"reward": "mean reward of the checks", "max_mm": "largest error of the checks [mm]"}


def checks_figure(trainings: Mapping[str, tuple[Style, Sequence[Checks]]], subject: str) -> Figure:
    """Draw the checks: median of the trainings of one kind, and all that lies between.

    Args:
        trainings: Name of the kind -> how it is drawn, and curves of its trainings.
        subject: What is shown.
    """
    figure, (axes,) = new_figure(1, 2, (9.5, 4.2))
    last: dict[str, float] = {}
    for axis, (entry, label) in zip(axes, _LABELS.items(), strict=True):
        ends = []
        for name, (style, curves) in trainings.items():
            known = [curve for curve in curves if curve]
            if known:
                last[name] = _draw(axis, style, known, entry)
                ends.append((name, last[name], style.colour))
        axis.set(xlabel="environment steps [million]", ylabel=label)
        axis.locator_params(axis="x", nbins=5)
        if entry == "max_mm":
            axis.set_yscale("log")
        label_lines(axis, ends)
    message = ""
    if last:
        least = min(last, key=last.__getitem__)
        message = f"After training {least} errs least: its largest error is {last[least]:.2g} mm"
    add_title(figure, message, subject)
    return figure


def _draw(axis: Axes, style: Style, curves: Sequence[Checks], entry: str) -> float:
    """Draw one kind; the last of its medians."""
    steps, values = _common(curves, entry)
    middle = np.median(values, axis=0)
    axis.plot(steps / 1e6, middle, **{**style.curve, "marker": "."})
    least, most = values.min(axis=0), values.max(axis=0)
    axis.fill_between(steps / 1e6, least, most, color=style.colour, alpha=0.2, lw=0)
    return float(middle[-1])


def _common(curves: Sequence[Checks], entry: str) -> tuple[ndarray, ndarray]:
    """Steps (k,) of the checks that all trainings have, and values (trainings, k)."""
    count = min(len(curve) for curve in curves)
    steps = np.array([point["steps"] for point in curves[0][:count]])
    return steps, np.array([[point[entry] for point in curve[:count]] for curve in curves])
