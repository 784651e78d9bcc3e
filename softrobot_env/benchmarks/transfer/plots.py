"""A map of errors per robot: policies by worlds."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.laps import RefusedRow
from softrobot_env.benchmarks.records import groups, of_kind, one
from softrobot_env.benchmarks.transfer.run import Row, TransferRow
from softrobot_env.benchmarks.transfer.tables import cell
from softrobot_env.rendering.figures import new_figure, save, style_axes
from softrobot_env.rendering.heatmap import heatmap

#: In cells where the plant lacks what the robot has; the tables say what.
_REFUSED = "refused"

#: [%] of the length, ends of the colours.
_COLOURS = (0.1, 100.0)


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the mean errors in % of the length, and over that of the tuning, as PNG."""
    found = of_kind(rows, TransferRow)
    refused = {(row.robot, row.policy, row.what) for row in of_kind(rows, RefusedRow)}
    robots = groups(found, "robot")
    heights = [1.2 + len(groups(mine, "label")) for mine in robots.values()]
    worlds = [world for (world,) in groups(found, "world")]
    figure, _ = new_figure(0, 0, (14, 1 + 0.42 * sum(heights)))
    axes = figure.subplots(len(robots), 1, squeeze=False, height_ratios=heights)
    for axis, ((robot,), mine) in zip(axes.flat, robots.items(), strict=True):
        labels = [label for (label,) in groups(mine, "label")]
        cells = [[one(mine, label=p, world=w) for w in worlds] for p in labels]
        values = [[_percent(row) for row in line] for line in cells]
        style_axes(axis)
        own = {row.label: row.policy for row in mine}
        texts = [
            [
                _text(row, bool({(robot, own[p], w), (robot, p, w)} & refused))
                for row, w in zip(line, worlds, strict=True)
            ]
            for p, line in zip(labels, cells, strict=True)
        ]
        heatmap(axis, np.array(values), texts, labels, worlds, _COLOURS)
        axis.set_title(
            f"{robot}: mean error in % of the length / over that of the tuning", loc="left"
        )
    save(figure, path)


def _text(row: TransferRow | None, refused: bool) -> str:
    """What stands in a cell: nothing where a robot has no such world."""
    return cell(row) if row is not None else _REFUSED if refused else ""


def _percent(row: TransferRow | None) -> float:
    return np.nan if row is None or row.share_mean is None else 100 * row.share_mean
