"""The random scenes as a picture: error against what was asked, over what it hangs on, and cost."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.scenes.rows import GOOD_FACTOR, Row
from softrobot_env.benchmarks.verdicts import WRONG_SHARE, Verdict
from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    Axes,
    add_legend,
    add_title,
    entry,
    new_figure,
    save,
)

#: Verdict -> colour and marker, the worst last, on top.
_STYLES = {
    Verdict.UNJUDGED: (GREY, "x"),
    Verdict.ACCURATE: (GREEN, "o"),
    Verdict.REPORTED: (PURPLE, "s"),
    Verdict.WARNED: (BLUE, "v"),
    Verdict.INACCURATE: (ORANGE, "^"),
    Verdict.WRONG: (VERMILLION, "D"),
}

#: Errors [share of the length] at the lower end of the axes; smaller ones stand there.
_LEAST_ERROR, _MOST_ERROR = 1e-7, 10.0

#: Where scenes without gravity stand.
_WEIGHTLESS = 1e-6

#: Label of the weight of a robot over its stiffness.
_WEIGHT = r"weight over stiffness, $\rho A g L^3 / EI$"

Value = Callable[[Row], float | None]


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw where the timestep rule is what it says, as PNG."""
    figure, axes = new_figure(2, 2, (10, 8.6))
    counts = {verdict: len(select(rows, verdict=verdict)) for verdict in _STYLES}
    judged = len(rows) - counts[Verdict.UNJUDGED]
    add_title(
        figure,
        f"Of {judged} judged scenes {counts[Verdict.ACCURATE]} are as accurate as asked for, "
        f"{counts[Verdict.REPORTED] + counts[Verdict.WARNED]} say that they are not, "
        f"{counts[Verdict.INACCURATE] + counts[Verdict.WRONG]} err unannounced",
        f"{len(rows)} random scenes of seed {rows[0].seed}, tip errors against refined runs",
    )
    _against_estimate(axes[0, 0], rows)
    _map(axes[0, 1], rows)
    _against(axes[1, 0], rows, lambda r: max(r.weight_load, _WEIGHTLESS), _WEIGHT)
    _against(axes[1, 1], rows, _cost, "run time / simulated time")
    add_legend(
        figure,
        [
            entry(f"{verdict} ({counts[verdict]})", color=colour, marker=marker, linestyle="")
            for verdict, (colour, marker) in _STYLES.items()
        ],
    )
    save(figure, path)


def _cost(row: Row) -> float | None:
    return None if row.wall_time is None else row.wall_time / row.duration


def _error(row: Row) -> float | None:
    if row.error_share is None:
        return None
    return min(max(row.error_share, _LEAST_ERROR), _MOST_ERROR)


def _estimate(row: Row) -> float:
    if row.estimate_share is None:
        return row.asked_share
    return min(max(row.estimate_share, _LEAST_ERROR), _MOST_ERROR)


def _scatter(axis: Axes, rows: Sequence[Row], x: Value, y: Value) -> None:
    """Points by verdict on logarithmic axes; rows without a value are left out."""
    for verdict, (colour, marker) in _STYLES.items():
        points = [(x(row), y(row)) for row in select(rows, verdict=verdict)]
        known = np.array([p for p in points if None not in p], dtype=float).reshape(-1, 2)
        axis.scatter(*known.T, s=26, c=colour, marker=marker, linewidths=1.0, alpha=0.8)
    axis.set(xscale="log", yscale="log")


def _bounds(axis: Axes, rows: Sequence[Row]) -> None:
    """Lines of the accuracy asked for and of what is wrong."""
    axis.axhline(rows[0].asked_share, color=BLACK, linewidth=0.9, linestyle="--")
    axis.axhline(WRONG_SHARE, color=VERMILLION, linewidth=0.9, linestyle="--")
    axis.set_ylabel("tip error / length (dashed: asked for; wrong)")


def _against(axis: Axes, rows: Sequence[Row], x: Value, label: str) -> None:
    _scatter(axis, rows, x, _error)
    _bounds(axis, rows)
    axis.set_xlabel(label)


def _against_estimate(axis: Axes, rows: Sequence[Row]) -> None:
    """Error found over the package's estimate; over what was asked for where it gives none."""
    _scatter(axis, rows, _estimate, _error)
    _bounds(axis, rows)
    line = np.array([_LEAST_ERROR, _MOST_ERROR])
    axis.plot(line, line, color=GREY, linewidth=0.9)
    axis.fill_between(line, line / GOOD_FACTOR, line * GOOD_FACTOR, color="0.93", zorder=0)
    axis.set_xlabel("the package's estimate / length (asked for, where it gives none)")


def _map(axis: Axes, rows: Sequence[Row]) -> None:
    _scatter(axis, rows, lambda r: max(r.weight_load, _WEIGHTLESS), lambda r: r.damping_ratio)
    axis.set(xlabel=_WEIGHT, ylabel="damping ratio of the first elastic mode")
