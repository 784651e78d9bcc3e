"""The gripper study as pictures: bends of the sensors over tension, and errors of sizes."""

from collections.abc import Sequence
from pathlib import Path

from softrobot_env.benchmarks.gripper.rows import Grip, Size
from softrobot_env.benchmarks.gripper.tables import changes
from softrobot_env.benchmarks.records import Record, of_kind
from softrobot_env.rendering.figures import (
    COLOURS,
    GREY,
    REFERENCE,
    Axes,
    add_legend,
    new_figure,
    save,
)


def plot(rows: Sequence[Record], path: Path | str) -> None:
    """Draw both, as PNG."""
    things, sizes = changes(of_kind(rows, Grip)), of_kind(rows, Size)
    figure, axes = new_figure(1, len(things) + 1, (3.4 * (len(things) + 1), 3.8))
    for axis, (thing, grips) in zip(axes[0], things.items(), strict=False):
        _bends(axis, thing, grips)
    _errors(axes[0, -1], sizes)
    add_legend(figure, axes[0, 0])
    save(figure, path)


def _bends(axis: Axes, thing: str, grips: Sequence[Grip]) -> None:
    tension = [grip.tension for grip in grips]
    for k, colour in zip(range(len(grips[0].angles)), COLOURS, strict=False):
        angles = [grip.angles[k] for grip in grips]
        axis.plot(tension, angles, color=colour, label=f"sensor {k + 1}")
    if grips[0].turn is not None:
        axis.axhline(grips[0].turn, **REFERENCE | {"label": "lies on the cylinder"})
    tips = [grip.tension for grip in grips if grip.kind == "fingertip"]
    if tips:
        axis.axvspan(min(tips), max(tension), color=GREY, alpha=0.15, label="fingertip grip")
    axis.set(xlabel="tension [N]", ylabel="bend [deg]", title=thing)


def _errors(axis: Axes, sizes: Sequence[Size]) -> None:
    """Of clamped bars, by the polynomials, with as many pieces as they were fitted with."""
    mine = [size for size in sizes if size.pieces == size.fitted and size.task == "enclose"]
    for size, colour in zip(mine, COLOURS, strict=False):
        label = "exact bends" if size.errors is None else f"sensors, errors x {size.errors:g}"
        diameters, errors = ([1e3 * x for x in xs] for xs in (size.diameters, size.off))
        axis.plot(diameters, errors, ".", color=colour, markersize=4, label=label)
    axis.legend(fontsize=7)
    axis.set(xlabel="diameter [mm]", ylabel="error [mm]", title="size from one grip")
