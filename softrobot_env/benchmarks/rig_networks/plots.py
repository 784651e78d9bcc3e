"""Errors of the rig's quasi-static networks over their size and the samples (Figs. 3.7 to 5.4)."""

from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.benchmarks.controllers.curves import new_figure
from softrobot_env.benchmarks.jobs import Row
from softrobot_env.benchmarks.rig_networks.tables import THESIS, select
from softrobot_env.identification.networks import TRAINING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: By the number of layers.
_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00")

_TITLES = {"forward": "tip position, s \u2192 z", "inverse": "tendon lengths, z \u2192 s"}

#: Samples [1] and error [m] that the thesis tells besides, secs. 3.2.3 and 5.1.1: 1 mm, and 1 % of
#: 30 mm.
_TOLD = {"forward": (80, 1e-3), "inverse": (55, 0.3e-3)}

_MARK = {"color": "black", "linestyle": "none", "markersize": 8, "zorder": 5}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw a PNG: a line of panels per direction, error over neurons and over samples."""
    from matplotlib.ticker import LogFormatter

    trained = [row for row in rows if row["study"] in ("size", "samples")]
    directions = list(dict.fromkeys(row["direction"] for row in trained))
    figure, axes = new_figure(len(directions), 2, (10.5, 0.6 + 3.7 * len(directions)))
    for (left, right), direction in zip(axes, directions, strict=True):
        mine = select(trained, direction=direction)
        _draw_sizes(left, select(mine, study="size"))
        _draw_samples(right, select(mine, study="samples"), direction)
        left.axhline(1e3 * THESIS[direction], color="black", lw=0.8, ls=(0, (4, 2)))
        left.set_ylabel(f"rms error [mm]\n{_TITLES[direction]}")
        for axis in (left, right):
            axis.set(xscale="log", yscale="log")
            axis.xaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_major_formatter("{x:g}")
            for numbers in (axis.xaxis, axis.yaxis):  # only where there are few others
                numbers.set_minor_formatter(LogFormatter())
            axis.legend(fontsize=8, frameon=False)
    axes[-1, 0].set_xlabel("neurons per layer")
    axes[-1, 1].set_xlabel("samples in the training set")
    figure.suptitle("Quasi-static networks of the rig on the test set; dashed: thesis", fontsize=11)
    figure.savefig(path, dpi=130)


def _draw_sizes(axis: "Axes", rows: list[Row]) -> None:
    """Medians, a curve per number of layers."""
    for layers in sorted({row["layers"] for row in rows}):
        mine = sorted(select(rows, layers=layers), key=lambda row: row["neurons"])
        axis.plot(
            [row["neurons"] for row in mine],
            [1e3 * row["e_rms"] for row in mine],
            "o-",
            color=_COLOURS[(layers - 1) % len(_COLOURS)],
            markersize=4,
            linewidth=1.2,
            label=f"{layers} layer{'s' if layers > 1 else ''}",
        )


def _draw_samples(axis: "Axes", rows: list[Row], direction: str) -> None:
    """Median and range of the trainings, with what the thesis tells."""
    rows = sorted(rows, key=lambda row: row["samples"])
    x = [row["samples"] for row in rows]
    least, middle, largest = (
        [1e3 * row[name] for row in rows] for name in ("e_rms_least", "e_rms", "e_rms_largest")
    )
    axis.fill_between(x, least, largest, color=_COLOURS[1], alpha=0.2, lw=0)
    axis.plot(x, middle, "o-", color=_COLOURS[1], markersize=4, lw=1.2, label="median and range")
    marks = ((TRAINING, THESIS[direction]), _TOLD[direction])
    axis.plot(*zip(*((n, 1e3 * e) for n, e in marks), strict=True), "x", **_MARK, label="thesis")
