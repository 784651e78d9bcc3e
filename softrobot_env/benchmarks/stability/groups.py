"""Rows of the stability benchmark sorted by their values, and tables for them."""

from collections.abc import Iterable

from rich import box
from rich.markup import escape
from rich.table import Table

from softrobot_env.benchmarks.stability.runs import Row


def groups(rows: Iterable[Row], *keys: str) -> dict[tuple, list[Row]]:
    """Rows by the values of some of their keys, in the order of their first appearance."""
    out: dict[tuple, list[Row]] = {}
    for row in rows:
        out.setdefault(tuple(row[key] for key in keys), []).append(row)
    return out


def new_table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    """An empty table with columns aligned left and right."""
    out = Table(
        title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    for head in left:
        out.add_column(escape(head))
    for head in right:
        out.add_column(escape(head), justify="right")
    return out
