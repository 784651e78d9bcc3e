"""What was found over what is true, with 95 % intervals."""

from collections.abc import Sequence
from pathlib import Path

from softrobot_env.benchmarks.identify.run import FoundRow, Row
from softrobot_env.benchmarks.records import groups, of_kind
from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    VERMILLION,
    add_legend,
    add_title,
    entry,
    new_figure,
    save,
)

_TITLES = {
    "modulus": ("Young's modulus, factor", 1.0),
    "damping": ("damping, factor", 1.0),
    "friction": ("friction [N]", 1.0),
    "delay": ("delay [ms]", 1e3),
}


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw a PNG: a panel for each kind; intervals that miss the truth in another colour."""
    kinds = groups(of_kind(rows, FoundRow), "kind")
    figure, axes = new_figure(1, len(kinds), (2.6 * len(kinds), 3.6))
    for axis, ((kind,), mine) in zip(axes[0], kinds.items(), strict=True):
        title, scale = _TITLES[kind]
        for row in mine:
            colour = BLUE if row.inside else VERMILLION
            ends = [scale * row.low, scale * row.high]
            axis.plot([scale * row.true] * 2, ends, color=colour, linewidth=0.8)
            axis.plot(scale * row.true, scale * row.found, ".", color=colour, markersize=4)
        ends = [scale * min(r.true for r in mine), scale * max(r.true for r in mine)]
        axis.plot(ends, ends, color=BLACK, linewidth=0.8)
        axis.set(xlabel="true", ylabel="found", title=title)
    found = of_kind(rows, FoundRow)
    inside = sum(row.inside for row in found)
    add_title(
        figure,
        f"{100 * inside / len(found):.3g} % of the 95 % intervals hold the truth",
        f"{len(found)} parameters of simulated Cosserat rods, identified from recordings",
    )
    told = {"the truth is inside": BLUE, "outside": VERMILLION}
    add_legend(figure, [entry(k, color=c, marker=".") for k, c in told.items()])
    save(figure, path)
