"""Tables of `benchmarks.rig`."""

from collections.abc import Callable
from statistics import median

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.records import names, of_kind, select
from softrobot_env.benchmarks.rig.cases import FAST, SLOW, LapsRow, rig_name
from softrobot_env.benchmarks.rig.goals import GoalRow, middle
from softrobot_env.benchmarks.rig.run import Row
from softrobot_env.evaluation.thesis import TRIANGLE
from softrobot_env.rendering.tables import Column, make_table, new_table, number, verdict
from studies.thesis import Row as ForceRow

_NUMBERS = {SLOW: "5.2", FAST: "5.3"}


def tables(rows: list[Row]) -> Group:
    """Tabs. 5.2 and 5.3 beside the thesis', times, Fig. 5.14 in numbers, and goals."""
    laps = of_kind(rows, LapsRow)
    parts = [*(_errors(laps, period) for period in _NUMBERS), _times(laps)]
    parts += [_forces(of_kind(rows, ForceRow)), _goals(of_kind(rows, GoalRow))]
    failed = [row for row in laps if row.failure is not None]
    lines = [f"{rig_name(row.twin)}, {row.policy}: {row.failure}" for row in failed]
    return Group(*(part for part in parts if part.row_count), *map(Text, lines))


def _errors(rows: list[LapsRow], period: float) -> Table:
    rows = select(rows, period=period)
    ideal, twins = select(rows, twin=None), [row for row in rows if row.twin is not None]
    count = len({row.twin for row in twins})
    title = (
        f"Tab. {_NUMBERS[period]}: triangle, T = {period:g} s, mean / largest error in mm\n"
        f"after the approach; twins: median of {count} (range)"
    )
    heads = ("thesis", "no errors", "twins, mean", "twins, largest")
    out = new_table(title, ("policy",), heads)
    for policy in names(rows):
        pair = [middle(ideal, name, policy, period) for name in ("e_mean", "e_max")]
        own = select(twins, policy=policy)
        spreads = (_spread(own, name) for name in ("e_mean", "e_max"))
        out.add_row(policy, _both(TRIANGLE.get((policy, period))), _both(pair), *spreads)
    return out


def _both(pair: tuple[float, float] | list[float | None] | None) -> str:
    if pair is None or None in pair:
        return "-"
    return " / ".join(f"{1e3 * value:.1f}" for value in pair)


def _spread(rows: list[LapsRow], name: str) -> str:
    values = [getattr(row, name) for row in rows]
    if not values or None in values:
        return "failed" if values else "-"
    centre, least, most = (1e3 * f(values) for f in (median, min, max))
    return f"{centre:.1f} ({least:.1f}-{most:.1f})"


def _times(rows: list[LapsRow]) -> Table:
    title = (
        "Computing: time per decision, inputs alone and simulation in times real time;\n"
        "medians over the episodes, largest and share of limited decisions over all"
    )

    def over(join: Callable[[list[float]], float], name: str) -> Callable[[str], float]:
        return lambda policy: join([getattr(row, name) for row in select(rows, policy=policy)])

    columns = (
        Column("policy", lambda policy: policy),
        Column("µs", over(median, "policy_time_median"), ".0f", "µs"),
        Column("99 % µs", over(median, "policy_time_p99"), ".0f", "µs"),
        Column("max µs", over(max, "policy_time_max"), ".0f", "µs"),
        Column("inputs", over(median, "computing_factor"), ".0f"),
        Column("simulation", over(median, "realtime_factor"), ".0f"),
        Column("limited %", over(max, "limited"), ".1f", "%"),
    )
    return make_table(title, columns, names(rows))


def _forces(rows: list[ForceRow]) -> Table:
    columns = (
        Column("what", lambda row: row.y_name.removesuffix("_rad_s").replace("_", " ")),
        Column("found", "y", ".3g"),
        Column("thesis", form="g"),
        Column("audit", form="g"),
    )
    title = "Fig. 5.14: circle of 90 mm, angular velocity in rad/s"
    return make_table(title, columns, select(rows, x=None))


def _goals(rows: list[GoalRow]) -> Table:
    columns = (
        Column("goal"),
        Column("policy"),
        Column("found", lambda row: _with_unit(row.value, row.unit), ">"),
        Column("limit", lambda row: _with_unit(row.limit, row.unit), ">"),
        Column("met", lambda row: verdict(row.met), ">"),
    )
    return make_table("Goals", columns, rows)


def _with_unit(value: float | None, unit: str) -> str:
    if value is None:
        return "failed"
    if not unit:
        return "yes" if value else "no"
    return f"{number(value, '.3g', unit)} {unit}"
