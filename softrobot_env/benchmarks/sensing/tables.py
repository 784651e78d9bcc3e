"""The study of sensors as a table that fits a terminal."""

from collections.abc import Sequence

from rich.console import Group

from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.rendering.tables import Column, make_table, verdict

_COLUMNS = (
    Column("figure"),
    Column("quantity"),
    Column("here", "value", ".3g"),
    Column("thesis", "thesis", ".3g"),
    Column("goal", "goal", ".3g"),
    Column("unit"),
    Column("met", lambda r: "" if r.met is None else verdict(r.met), ">"),
    Column("kind"),
    Column("note"),
)


def tables(rows: Sequence[Row]) -> Group:
    """A table for each sensor, and what the kinds of rows mean."""
    parts = {
        "Planar sensor between servos": [r for r in rows if _is_planar(r)],
        "Three planar sensors in a finger": [r for r in rows if _is_of_finger(r)],
        "Spatial sensor in the rig": [r for r in rows if "specimens" in r.quantity],
    }
    caption = (
        "fitted: a number of the model was chosen by it; implied: by the thesis' polynomial of "
        "order 5, which the model has; assumed: on a finger and sizes of imperfections that "
        "are; check: none of these"
    )
    return Group(
        *(make_table(name, _COLUMNS, some, caption=caption) for name, some in parts.items())
    )


def _is_planar(row: Row) -> bool:
    return not _is_of_finger(row) and "specimens" not in row.quantity


def _is_of_finger(row: Row) -> bool:
    return row.figure in ("Fig. 4.16", "Fig. 4.17", "Fig. 4.18")
