"""A map of errors per robot: the policies that stand other worlds best."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.laps import RefusedRow
from softrobot_env.benchmarks.records import groups, of_kind, one
from softrobot_env.benchmarks.transfer.run import Row, TransferRow
from softrobot_env.rendering.figures import add_title, new_figure, save, style_axes
from softrobot_env.rendering.tables import number
from studies.pictures import heatmap

#: Policies of a robot; the tables have all.
_MOST = 6

#: In cells where the plant lacks what the robot has; the tables say what.
_REFUSED = "refused"

#: [%] of the length, ends of the colours.
_COLOURS = (0.1, 100.0)


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the mean errors in % of the length as PNG."""
    found = of_kind(rows, TransferRow)
    refused = {(row.robot, row.policy, row.what) for row in of_kind(rows, RefusedRow)}
    robots = {robot: _ranked(mine) for (robot,), mine in groups(found, "robot").items()}
    heights = [0.9 + len(labels[:_MOST]) for labels in robots.values()]
    figure, _ = new_figure(0, 0, (9.5, 1.2 + 0.31 * sum(heights)))
    axes = figure.subplots(len(robots), 1, squeeze=False, height_ratios=heights)
    worlds = [world for (world,) in groups(found, "world")]
    for axis, (robot, ranked) in zip(axes.flat, robots.items(), strict=True):
        mine, labels = [row for row in found if row.robot == robot], ranked[:_MOST]
        cells = [[one(mine, label=p, world=w) for w in worlds] for p in labels]
        own = {row.label: row.policy for row in mine}
        texts = [
            [
                _text(row, bool({(robot, own[p], w), (robot, p, w)} & refused))
                for row, w in zip(line, worlds, strict=True)
            ]
            for p, line in zip(labels, cells, strict=True)
        ]
        values = np.array([[_percent(row) for row in line] for line in cells])
        style_axes(axis)
        heatmap(axis, values, texts, labels, worlds, _COLOURS)
        some = f"{len(labels)} of {len(ranked)} policies"
        axis.set_title(f"{robot}, {some}", loc="left", fontsize=10)
    add_title(figure, _message(found, robots), _SUBJECT)
    save(figure, path)


_SUBJECT = (
    "Mean error in % of the length on plants and robots that a policy was not tuned on, of those "
    "that err least in their worst; empty: no such world"
)


def _message(rows: list[TransferRow], robots: dict[str, list[str]]) -> str:
    """What the best policies of robots err in their worst world: from which robot to which."""
    found = []
    for robot, (label, *_) in robots.items():
        mine = [_percent(row) for row in rows if (row.robot, row.label) == (robot, label)]
        found.append((max(mine), f"{_short(max(mine))} % ({robot}, {label})"))
    found = [pair for pair in found if np.isfinite(pair[0])]
    if not found:
        return "No policy stands all worlds of a robot"
    ends = dict.fromkeys((min(found)[1], max(found)[1]))
    return f"In their worst world robots' best policies err by {' to '.join(ends)}"


def _ranked(rows: list[TransferRow]) -> list[str]:
    """Policies of a robot: those that were run everywhere and never failed, by their largest error,
    then the others."""
    policies = groups(rows, "label")
    most = max(map(len, policies.values()))

    def order(label: tuple) -> tuple[int, float]:
        shares = [row.share_mean for row in policies[label]]
        known = [share for share in shares if share is not None]
        return most - len(known), max(known, default=np.inf)

    return [label for (label,) in sorted(policies, key=order)]


def _text(row: TransferRow | None, refused: bool) -> str:
    """What stands in a cell: nothing where a robot has no such world."""
    if row is None:
        return _REFUSED if refused else ""
    return "failed" if row.failure is not None else _short(_percent(row))


def _short(percent: float) -> str:
    return number(percent, ".2g" if percent < 99.5 else ".0f")


def _percent(row: TransferRow | None) -> float:
    return np.nan if row is None or row.share_mean is None else 100 * row.share_mean
