"""Errors of the rig's quasi-static networks over their size and the samples (Figs. 3.7 to 5.4)."""

from pathlib import Path

from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.benchmarks.rig_networks.cases import CellRow
from softrobot_env.benchmarks.rig_networks.run import Row
from softrobot_env.benchmarks.rig_networks.tables import THESIS
from softrobot_env.identification.networks import TRAINING
from softrobot_env.rendering.figures import (
    BLUE,
    COLOURS,
    REFERENCE,
    Axes,
    add_legend,
    add_title,
    new_figure,
    plain_ticks,
    save,
)

_TITLES = {"forward": "tip from tendon lengths", "inverse": "tendon lengths from the tip"}
_WHAT = {"forward": "in the tip", "inverse": "in tendon lengths"}

#: Samples [1] and error [m] that the thesis tells besides, secs. 3.2.3 and 5.1.1: 1 mm, and 1 % of
#: 30 mm.
_TOLD = {"forward": (80, 1e-3), "inverse": (55, 0.3e-3)}

_MARK = {"color": "black", "linestyle": "none", "markersize": 8, "zorder": 5}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw a PNG: a line of panels per direction, error over neurons and over samples."""
    cells = [row for row in of_kind(rows, CellRow) if row.study in ("size", "samples")]
    directions = groups(cells, "direction")
    figure, axes = new_figure(len(directions), 2, (9.5, 1.0 + 3.3 * len(directions)))
    for (left, right), ((direction,), mine) in zip(axes, directions.items(), strict=True):
        _draw_sizes(left, select(mine, study="size"))
        _draw_samples(right, select(mine, study="samples"), direction)
        left.axhline(1e3 * THESIS[direction], **REFERENCE | {"label": "thesis"})
        left.set_ylabel(f"rms error [mm]\n{_TITLES[direction]}")
        for axis in (left, right):
            axis.set(xscale="log", yscale="log")
            plain_ticks(axis, "xy")
    axes[-1, 0].set_xlabel("neurons per layer")
    axes[-1, 1].set_xlabel("samples in the training set")
    used = select(cells, study="samples", samples=TRAINING)
    told = [f"{1e3 * row.e_rms:.2g} mm {_WHAT[row.direction]}" for row in used]
    message = f"With {TRAINING} samples networks err by {' and '.join(told)}"
    subject = "Quasi-static networks of the rig on the test set"
    add_title(figure, message if told else "Errors over size and samples", subject)
    shown = [h for axis in axes[0] for h in axis.get_legend_handles_labels()[0]]
    add_legend(figure, [handle for handle in shown if not handle.get_label().startswith("_")])
    save(figure, path)


def _draw_sizes(axis: Axes, cells: list[CellRow]) -> None:
    """Medians, a curve per number of layers."""
    line = {"markersize": 4, "linewidth": 1.2}
    for (layers,), mine in sorted(groups(cells, "layers").items()):
        mine = sorted(mine, key=lambda row: row.neurons)
        x, y = [row.neurons for row in mine], [1e3 * row.e_rms for row in mine]
        label, colour = f"{layers} layer{'s' * (layers > 1)}", COLOURS[layers % len(COLOURS)]
        axis.plot(x, y, "o-", color=colour, label=label, **line)


def _draw_samples(axis: Axes, cells: list[CellRow], direction: str) -> None:
    """Median and range of the trainings, with what the thesis tells."""
    cells = sorted(cells, key=lambda row: row.samples)
    x = [row.samples for row in cells]
    least, middle, largest = (
        [1e3 * getattr(row, name) for row in cells]
        for name in ("e_rms_least", "e_rms", "e_rms_largest")
    )
    axis.fill_between(x, least, largest, color=BLUE, alpha=0.2, lw=0)
    axis.plot(x, middle, "o-", color=BLUE, markersize=4, lw=1.2, label="median and range")
    marks = ((TRAINING, THESIS[direction]), _TOLD[direction])
    axis.plot(
        *zip(*((n, 1e3 * e) for n, e in marks), strict=True),
        "x",
        **_MARK,
        label="thesis, by samples",
    )
