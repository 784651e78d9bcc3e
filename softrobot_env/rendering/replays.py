"""Pictures of a replayed recording: what was recorded beside what was simulated."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    VERMILLION,
    Figure,
    add_legend,
    add_title,
    entry,
    new_figure,
    save,
)

_VIEWS = ((0, 1), (0, 2), (1, 2))
_AXES = "xyz"
_MOST_BARS = 100  # patterns


class Compared(Protocol):
    """Recorded and simulated markers.

    Attributes:
        recorded, simulated: (t, k, 3) [m]; NaN where not known.
        times: (t,) [s].
        static: Whether rows are postures at rest.
        distance, centred: (t, k) [m], as they are and with the mean offset removed.
        title: For people.
    """

    recorded: np.ndarray
    simulated: np.ndarray
    times: np.ndarray
    static: bool
    distance: np.ndarray
    centred: np.ndarray
    title: str


class Errors(Protocol):
    """Errors of a pattern: its name, and RMS [m] as it is and with the mean offset removed."""

    pattern: str
    rms: float | None
    rms_centred: float | None


def plot_replay(compared: Compared, rows: Sequence[Errors], out: Path) -> list[Path]:
    """Write `replay_error.png`, `replay_markers.png`, and with patterns `replay_patterns.png`.

    Args:
        compared: The replay.
        rows: Errors over all, then of each pattern.
        out: Folder to write to.

    Raises:
        ImportError: matplotlib is not installed.
    """
    figures = {"error": _errors(compared), "markers": _markers(compared)}
    if len(rows) > 1:
        figures["patterns"] = _patterns(compared.title, rows[1:])
    return [save(figure, out / f"replay_{name}.png") for name, figure in figures.items()]


def _errors(compared: Compared) -> Figure:
    """Errors over the rows, or over time where the robot moves."""
    figure, ((axis,),) = new_figure(1, 1, (8.0, 3.6))
    rows = np.arange(1, len(compared.times) + 1)
    across = rows if compared.static else compared.times
    for values, colour in ((compared.distance, BLUE), (compared.centred, VERMILLION)):
        axis.plot(across, 1e3 * values, color=colour, linewidth=0.8)
    axis.set(xlabel="row" if compared.static else "time [s]", ylabel="error [mm]")
    axis.set_ylim(bottom=0)
    add_title(figure, f"{compared.title}: distance of simulated and recorded markers")
    add_legend(
        figure, [entry("as it is", color=BLUE), entry("mean offset removed", color=VERMILLION)]
    )
    return figure


def measured_views(points: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of axes along which points (..., 3) were measured, NaN where not; one at least."""
    measured = ~np.isnan(points).all(axis=tuple(range(points.ndim - 1)))
    return [view for view in _VIEWS if measured[list(view)].all()] or [_VIEWS[1]]


def _markers(compared: Compared) -> Figure:
    """Markers from the sides that were measured; the way of each where the robot moves."""
    views = measured_views(compared.recorded)
    figure, axes = new_figure(1, len(views), (1.0 + 3.4 * len(views), 4.2))
    line = (
        {"linestyle": "none", "marker": ".", "markersize": 2.5}
        if compared.static
        else {"linewidth": 0.9}
    )
    for axis, (i, j) in zip(axes[0], views, strict=True):
        for points, colour in ((compared.recorded, BLACK), (compared.simulated, VERMILLION)):
            axis.plot(1e3 * points[:, :, i], 1e3 * points[:, :, j], color=colour, **line)
        axis.set(xlabel=f"{_AXES[i]} [mm]", ylabel=f"{_AXES[j]} [mm]")
        axis.set_aspect("equal", adjustable="datalim")
    add_title(figure, f"{compared.title}: markers")
    named = (("recorded", BLACK), ("simulated", VERMILLION))
    add_legend(figure, [entry(name, color=colour, marker=".") for name, colour in named])
    return figure


def _patterns(title: str, rows: Sequence[Errors]) -> Figure:
    """RMS of each pattern, the worst on top."""
    worst = sorted((row for row in rows if row.rms is not None), key=lambda row: row.rms)
    worst = worst[-_MOST_BARS:]
    figure, ((axis,),) = new_figure(1, 1, (8.0, 1.4 + 0.16 * len(worst)))
    places = np.arange(len(worst))
    for shift, name, colour in ((0.2, "rms", BLUE), (-0.2, "rms_centred", VERMILLION)):
        values = [1e3 * getattr(row, name) for row in worst]
        axis.barh(places + shift, values, height=0.4, color=colour)
    axis.set_yticks(places, [row.pattern for row in worst], fontsize=6)
    axis.set_ylim(-0.7, len(worst) - 0.3)
    axis.set_xlabel("RMS error [mm]")
    add_title(figure, f"{title}: error by pattern")
    add_legend(
        figure, [entry("as it is", color=BLUE), entry("mean offset removed", color=VERMILLION)]
    )
    return figure
