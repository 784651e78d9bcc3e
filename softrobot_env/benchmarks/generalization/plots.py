"""Error against speed on unseen references, and a map of errors on disturbed robots."""

from pathlib import Path
from statistics import median

import numpy as np

from softrobot_env.benchmarks.generalization.run import SPEEDS, TASKS, Row, variation_name
from softrobot_env.benchmarks.records import names, one, select
from softrobot_env.rendering.figures import (
    Axes,
    Figure,
    add_title,
    label_lines,
    new_figure,
    save,
    style_of,
)
from studies.pictures import heatmap

_TITLES = {
    "circle": "circle of 40 mm",
    "figure_eight": "figure eight, 200 x 60 mm",
    "random": "random paths, bars to the worst",
}
#: Policies in the figure, those that err least; the tables have all.
_MOST = 6

_ERRORS = {"e_max": "largest error [mm]", "e_rms": "rms error [mm]"}

#: Panels of the map: task -> metric, title, factor from SI, smallest and largest of the colours.
_PANELS = {
    "swing": ("e_max", "swing, largest error [mm]", 1e3, (0.3, 300.0)),
    "lshape": ("e_max", "L-shape, largest error [mm]", 1e3, (0.3, 300.0)),
    "step": ("overshoot", "step of 50 mm, overshoot [%]", 1e2, (1.0, 100.0)),
}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw both figures as PNG, those that there are rows for.

    Args:
        rows: Rows of `benchmarks.generalization.run`.
        path: File of the errors against speed; the map is `<stem>_disturbed.png` beside it.
    """
    path = Path(path)
    unseen, disturbed = select(rows, part="unseen"), select(rows, part="disturbed")
    if unseen:
        save(_speeds(unseen), path)
    if disturbed:
        save(_map(disturbed), path.with_name(f"{path.stem}_disturbed.png"))


# ---------------------------------------------------------------- error against speed


def _speeds(rows: list[Row]) -> Figure:
    figure, axes = new_figure(len(_ERRORS), len(SPEEDS), (10.5, 7.2))
    every, best = names(rows), _ranked(rows)[:_MOST]
    for row_of_axes, (metric, text) in zip(axes, _ERRORS.items(), strict=True):
        for axis, task in zip(row_of_axes, SPEEDS, strict=True):
            _scale(axis, SPEEDS[task], row_of_axes[0])
        for axis, task in zip(row_of_axes, SPEEDS, strict=True):
            for policy in best:
                _draw_policy(axis, select(rows, task=task, policy=policy), metric)
        label_lines(row_of_axes[-1], _ends(select(rows, task=[*SPEEDS][-1]), best, metric))
        row_of_axes[0].set_ylabel(text)
    for axis, task in zip(axes[0], SPEEDS, strict=True):
        axis.set_title(_TITLES[task], fontsize=10)
    for axis in axes[-1]:
        axis.set_xlabel("speed of the reference [m/s]")
    errors = [row.e_max for row in select(rows, policy=best[0]) if row.failure is None]
    message = "On paths that no policy has met all failed"
    if errors:
        message = f"On paths that no policy has met {best[0]} errs least, by "
        message += f"{1e3 * max(errors):.2g} mm at most"
    add_title(
        figure,
        message,
        f"The {len(best)} of {len(every)} policies that err least; crosses at the top: failed",
    )
    return figure


def _ranked(rows: list[Row]) -> list[str]:
    """Policies, first without failures, then by the median of their errors."""
    order = {}
    for policy in names(rows):
        mine = select(rows, policy=policy)
        errors = [row.e_max for row in mine if row.failure is None]
        order[policy] = len(mine) - len(errors), median(errors or [np.inf])
    return sorted(order, key=order.__getitem__)


def _ends(rows: list[Row], policies: list[str], metric: str) -> list[tuple[str, float, str]]:
    """Names, heights and colours of the lines at their right ends."""
    out = []
    for policy in policies:
        mine = select(rows, policy=policy)
        for speed in sorted({row.speed for row in mine}, reverse=True):
            values = _values(mine, speed, metric)
            if values:
                out.append((policy, median(values), style_of(policy).colour))
                break
    return out


def _draw_policy(axis: Axes, rows: list[Row], metric: str) -> None:
    """Median over the seeds at each speed, with a bar to the worst; a cross where any failed."""
    if not rows:
        return
    policy = rows[0].policy
    style = style_of(policy)
    speeds = sorted({row.speed for row in rows})
    values = [_values(rows, speed, metric) for speed in speeds]
    middle = np.array([median(v) if v else np.nan for v in values])
    worst = np.array([max(v, default=np.nan) for v in values])
    bars = [np.zeros(len(speeds)), worst - middle]
    line = {"markersize": 5, "capsize": 2, "linewidth": 1.2, "elinewidth": 0.7}
    axis.errorbar(speeds, middle, bars, label=policy, **(style.curve | style.points), **line)
    for speed in (s for s, v in zip(speeds, values, strict=True) if not v):
        axis.plot(speed, 0.99, "x", color=style.colour, transform=axis.get_xaxis_transform())


def _values(rows: list[Row], speed: float, metric: str) -> list[float]:
    """Errors [mm] at a speed; none if any run failed."""
    mine = select(rows, speed=speed)
    if any(row.failure is not None for row in mine):
        return []
    return [1e3 * getattr(row, metric) for row in mine]


def _scale(axis: Axes, speeds: tuple[float, ...], first: Axes) -> None:
    """Logarithmic axes with ticks at the speeds, and the errors' range of the first panel."""
    if axis is not first:
        axis.sharey(first)
    axis.set(xscale="log", yscale="log", xlim=(speeds[0] / 1.2, speeds[-1] * 1.2))
    axis.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
    axis.set_xticks([], minor=True)


