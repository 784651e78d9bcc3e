"""The study of sections as a picture: error of the tip against run time."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path

from softrobot_env.benchmarks.records import groups, select
from softrobot_env.benchmarks.sections.rows import GOAL, Row
from softrobot_env.rendering.figures import (
    BLACK,
    add_legend,
    add_title,
    entry,
    label_of,
    new_figure,
    save,
    style_of,
)

_MODELS = {"chain": "mujoco_chain", "pcc": "pcc", "cosserat": "cosserat"}
_COLUMNS = 3


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw error against run time of all robots, as PNG; full dots are default resolutions."""
    cases = groups(rows, "case")
    lines = ceil(len(cases) / _COLUMNS)
    figure, axes = new_figure(lines, _COLUMNS, (3.3 * _COLUMNS, 2.3 * lines + 1.1), share=True)
    own = [row for row in select(rows, default=True) if row.failure is None]
    good = sum(row.error_share <= GOAL for row in own)
    add_title(
        figure,
        f"With the models' own resolutions {good} of {len(own)} tips are within {100 * GOAL:g} % "
        "of the length",
        "Sections and routes: error of the tip against the time to find an equilibrium",
    )
    colours = {model: style_of(name).colour for model, name in _MODELS.items()}
    for axis, ((case,), mine) in zip(axes.flat, cases.items(), strict=False):
        for model, colour in colours.items():
            done = [row for row in select(mine, model=model) if row.failure is None]
            points = [(1e3 * r.equilibrium_time, 100 * r.error_share) for r in done]
            axis.plot(*zip(*points, strict=True), "o-", color=colour, markerfacecolor="white")
            own = [p for p, row in zip(points, done, strict=True) if row.default]
            axis.plot(*zip(*own, strict=True), "o", color=colour)
        axis.axhline(100 * GOAL, color=BLACK, linewidth=0.9, linestyle="--")
        axis.set(xscale="log", yscale="log", title=case)
        axis.tick_params(labelbottom=True)  # also above an empty place
    for axis in axes[:, 0]:
        axis.set_ylabel("tip error / length [%]")
    for axis in axes.flat[max(0, len(cases) - _COLUMNS) : len(cases)]:
        axis.set_xlabel("run time [ms]")
    for axis in axes.flat[len(cases) :]:
        axis.set_visible(False)
    add_legend(
        figure,
        [entry(label_of(_MODELS[m]), color=colour, marker="o") for m, colour in colours.items()]
        + [entry(f"goal: {100 * GOAL:g} % at the full dots", color=BLACK, linestyle="--")],
    )
    save(figure, path)
