"""Tables of `benchmarks.rig`."""

from statistics import median

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.controllers.cells import new_table, verdict
from softrobot_env.benchmarks.jobs import Row
from softrobot_env.benchmarks.rig.cases import FAST, SLOW, rig_name
from softrobot_env.benchmarks.rig.goals import middle
from softrobot_env.evaluation.thesis import TRIANGLE

_NUMBERS = {SLOW: "5.2", FAST: "5.3"}
_TIMES = (
    "policy_time_median",
    "policy_time_p99",
    "policy_time_max",
    "computing_factor",
    "realtime_factor",
    "limited",
)
_FACTORS = {"mm": 1e3, "ms": 1e3}


def episodes(rows: list[Row]) -> list[Row]:
    """Rows of episodes."""
    return [row for row in rows if "period" in row]


def policies(rows: list[Row]) -> list[str]:
    """Names in the order of their first rows."""
    return list(dict.fromkeys(row["policy"] for row in episodes(rows)))


def tables(rows: list[Row]) -> Group:
    """Tabs. 5.2 and 5.3 beside the thesis', times, Fig. 5.14 in numbers, and goals."""
    mine = episodes(rows)
    parts = [*(_errors(mine, period) for period in _NUMBERS), _times(mine)]
    parts += [_forces(rows), _goals(rows)]
    failed = [row for row in mine if row["failure"] is not None]
    lines = [f"{rig_name(r['twin'])}, {r['policy']}: {r['failure']}" for r in failed]
    return Group(*(part for part in parts if part.row_count), *map(Text, lines))


def _errors(rows: list[Row], period: float) -> Table:
    rows = [row for row in rows if row["period"] == period]
    twins = [row for row in rows if row["twin"] is not None]
    ideal = [row for row in rows if row["twin"] is None]
    count = len({row["twin"] for row in twins})
    title = (
        f"Tab. {_NUMBERS[period]}: triangle, T = {period:g} s, mean / largest error in mm\n"
        f"after the approach; twins: median of {count} (range)"
    )
    heads = ("thesis", "no errors", "twins, mean", "twins, largest")
    out = new_table(title, ("policy",), heads)
    for policy in policies(rows):
        pair = [middle(ideal, name, policy, period) for name in ("e_mean", "e_max")]
        own = [row for row in twins if row["policy"] == policy]
        spreads = (_spread(own, name) for name in ("e_mean", "e_max"))
        out.add_row(policy, _both(TRIANGLE.get((policy, period))), _both(pair), *spreads)
    return out


def _both(pair: tuple[float, float] | list[float | None] | None) -> str:
    if pair is None or None in pair:
        return "-"
    return " / ".join(f"{1e3 * value:.1f}" for value in pair)


def _spread(rows: list[Row], name: str) -> str:
    values = [row[name] for row in rows]
    if not values or None in values:
        return "failed" if values else "-"
    least, most = min(values), max(values)
    centre = middle(rows, name, rows[0]["policy"], rows[0]["period"])
    return f"{1e3 * centre:.1f} ({1e3 * least:.1f}-{1e3 * most:.1f})"


def _times(rows: list[Row]) -> Table:
    title = (
        "Computing: time per decision, inputs alone and simulation in times real time;\n"
        "medians over the episodes, largest and share of limited decisions over all"
    )
    heads = ("us", "99 % us", "max us", "inputs", "simulation", "limited %")
    out = new_table(title, ("policy",), heads)
    for policy in policies(rows):
        own = [row for row in rows if row["policy"] == policy]
        middle_, most = (
            {name: f(row[name] for row in own) for name in own[0] if name in _TIMES}
            for f in (median, max)
        )
        out.add_row(
            policy,
            f"{1e6 * middle_['policy_time_median']:.0f}",
            f"{1e6 * middle_['policy_time_p99']:.0f}",
            f"{1e6 * most['policy_time_max']:.0f}",
            f"{middle_['computing_factor']:.0f}",
            f"{middle_['realtime_factor']:.0f}",
            f"{100 * most['limited']:.1f}",
        )
    return out


def _forces(rows: list[Row]) -> Table:
    title = "Fig. 5.14: circle of 90 mm, angular velocity in rad/s"
    out = new_table(title, ("what",), ("found", "thesis", "audit"))
    for row in rows:
        if row.get("figure") and row["x"] is None:
            printed = (row[name] for name in ("thesis", "audit"))
            what = row["y_name"].removesuffix("_rad_s").replace("_", " ")
            out.add_row(what, f"{row['y']:.3g}", *("-" if p is None else f"{p:g}" for p in printed))
    return out


def _goals(rows: list[Row]) -> Table:
    out = new_table("Goals", ("goal", "policy"), ("found", "limit", "met"))
    for row in rows:
        if "goal" in row:
            shown = (_with_unit(row[name], row["unit"]) for name in ("value", "limit"))
            out.add_row(row["goal"], row["policy"], *shown, verdict(row["met"]))
    return out


def _with_unit(value: float | None, unit: str) -> str:
    if value is None:
        return "failed"
    if not unit:
        return "yes" if value else "no"
    return f"{_FACTORS.get(unit, 1.0) * value:.3g} {unit}"
