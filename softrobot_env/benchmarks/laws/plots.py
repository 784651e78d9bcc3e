"""Errors of all laws against the speed of the reference, a panel per robot."""

from pathlib import Path

from softrobot_env.benchmarks.laps import LapsRow
from softrobot_env.benchmarks.laws.goals import LIMITS, ranked_laws
from softrobot_env.benchmarks.laws.run import Row
from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.rendering.figures import (
    BLACK,
    Axes,
    add_legend,
    entry,
    new_figure,
    plain_ticks,
    save,
    style_of,
)

_COLUMNS = 3


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the mean error over the length on the worst path against the frequency, as PNG."""
    every = of_kind(rows, LapsRow)
    laps = select(every, what="")
    robots = groups(laps, "robot")
    best = {robot: laws[0] for robot, laws in ranked_laws(every).items()}
    lines = -(-len(robots) // _COLUMNS)
    figure, axes = new_figure(lines, _COLUMNS, (13, 1.5 + 3.4 * lines))
    figure.suptitle("Every law on its worst path: mean error at full rate; the best law is thick")
    for axis, ((robot,), mine) in zip(axes.flat, robots.items(), strict=False):
        for (law,), found in groups(mine, "policy").items():
            _draw(axis, law, found, law == best.get(robot))
        axis.plot(LIMITS.keys(), [100 * v for v in LIMITS.values()], "_", color=BLACK, ms=22)
        axis.set(title=robot, yscale="log", ylim=(1e-3, 100))
        axis.set(xlabel="laps per second / first frequency", ylabel="error / length [%]")
        plain_ticks(axis)
        axis.set_xticks(list(LIMITS))
    for axis in axes.flat[len(robots) :]:
        axis.set_visible(False)
    laws = [law for (law,) in groups(laps, "policy")]
    entries = [entry(law, **style_of(law).curve, marker=style_of(law).marker) for law in laws]
    goal = entry("goal of the best law", color=BLACK, marker="_", linestyle="none", markersize=22)
    add_legend(figure, [*entries, goal])
    save(figure, path)


def _draw(axis: Axes, law: str, rows: list[LapsRow], best: bool) -> None:
    """The worst path at each frequency; a cross at the top where an episode failed."""
    style, points = style_of(law), []
    for (frequency,), found in sorted(groups(rows, "frequency").items()):
        if any(row.share_mean is None for row in found):
            axis.plot(
                frequency, 0.98, "x", color=style.colour, transform=axis.get_xaxis_transform()
            )
        else:
            points.append((frequency, 100 * max(row.share_mean for row in found)))
    if points:
        width = {"linewidth": 2.4 if best else 1.0, "markersize": 5}
        axis.plot(*zip(*points, strict=True), **(style.curve | style.points), **width)
