"""The rows of the study of transfer as tables that fit a report of 110 columns."""

from collections.abc import Iterator, Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.laps import RefusedRow
from softrobot_env.benchmarks.laws.tables import failed, refused
from softrobot_env.benchmarks.records import groups, of_kind, one
from softrobot_env.benchmarks.transfer.run import FREQUENCY, TASK, Row, TransferRow
from softrobot_env.benchmarks.transfer.worlds import PLANT, TWIN, VARIED
from softrobot_env.rendering.tables import number, pivot_table

_TITLES = {PLANT: "other plants", VARIED: "other robots", TWIN: "twins"}

_NOTES = (
    f"Mean error over a lap at full rate of {TASK}, {FREQUENCY:g} laps per period of the first "
    "mode, in % of the length, and after a stroke over that on the plant of the tuning: the chain, "
    "unless the name says on which plant it was trained or tuned for this study: networks of the "
    "arm with less data than what is shipped, PPO with 120 000 steps on random paths, tables as "
    "`softrobot train` makes them, from equilibria and linear models of pieces of constant "
    "curvature. Drawn robots vary in E, density and damping at once; twins have errors of "
    "manufacturing, servos and camera; the rig is twin 0 wherever no other is named. A dash: "
    "refused, see below."
)


def tables(rows: list[Row]) -> Group:
    """A table per robot and group of worlds, what failed and what is refused."""
    found = of_kind(rows, TransferRow)
    parts = [*_tables(found), *failed(found), refused(of_kind(rows, RefusedRow)), Text(_NOTES)]
    return Group(*parts)


def _tables(rows: Sequence[TransferRow]) -> Iterator[Table]:
    for (robot, group), mine in groups(rows, "robot", "group").items():
        yield pivot_table(
            f"{robot}, {_TITLES[group]}: error in % of the length / over that of the tuning",
            "policy",
            [label for (label,) in groups(mine, "label")],
            [world for (world,) in groups(mine, "world")],
            lambda label, world, mine=mine: cell(one(mine, label=label, world=world)),
        )


def cell(row: TransferRow | None, stroke: str = " / ") -> str:
    """Error and ratio of an episode, or what there is in their place."""
    if row is None or row.failure is not None:
        return "-" if row is None else "failed"
    percent = None if row.share_mean is None else 100 * row.share_mean
    return f"{_short(percent)}{stroke}{_short(row.ratio)}"


def _short(value: float | None) -> str:
    """Two digits, or all before the point."""
    return number(value, ".2g" if value is None or value < 99.5 else ".0f")
