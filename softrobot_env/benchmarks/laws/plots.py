"""Errors of the best laws of each robot against the speed of the reference, a panel per robot."""

from pathlib import Path

from softrobot_env.benchmarks.laps import HOLD, LapsRow
from softrobot_env.benchmarks.laws.goals import LIMITS, ranked_laws
from softrobot_env.benchmarks.laws.run import Row
from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.rendering.figures import (
    BLACK,
    Axes,
    add_legend,
    add_title,
    entry,
    label_lines,
    new_figure,
    plain_ticks,
    save,
    style_of,
)

#: Laws in a panel, those at the top of the ranking; the tables have all.
_MOST = 5

_COLUMNS = 2
_ENDS = 1e-3, 100.0  # [%], of the axis of errors


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the mean error over the length on the worst path against the frequency, as PNG."""
    every = of_kind(rows, LapsRow)
    laps = groups(select(every, what=""), "robot")
    ranks = ranked_laws(every)
    lines = -(-len(laps) // _COLUMNS)
    figure, axes = new_figure(lines, _COLUMNS, (9.5, 1.3 + 2.7 * lines))
    reached = 0
    for axis, ((robot,), mine) in zip(axes.flat, laps.items(), strict=False):
        laws = ranks.get(robot, [])[:_MOST]
        worst = {law: _worst(select(mine, policy=law)) for law in [*laws, HOLD]}
        reached += bool(laws) and _is_within(worst[laws[0]])
        _panel(axis, robot, worst)
    for axis in axes.flat[len(laps) :]:
        axis.set_visible(False)
    goal = {"color": BLACK, "marker": "_", "linestyle": "none", "markersize": 22}
    add_legend(figure, [entry("goal of the best law", **goal)])
    add_title(
        figure,
        f"The best law stays within the goal at every speed on {reached} of {len(laps)} robots",
        f"Mean error on the worst path, at full rate; the {_MOST} best laws of each robot and the "
        "resting robot, the best one thick; crosses: failed",
    )
    save(figure, path)


def _worst(rows: list[LapsRow]) -> dict[float, float | None]:
    """Largest error over the length [%] by frequency; None where an episode failed."""
    out = {}
    for (frequency,), found in sorted(groups(rows, "frequency").items()):
        shares = [row.share_mean for row in found]
        out[frequency] = None if None in shares else 100 * max(shares)
    return out


def _is_within(worst: dict[float, float | None]) -> bool:
    return all(w is not None and w <= 100 * LIMITS[f] for f, w in worst.items())


def _panel(axis: Axes, robot: str, worst: dict[str, dict[float, float | None]]) -> None:
    axis.set(title=robot, yscale="log", ylim=_ENDS, xlim=(min(LIMITS) - 0.03, max(LIMITS) + 0.03))
    names = []
    for order, (law, values) in enumerate(worst.items()):
        style = style_of(law)
        known = [(f, v) for f, v in values.items() if v is not None]
        for frequency in (f for f, v in values.items() if v is None):
            place = axis.get_xaxis_transform()
            axis.plot(frequency, 0.98, "x", color=style.colour, transform=place)
        if known:
            width = {"linewidth": 1.2 if order else 2.6, "markersize": 4}
            axis.plot(*zip(*known, strict=True), **(style.curve | style.points), **width)
            names.append((law, known[-1][1], style.colour))
    axis.plot(LIMITS.keys(), [100 * v for v in LIMITS.values()], "_", color=BLACK, ms=22)
    axis.set(xlabel="laps per second / first frequency", ylabel="error / length [%]")
    plain_ticks(axis)
    axis.set_xticks(list(LIMITS))
    label_lines(axis, names)
