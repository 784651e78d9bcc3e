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
    add_title,
    new_figure,
    save,
)

#: Colours of a finger's sensors; the others are those of sizes.
_SENSORS = COLOURS[:3]


def plot(rows: Sequence[Record], path: Path | str) -> None:
    """Draw both, as PNG."""
    things, sizes = changes(of_kind(rows, Grip)), of_kind(rows, Size)
    panels = len(things) + 1
    columns = -(-panels // 2)
    figure, axes = new_figure(2, columns, (3.2 * columns, 6.6))
    for axis, (thing, grips) in zip(axes.flat, things.items(), strict=False):
        _bends(axis, thing, grips)
    for axis in axes.flat[panels:]:
        axis.set_visible(False)
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    shown = _shown(sizes)
    _errors(axes.flat[len(things)], shown)
    usual = [size for size in shown if size.errors == 1.0]
    message = "Bends of the middle finger's sensors over the tension"
    if usual:
        message = (
            f"Sensors tell diameters of {usual[0].count} bars {1e3 * usual[0].mean:.2g} mm off in "
            f"the mean, {1e3 * usual[0].most:.2g} mm at most"
        )
    subject = "Bends of the middle finger's sensors while it closes, and errors of the size"
    add_title(figure, message, subject)
    both = [axes[0, 0], axes.flat[len(things)]]
    add_legend(figure, [handle for axis in both for handle in axis.get_legend_handles_labels()[0]])
    save(figure, path)


def _bends(axis: Axes, thing: str, grips: Sequence[Grip]) -> None:
    tension = [grip.tension for grip in grips]
    for k, colour in zip(range(len(grips[0].angles)), _SENSORS, strict=False):
        angles = [grip.angles[k] for grip in grips]
        axis.plot(tension, angles, color=colour, label=f"sensor {k + 1}")
    if grips[0].turn is not None:
        axis.axhline(grips[0].turn, **REFERENCE | {"label": "lies on the cylinder"})
    tips = [grip.tension for grip in grips if grip.kind == "fingertip"]
    if tips:
        axis.axvspan(min(tips), max(tension), color=GREY, alpha=0.15, label="fingertip grip")
    axis.set(xlabel="tension [N]", ylabel="bend [deg]", title=thing)


def _shown(sizes: Sequence[Size]) -> list[Size]:
    """Of clamped bars, with as many pieces as the polynomials were fitted with; the coarse ones."""
    mine = [size for size in sizes if size.pieces == size.fitted and size.task == "enclose"]
    return [size for size in mine if size.pieces == min(m.pieces for m in mine)]


def _errors(axis: Axes, sizes: Sequence[Size]) -> None:
    """Of some sizes, by the polynomials."""
    for size, colour in zip(sizes, COLOURS[len(_SENSORS) :], strict=False):
        label = "exact bends" if size.errors is None else f"usual errors x {size.errors:g}"
        diameters, errors = ([1e3 * x for x in xs] for xs in (size.diameters, size.off))
        axis.plot(diameters, errors, ".", color=colour, markersize=4, label=label)
    axis.set(xlabel="diameter [mm]", ylabel="error [mm]", title="size from one grip")
