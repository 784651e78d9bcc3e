"""One style and one palette for all figures: what has a name looks the same in each of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy import ndarray

from softrobot_env.core.extras import needed
from softrobot_env.core.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.lines import Line2D
else:  # for annotations: matplotlib is loaded where something is drawn
    Axes = Figure = SubFigure = Line2D = object

#: Okabe and Ito's colours, readable with colour-blindness and in print; without their yellow,
#: which is not on white, and with others of Paul Tol's for more.
BLACK, GREY = "#000000", "#7F7F7F"
BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BROWN, WINE = "#E69F00", "#56B4E9", "#8C510A", "#882255"

#: For things that have no names of their own, such as numbers of layers: the k-th has colour k.
COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BROWN, WINE, GREY)

_DASHED, _DOTTED, _MIXED = (0, (4, 2)), ":", "-."

#: Line of what others are compared with, above the curves, which would hide it.
REFERENCE = {
    "color": BLACK,
    "linestyle": _DASHED,
    "linewidth": 0.9,
    "label": "reference",
    "zorder": 5,
}

#: Marker and line of numbers printed in the thesis.
THESIS = {"color": BLACK, "marker": "*", "markersize": 11, "linestyle": "none", "label": "thesis"}


@dataclass(frozen=True)
class Style:
    """How one thing is drawn in every figure.

    Attributes:
        colour: Matplotlib's.
        marker: Matplotlib's.
        line: Matplotlib's line style.
        label: Name for people; "" is the name itself.
    """

    colour: str
    marker: str = "o"
    line: str | tuple[int, tuple[float, ...]] = "-"
    label: str = ""

    @property
    def curve(self) -> dict[str, Any]:
        """Keywords of a line without markers."""
        return {"color": self.colour, "linestyle": self.line}

    @property
    def points(self) -> dict[str, str]:
        """Keywords of markers."""
        return {"color": self.colour, "marker": self.marker}


#: Name of a policy, model or hinge rule -> its style. Learned policies are dash-dotted, and dotted
#: after a training on varied robots.
STYLES = {
    "hold": Style(GREY, "_", _DOTTED),
    "static": Style("#004D40", "*"),
    "feedforward": Style(SKY),
    "feedforward_pi": Style("#6A3D9A", "s"),
    "chain_dynamics": Style("#44AA99", "H"),
    "chain_dynamics_pi": Style("#999933", "x"),
    "qs_nn": Style(VERMILLION, "D"),
    "lqi": Style(BLUE, "^"),
    "lq_preview": Style(ORANGE, "v"),
    "lq_adaptive": Style(PURPLE, "<"),
    "mpc": Style(GREEN, ">"),
    "mpc_preview": Style(WINE, "P"),
    "imitation": Style(BROWN, "X", _MIXED),
    "ppo": Style("#E41A1C", "8", _MIXED),
    "sac": Style("#1B3A6B", "h", _MIXED),
    "ppo_randomized": Style("#FB8072", "p", _DOTTED),
    "sac_randomized": Style("#8DA0CB", "d", _DOTTED),
    "rig_nn": Style("#CC6677", "D"),
    "rig_nn_p": Style("#17A2B8", "v"),
    "rig_nn_pi": Style("#4B0082", "p"),
    "inverse_dynamics": Style("#332288", "^"),
    "inverse_dynamics_ahead": Style("#88CCEE", "<"),
    "hybrid": Style("#117733"),
    "hybrid_ahead": Style("#C8A415", ">"),
    "hybrid_flexible": Style("#AA4499", "s"),
    "hybrid_calibrated": Style("#666600", "P"),
    "hybrid_feedback": Style("#D95F02", "X"),
    "ssm_mpc": Style("#E7298A", "h"),
    "ssm_lq": Style("#1F78B4", "8"),
    "mujoco_chain": Style(BLUE, "o", "-", "MuJoCo chain"),
    "pcc": Style(ORANGE, "s", _DASHED, "PCC"),
    "pcc/lumped": Style(ORANGE, "s", "-", "PCC, lumped mass"),
    "pcc/distributed": Style(VERMILLION, "D", "-", "PCC, distributed mass"),
    "pcc/subpieces": Style(WINE, "p", "-", "PCC, three bodies"),
    "cosserat": Style(GREEN, "^", _DOTTED, "Cosserat rod"),
    "ancf": Style(PURPLE, "v", _MIXED, "ANCF"),
    "mujoco_flex": Style(SKY, "X", "-", "MuJoCo's flex rod"),
    "mujoco_cable": Style(WINE, "h", "-", "MuJoCo 3's cable"),
    "pyelastica": Style(BLACK, "P", "-", "PyElastica"),
    "midpoint": Style(BLACK),
    "gauss2": Style(BLUE, "s"),
    "balanced2": Style(VERMILLION, "D"),
    "chord2": Style(GREEN, "^"),
    "gauss3": Style(PURPLE, "v"),
    "coupled2": Style(WINE, "p"),
}

_MOST_DOTS = 1800

#: Letters of a title in an inch.
_LETTERS = 11.0

#: Lines and markers of names that are not in `STYLES`.
_LINES, _MARKERS = ("-", _MIXED, _DOTTED), "osD^v<>PX*hp"


def style_of(name: str) -> Style:
    """The style of a name; one that `STYLES` does not know has its own, the same in every figure.

    A user's policy gets a colour from its name alone, hence also beside other policies.
    """
    if name in STYLES:
        return STYLES[name]
    from matplotlib.colors import hsv_to_rgb, to_hex

    code = crc32(name.encode())
    colour = to_hex(hsv_to_rgb((code % 360 / 360, 0.85, 0.5 + 0.1 * (code // 360 % 4))))
    return Style(colour, _MARKERS[code // 4320 % len(_MARKERS)], _LINES[code // 1440 % 3])


def label_of(name: str) -> str:
    """Name for people."""
    return style_of(name).label or name


def new_figure(
    rows: int, columns: int, size: tuple[float, float], share: bool = False
) -> tuple[Figure, ndarray]:
    """A figure of `size` [inch] with axes (rows, columns), with shared limits or own.

    Without rows or columns it is empty, to be divided into subfigures with `add_panels`.

    Raises:
        ImportError: matplotlib is not installed.
    """
    with needed("plots need matplotlib", "viz"):
        from matplotlib.figure import Figure  # not pyplot: no display, no global state

    figure = Figure(figsize=size, layout="constrained")
    return figure, add_panels(figure, rows, columns, share)


def add_panels(figure: Figure | SubFigure, rows: int, columns: int, share: bool = False) -> ndarray:
    """Axes (rows, columns) of a figure or a part of it, with a light grid and no box."""
    if not rows * columns:
        return np.empty((0, 0), object)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share)
    for axis in axes.flat:
        style_axes(axis)
    return axes


def style_axes(axis: Axes) -> None:
    """Light grid below the curves, our colours, ticks without an offset, no box."""
    axis.set_prop_cycle(color=COLOURS)
    for numbers in (axis.xaxis, axis.yaxis):
        numbers.get_major_formatter().set_useOffset(False)
    axis.grid(True, color="0.9", linewidth=0.8)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def plain_ticks(axis: Axes, steps: str = "") -> None:
    """Numbers without powers of ten, also on logarithmic axes, and none at minor ticks.

    Args:
        axis: The axes.
        steps: Out of "xy", those with ticks at 1, 2 and 5 times the powers of ten.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for name, numbers in (("x", axis.xaxis), ("y", axis.yaxis)):
        if name in steps:
            numbers.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        numbers.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        numbers.set_minor_formatter(NullFormatter())


