"""The style that plots of episodes have in common."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

from softrobot_env.evaluation.rollout import Rollout

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Okabe and Ito's palette, readable with colour-blindness and in print, without the black of the
#: reference and with three more.
_COLOURS = (
    "#7F7F7F",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#6A3D9A",
    "#8C510A",
)

#: For more episodes than colours, without the dashes of the reference.
_LINES = ("-", "-.", ":")

#: Lower end [mm] of the error axis.
SMALLEST_ERROR = 1e-2


def new_figure(
    rows: int, columns: int, size: tuple[float, float], share: bool = False
) -> tuple["Figure", Sequence["Axes"]]:
    """An empty figure of `size` in inches, and its axes row by row, with shared limits or own.

    Raises:
        ImportError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure  # not pyplot: no display, no global state
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install softrobot_env[viz]") from error

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).ravel()
    for axis in axes:
        axis.grid(True, color="0.9", linewidth=0.8)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def styles(rollouts: dict[str, Rollout]) -> list[tuple[str, Rollout, dict[str, str]]]:
    """(label, episode, keywords of its lines); a failure is told in the label."""
    lines = [{"color": c, "linestyle": line} for line in _LINES for c in _COLOURS]
    return [
        (f"{label} (failed at {r.time[-1]:.2f} s)" if r.failure else label, r, line)
        for (label, r), line in zip(rollouts.items(), cycle(lines), strict=False)
    ]


def add_legend(figure: "Figure", axis: "Axes") -> None:
    """One legend for all axes, below them."""
    handles, labels = axis.get_legend_handles_labels()
    columns = min(4, len(labels))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize="small")


def save(figures: dict[str, "Figure"], out: Path, stem: str) -> list[Path]:
    """Write figures by name as `<stem>_<name>.png` and return the paths."""
    paths = []
    for name, figure in figures.items():
        paths.append(out / f"{stem}_{name}.png")
        figure.savefig(paths[-1], dpi=150)
    return paths
