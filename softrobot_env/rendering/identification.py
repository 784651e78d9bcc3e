"""Pictures of an identification: errors over rows and workspace, and spreads of parameters."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    VERMILLION,
    Figure,
    add_legend,
    add_title,
    entry,
    new_figure,
    save,
)
from softrobot_env.rendering.replays import measured_views


class Known(Protocol):
    """A parameter: its name, change, standard deviation, and that of the prior, in one unit."""

    parameter: str
    value: float
    deviation: float
    prior: float


def plot_identification(
    points: np.ndarray,
    errors: Mapping[str, np.ndarray],
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
        "errors": _errors(errors, title),
        "workspace": _workspace(points, next(iter(errors.values())), title),
        "parameters": _parameters(parameters, title),
    }
    return [save(figure, out / f"identify_{name}.png") for name, figure in figures.items()]


def _errors(errors: Mapping[str, np.ndarray], title: str) -> Figure:
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
    add_title(figure, f"{title}: simulated less recorded marker")
    return figure


def _workspace(points: np.ndarray, error: np.ndarray, title: str) -> Figure:
    """Errors as arrows, ten times as long, where the marker was, of planes that were measured."""
    views = measured_views(points)
    figure, axes = new_figure(1, len(views), (1.0 + 4.5 * len(views), 4.8))
    for axis, (i, j) in zip(axes[0], views, strict=True):
        axis.scatter(1e3 * points[:, i], 1e3 * points[:, j], s=2, color=GREY, linewidths=0)
        axis.quiver(
            *(1e3 * points[:, [i, j]].T),
            *(1e4 * error[:, [i, j]].T),
            angles="xy",
            scale_units="xy",
            scale=1,
            width=1.5e-3,
            color=VERMILLION,
        )
        axis.set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]")
        axis.set_aspect("equal", adjustable="datalim")
    add_title(figure, f"{title}: errors over the workspace, ten times enlarged")
    return figure


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
    add_title(figure, f"{title}: parameters with 95 % intervals")
    add_legend(
        figure,
        [
            entry("found", color=GREEN, marker="o"),
            entry("believed, 95 %", color="0.8", linewidth=6),
        ],
    )
    return figure
