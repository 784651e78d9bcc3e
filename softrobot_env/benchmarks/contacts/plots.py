"""The contact study as a picture: error over run time of the grid and of the rods at rest."""

from collections.abc import Sequence
from pathlib import Path

from softrobot_env.benchmarks.contacts.rows import ACCURATE_SHARE, Cell, Check
from softrobot_env.benchmarks.records import Record, groups, of_kind, select
from softrobot_env.benchmarks.verdicts import WRONG_SHARE
from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    Axes,
    add_legend,
    add_title,
    entry,
    label_lines,
    new_figure,
    save,
)

_COLOURS = (BLUE, GREEN, ORANGE, PURPLE, BLACK, SKY)
_MARKERS = {1: "o", 2: "s", 4: "^", 8: "v", 16: "D"}


def plot(rows: Sequence[Record], path: Path | str) -> None:
    """Draw what timesteps cost and how far they are off, as PNG."""
    figure, axes = new_figure(1, 2, (10, 5.6))
    cells, checks = of_kind(rows, Cell), of_kind(rows, Check)
    scenes = _grid(axes[0, 0], cells)
    _rods(axes[0, 1], checks)
    steps = [
        entry(f"{n} x the rule's timestep", color=BLACK, marker=_MARKERS[n], linestyle="")
        for (n,) in groups(cells, "steps_ratio")
    ]
    add_legend(figure, [*scenes, *steps])
    judged = [c for c in select(cells, steps_ratio=1) if c.error_share is not None]
    good = sum(c.error_share <= ACCURATE_SHARE for c in judged)
    add_title(
        figure,
        f"With the rule's timestep {good} of {len(judged)} moving contacts err by less than "
        f"{100 * ACCURATE_SHARE:g} % of the length",
        "Left: against refined runs. Right: rods at rest with 6 to 48 pieces, against exact "
        "solutions",
    )
    save(figure, path)


def _grid(axis: Axes, cells: Sequence[Cell]) -> list:
    """Every cell that ended; colours tell the scene, markers the timestep."""
    entries = []
    for ((scene,), mine), colour in zip(groups(cells, "scene").items(), _COLOURS, strict=False):
        for multiple, marker in _MARKERS.items():
            known = [c for c in select(mine, steps_ratio=multiple) if c.error_share is not None]
            cost = [c.wall_time / c.duration for c in known]
            share = [c.error_share for c in known]
            axis.scatter(cost, share, s=20, c=colour, marker=marker, alpha=0.7)
        entries.append(entry(scene, color=colour, marker="o", linestyle=""))
    for share, colour, text in (
        (ACCURATE_SHARE, BLACK, "accurate below"),
        (WRONG_SHARE, VERMILLION, "wrong above"),
    ):
        axis.axhline(share, color=colour, linewidth=0.9, linestyle="--")
        place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
        style = {"fontsize": 8, "color": colour, "va": "center"}
        axis.annotate(text, (1.0, share), (4, 0), **place, **style)
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="run time / simulated time",
        ylabel="error / length",
        title="Moving scenes",
    )
    return entries


def _rods(axis: Axes, checks: Sequence[Check]) -> None:
    """Errors of forces and tips over the time to come to rest, a line each."""
    ends = []
    for ((case,), mine), colour in zip(groups(checks, "case").items(), _COLOURS, strict=False):
        for field, style in (("force_error", "-"), ("tip_error", ":")):
            known = [c for c in mine if getattr(c, field) is not None]
            if known:
                times = [1e3 * c.wall_time for c in known]
                errors = [getattr(c, field) for c in known]
                axis.plot(times, errors, color=colour, linestyle=style, marker="o", markersize=4)
                what = "force" if field == "force_error" else "tip"
                ends.append((f"{case},\n{what}", errors[-1], colour))
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="time to come to rest [ms]",
        ylabel="relative error of force; of tip over length",
        title="Rods at rest",
    )
    label_lines(axis, ends)