# ---------------------------------------------------------------- map of disturbed robots


def _map(rows: list[Row]) -> Figure:
    tasks = [(task, width) for task, width in TASKS if select(rows, task=task)]
    size = (1.6 + 0.58 * len(_variations(rows)), 1.3 + 3.0 * len(tasks))
    figure, axes = new_figure(len(tasks), 1, size)
    for axis, (task, width) in zip(axes.flat, tasks, strict=True):
        _draw_panel(axis, select(rows, task=task, step_width=width), task)
    worst = {policy: _worst(rows, policy) for policy in names(rows)}
    least = min(worst, key=worst.__getitem__)
    add_title(
        figure,
        f"On disturbed robots {least} errs least in its worst case, {1e3 * worst[least]:.2g} mm on "
        "swing and L-shape",
        "Robots, drives and sensors that no policy knows: light errs little, dark much",
    )
    return figure


def _worst(rows: list[Row], policy: str) -> float:
    """Largest error [m] of a policy over swing and L-shape; infinite if it failed anywhere."""
    mine = [row for row in select(rows, policy=policy) if row.task != "step"]
    if not mine or any(row.failure is not None for row in mine):
        return np.inf
    return max(row.e_max for row in mine)


def _variations(rows: list[Row]) -> list[dict[str, float]]:
    """Those that occur, in the order of their first rows."""
    return list({variation_name(row.variation): row.variation for row in rows}.values())


def _draw_panel(axis: Axes, rows: list[Row], task: str) -> None:
    metric, title, factor, colours = _PANELS[task]
    policies, variations = names(rows), _variations(rows)
    found = [[one(rows, policy=p, variation=v) for v in variations] for p in policies]
    values = np.array([[_number(row, metric, factor) for row in line] for line in found])
    texts = [
        [_text(row, value) for row, value in zip(*pair, strict=True)]
        for pair in zip(found, values, strict=True)
    ]
    labels = [variation_name(v).replace(" ", "\n", 1) for v in variations]
    heatmap(axis, values, texts, policies, labels, colours)
    axis.set_title(title, fontsize=10, loc="left")


def _number(row: Row | None, metric: str, factor: float) -> float:
    value = None if row is None else getattr(row, metric)
    return np.nan if value is None else factor * value


def _text(row: Row | None, value: float) -> str:
    """The number in a cell, or what there is in its place."""
    if np.isnan(value):
        return "-" if row is None or row.failure is None else "failed"
    digits = sum(value < size for size in (1.0, 10.0))
    return f"{value:.{digits}f}"
