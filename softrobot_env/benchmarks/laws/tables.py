"""The rows of the study of laws as tables that fit a report of 110 columns."""

from collections.abc import Iterator, Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.laps import LapsRow, RefusedRow
from softrobot_env.benchmarks.laws.goals import GoalRow
from softrobot_env.benchmarks.laws.rows import PathRow
from softrobot_env.benchmarks.laws.run import Row
from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.rendering.tables import Column, make_table, new_table, number, verdict

_PATHS = (
    Column("robot"),
    Column("path", "task"),
    Column("laps/s\nover f1", "frequency", "g"),
    Column("f1 Hz", "first_frequency", ".3g"),
    Column("radius\nmm", "radius", ".3g", "mm"),
    Column("inputs\n% of limit", "inputs", ".0f", "%"),
    Column("servo speed\n% of limit", "speed", ".0f", "%"),
)
_GOALS = (
    Column("robot"),
    Column("best law", "policy"),
    Column("with", lambda row: row.what or "nominal"),
    Column("laps/s\nover f1", "frequency", "g"),
    Column("mean error\n% of length", "share", ".3f", "%"),
    Column("over\nnominal", "ratio", ".2f"),
    Column("limit %", "limit", ".2f", "%"),
    Column("met", lambda row: verdict(row.met)),
)
_NOTES = (
    "Errors are those of two laps at full rate, after a ramp of one lap. "
    "Decision times are medians of cores that are all busy. Limited: share of the decisions whose "
    "status says that the action, or the motion that it gives, is not the one wanted. What a lap "
    "asks of drives is by exact statics and the chain linearised in the middle of its ground; a "
    "radius that is not the default is the largest, to two digits, with at most 90 % of the "
    "limits. The rig is twin 0 with camera and servos, whose errors policies know as far as they "
    "were identified; its errors are those in x and y. The best law is the one of the three "
    "best on the nominal robot that is farthest below its goals on all robots and feedbacks."
)


def tables(rows: list[Row]) -> Group:
    """Paths, all laws, goals, what failed and what was refused."""
    laps = of_kind(rows, LapsRow)
    return Group(
        make_table("Paths, and what a lap asks of the drives", _PATHS, of_kind(rows, PathRow)),
        *_laws(select(laps, what="")),
        make_table("Goals: the worst path of the best law", _GOALS, of_kind(rows, GoalRow)),
        *failed(laps),
        refused(of_kind(rows, RefusedRow)),
        Text(_NOTES),
    )


def refused(rows: Sequence[RefusedRow]) -> Table:
    """What is refused, and why: a line per robot and reason."""
    out = new_table("Refused", ("robot", "policies", "with", "reason"))
    for (robot, what, reason), same in groups(rows, "robot", "what", "reason").items():
        out.add_row(robot, ", ".join(row.policy for row in same), what, reason)
    return out


def failed(rows: Sequence[LapsRow]) -> list[Table]:
    """Failed episodes, if any."""
    columns = [Column(name) for name in ("robot", "policy", "task")]
    columns += [Column("f", "frequency", "g"), Column("with", "what"), Column("failure")]
    lost = [row for row in rows if row.failure is not None]
    return [make_table("Failed", columns, lost)] if lost else []


def _laws(rows: list[LapsRow]) -> Iterator[Table]:
    """A table per robot: a line per law and path, a column per frequency."""
    for (robot,), mine in groups(rows, "robot").items():
        frequencies = [f for (f,) in groups(mine, "frequency")]
        heads = [f"{f:g} f1\nmean/max mm (%)" for f in frequencies]
        title = f"{robot}: error in mm (mean in % of the length), decision time, limited decisions"
        out = new_table(title, ("path", "law"), (*heads, "µs", "limited\n%"))
        for (task,), on_path in groups(mine, "task").items():
            for (law,), found in groups(on_path, "policy").items():
                cells = [_error(select(found, frequency=f)) for f in frequencies]
                time = number(max(r.policy_time_median for r in found), ".0f", "µs")
                limited = "/".join(f"{100 * row.limited:.0f}" for row in found)
                out.add_row(task, law, *cells, time, limited)
            out.add_section()
        yield out


def _error(rows: list[LapsRow]) -> str:
    """Mean and largest error in mm and % of the length, of one episode or none."""
    if not rows or rows[0].lap_mean is None:
        return "failed" if rows else "-"
    row = rows[0]
    size = "/".join(number(v, ".2g", "mm") for v in (row.lap_mean, row.lap_max))
    return f"{size} ({number(row.share_mean, '.2g', '%')})"