def entry(label: str, **line: Any) -> Line2D:
    """An entry of a legend for something that is drawn in this way."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **line)


def add_legend(figure: Figure, source: Axes | Sequence[Line2D]) -> None:
    """One legend below all axes, where it covers nothing, in columns as wide as its labels.

    Args:
        figure: The figure.
        source: Axes whose labels are shown, or entries.
    """
    handles = source if isinstance(source, Sequence) else source.get_legend_handles_labels()[0]
    if not handles:
        return
    width = 0.55 + 0.075 * max(len(handle.get_label()) for handle in handles)  # inch
    most = max(1, int(figure.get_figwidth() / width))
    columns = ceil(len(handles) / ceil(len(handles) / most))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )


def add_title(figure: Figure, message: str, subject: str = "") -> None:
    """What a figure says, on the left above all panels, in as many lines as it needs.

    Args:
        figure: The figure.
        message: What is to be seen; numbers in it come from what is drawn.
        subject: What is shown, in lines of its own.
    """
    width = int(_LETTERS * figure.get_figwidth())
    lines = [fill(part, width) for part in (message, subject) if part]
    figure.suptitle("\n".join(lines), fontsize=11, x=0.01, ha="left")


def finish(
    figure: Figure, source: Axes | Sequence[Line2D], message: str, subject: str = ""
) -> Figure:
    """The figure with a title and a legend, see `add_title` and `add_legend`."""
    add_title(figure, message, subject)
    add_legend(figure, source)
    return figure


def label_plane(axis: Axes, plane: str) -> None:
    """Names of two coordinates [mm], such as "xz", with one scale."""
    axis.set(xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]")
    axis.set_aspect("equal", adjustable="datalim")


def label_lines(axis: Axes, entries: Sequence[tuple[str, float, str]], size: float = 8) -> None:
    """Names of lines to the right of an axis, at the heights where they end, without overlap.

    Args:
        axis: The axis, with its final scale and limits.
        entries: Name, height at the right end in the axis' unit, and colour of each.
        size: Of the letters [pt].
    """
    if not entries:
        return
    to_axis = axis.transData + axis.transAxes.inverted()
    x = axis.get_xlim()[1]
    places = sorted(
        (min(max(float(to_axis.transform((x, y))[1]), 0.0), 1.0), name, colour)
        for name, y, colour in entries
    )
    box = axis.bbox.height * 72 / axis.figure.dpi
    lines = np.array([1 + name.count("\n") for _, name, _ in places])
    gaps = 1.25 * size / box * (lines[:-1] + lines[1:]) / 2
    gaps *= min(1.0, 1.0 / max(gaps.sum(), 1e-9))
    heights = [places[0][0]]
    for (place, _, _), gap in zip(places[1:], gaps, strict=True):
        heights.append(max(place, heights[-1] + gap))
    if heights[-1] > 1.0:  # push down what stands out above
        heights[-1] = 1.0
        for index in reversed(range(len(gaps))):
            heights[index] = min(heights[index], heights[index + 1] - gaps[index])
    for height, (_, name, colour) in zip(heights, places, strict=True):
        text = {"color": colour, "fontsize": size, "va": "center", "xycoords": "axes fraction"}
        axis.annotate(name, (1.0, height), (5, 0), textcoords="offset points", **text)


def save(figure: Figure, path: Path | str) -> Path:
    """Write a PNG of 150 dots per inch, or fewer where it would be wider than a screen.

    Panels in which nothing is drawn are left out.

    Returns:
        Its path.
    """
    for axis in figure.axes:
        axis.set_visible(axis.has_data())
        for title in (axis.title, axis._left_title):
            title.set_fontsize(min(10, title.get_fontsize()))
    with atomic_write(path) as aside:
        figure.savefig(aside, dpi=min(150, _MOST_DOTS / figure.get_figwidth()))
    return Path(path)
