"""Pictures of a recording: beside its replay, and of what was identified from it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy import ndarray

from .figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    VERMILLION,
    Figure,
    Line2D,
    entry,
    finish,
    label_plane,
    new_figure,
    save,
)

#: Views by the two axes that are seen, and these.
_VIEWS = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}
_MOST_BARS = 100  # patterns

#: Colours of errors.
_ERRORS = {"as it is": BLUE, "mean offset removed": VERMILLION}


class Compared(Protocol):
    """Recorded and simulated markers.

    Attributes:
        recorded, simulated: (t, k, 3) [m]; NaN where not known.
        times: (t,) [s].
        static: Whether rows are postures at rest.
        distance, centred: (t, k) [m], as they are and with the mean offset removed.
        title: For people.
    """

    recorded: ndarray
    simulated: ndarray
    times: ndarray
    static: bool
    distance: ndarray
    centred: ndarray
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
    message = f"{compared.title}: distance of simulated and recorded markers"
    return finish(figure, _of_errors(), message)


def _of_errors() -> list[Line2D]:
    return [entry(name, color=colour) for name, colour in _ERRORS.items()]


def measured_views(points: ndarray) -> list[str]:
    """Views of axes along which points (..., 3) were measured, NaN where not; one at least."""
    measured = ~np.isnan(points).all(axis=tuple(range(points.ndim - 1)))
    return [view for view, axes in _VIEWS.items() if measured[axes].all()] or ["xz"]


def _markers(compared: Compared) -> Figure:
    """Markers from the sides that were measured; the way of each where the robot moves."""
    views = measured_views(compared.recorded)
    figure, axes = new_figure(1, len(views), (1.0 + 3.4 * len(views), 4.2))
    dots = {"linestyle": "none", "marker": ".", "markersize": 2.5}
    line = dots if compared.static else {"linewidth": 0.9}
    for axis, view in zip(axes[0], views, strict=True):
        i, j = _VIEWS[view]
        for points, colour in ((compared.recorded, BLACK), (compared.simulated, VERMILLION)):
            axis.plot(1e3 * points[:, :, i], 1e3 * points[:, :, j], color=colour, **line)
        label_plane(axis, view)
    named = (("recorded", BLACK), ("simulated", VERMILLION))
    entries = [entry(name, color=colour, marker=".") for name, colour in named]
    return finish(figure, entries, f"{compared.title}: markers")


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
    return finish(figure, _of_errors(), f"{title}: error by pattern")


class Known(Protocol):
    """A parameter: its name, change, standard deviation, and that of the prior, in one unit."""

    parameter: str
    value: float
    deviation: float
    prior: float


def plot_identification(
    points: ndarray,
    errors: Mapping[str, ndarray],
    parameters: Sequence[Known],
    title: str,
    out: Path,
) -> list[Path]:
    """Write `identify_errors.png`, `identify_workspace.png` and `identify_parameters.png`.

    Args:
        points: (t, 3) [m], the last marker as it was recorded.
        errors: Name -> (t, 3) [m] of that marker, simulated less recorded, the fitted one first;
            NaN where it was not measured.
        parameters: That were found.
        title: For people.
        out: Folder to write to.
    """
    figures = {
        "errors": _rows_errors(errors, title),
        "workspace": _arrows(points, next(iter(errors.values())), title),
        "parameters": _parameters(parameters, title),
    }
    return [save(figure, out / f"identify_{name}.png") for name, figure in figures.items()]


def _rows_errors(errors: Mapping[str, ndarray], title: str) -> Figure:
    """Distances over the rows."""
    figure, axes = new_figure(len(errors), 1, (9.0, 1.0 + 1.7 * len(errors)), share=True)
    for (name, error), axis in zip(errors.items(), axes[:, 0], strict=True):
        seen = ~np.isnan(error).all(axis=1)
        distance = 1e3 * np.where(seen, np.sqrt(np.nansum(error**2, axis=1)), np.nan)
        axis.plot(np.arange(1, len(error) + 1), distance, color=BLUE, linewidth=0.7)
        mean = np.sqrt(np.nanmean(distance**2))
        axis.axhline(mean, color=VERMILLION, linewidth=0.9)
        axis.set_ylabel("error [mm]")
        axis.set_title(f"{name}: RMS {mean:.2f} mm", fontsize=9, loc="left")
    axes[0, 0].set_ylim(bottom=0)  # of all, once the largest error is known
    axes[-1, 0].set_xlabel("row")
    return finish(figure, (), f"{title}: simulated less recorded marker")


def _arrows(points: ndarray, error: ndarray, title: str) -> Figure:
    """Errors as arrows, ten times as long, where the marker was, of planes that were measured."""
    views = measured_views(points)
    figure, axes = new_figure(1, len(views), (1.0 + 4.5 * len(views), 4.8))
    for axis, view in zip(axes[0], views, strict=True):
        seen = _VIEWS[view]
        axis.scatter(*(1e3 * points[:, seen].T), s=2, color=GREY, linewidths=0)
        axis.quiver(
            *(1e3 * points[:, seen].T),
            *(1e4 * error[:, seen].T),
            angles="xy",
            scale_units="xy",
            scale=1,
            width=1.5e-3,
            color=VERMILLION,
        )
        label_plane(axis, view)
    return finish(figure, (), f"{title}: errors over the workspace, ten times enlarged")


def _parameters(parameters: Sequence[Known], title: str) -> Figure:
    """Changes with 95 % bars, over the prior's standard deviations."""
    figure, ((axis,),) = new_figure(1, 1, (7.5, 1.2 + 0.17 * len(parameters)))
    places = np.arange(len(parameters))[::-1]
    value = np.array([p.value / p.prior for p in parameters])
    half = np.array([1.96 * p.deviation / p.prior for p in parameters])
    axis.axvspan(-1.96, 1.96, color="0.93")
    axis.axvline(0, color=BLACK, linewidth=0.6)
    axis.errorbar(value, places, xerr=half, fmt="o", markersize=3, color=GREEN, linewidth=1.2)
    axis.set_yticks(places, [p.parameter for p in parameters], fontsize=6)
    axis.set_ylim(-0.7, len(parameters) - 0.3)
    axis.set_xlabel("change of the file's, over the spread believed before")
    believed = entry("believed, 95 %", color="0.8", linewidth=6)
    entries = [entry("found", color=GREEN, marker="o"), believed]
    return finish(figure, entries, f"{title}: parameters with 95 % intervals")
