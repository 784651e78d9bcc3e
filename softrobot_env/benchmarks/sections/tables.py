"""The study of sections as tables that fit a terminal."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.records import groups
from softrobot_env.benchmarks.sections.rows import GOAL, Row
from softrobot_env.rendering.tables import Column, make_table, verdict

_ERRORS = (
    Column("pieces", "pieces", "d"),
    Column("error %", "error_share", ".2g", "%"),
    Column("bending %", "curvature_error", ".2g", "%"),
    Column("twist %", "twist_error", ".2g", "%"),
    Column("rest ms", "equilibrium_time", ".2g", "ms"),
    Column("run / simulated", "time_per_second", ".2g"),
)


def tables(rows: Sequence[Row]) -> Group:
    """Errors at the default resolution with their verdict, then all resolutions of each robot."""
    each = [
        make_table(
            case,
            (
                Column("model"),
                Column("", lambda r: "default" if r.default else r.failure or ""),
                *_ERRORS,
            ),
            mine,
        )
        for (case,), mine in groups(rows, "case").items()
    ]
    return Group(_defaults(rows), *each)


def _defaults(rows: Sequence[Row]) -> Table:
    return make_table(
        f"At the default resolution: are all errors within {100 * GOAL:g} %?",
        (
            Column("robot", "case"),
            Column("model"),
            Column("met", lambda r: verdict(r.good), ">"),
            *_ERRORS,
        ),
        [row for row in rows if row.default],
        caption="error: of the tip over the length; bending, twist: of strains over the largest",
    )
