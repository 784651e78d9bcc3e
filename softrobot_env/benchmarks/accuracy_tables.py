"""The accuracy rows as two tables that fit a terminal."""

from collections.abc import Callable
from typing import Any

from rich import box
from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.accuracy import DYNAMIC_CASE, rule_of

Row = dict[str, Any]

#: Hinges of the chains shown for the dynamic case; gauss3 has its nearest number.
_SHOWN_HINGES = (12, 18)


def tables(rows: list[Row]) -> Group:
    """Static tip errors by rule and number of hinges, dynamic ones by rule and timestep."""
    static = [row for row in rows if row["case"] != DYNAMIC_CASE]
    dynamic = [r for r in rows if r["case"] == DYNAMIC_CASE and r["n"] in _SHOWN_HINGES]
    return Group(
        _pivot(
            "Static tip error in mm",
            static,
            ("rule", "n"),
            lambda row: (rule_of(row), str(row["n"])),
            lambda row: row["case"].replace("_", " "),
        ),
        _pivot(
            "Tension step of the arm, 3 s: mean tip error in mm (run time in ms)",
            dynamic,
            ("rule", "n", "integrator"),
            lambda row: (rule_of(row), str(row["n"]), row["integrator"]),
            lambda row: f"h = {1e3 * row['timestep']:g} ms",
            timed=True,
        ),
    )


def _pivot(
    title: str,
    rows: list[Row],
    heads: tuple[str, ...],
    line: Callable[[Row], tuple[str, ...]],
    column: Callable[[Row], str],
    timed: bool = False,
) -> Table:
    """Table with one line per `line(row)` and one column per `column(row)`."""
    columns = list(dict.fromkeys(column(row) for row in rows))
    out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in heads:
        out.add_column(head, no_wrap=True)
    for head in columns:
        out.add_column(head, justify="right")
    cells: dict[tuple, dict[str, str]] = {}
    for row in rows:
        cells.setdefault(line(row), {})[column(row)] = _cell(row, timed)
    for key, values in cells.items():
        out.add_row(*key, *(values.get(name, "-") for name in columns))
    return out


def _cell(row: Row, timed: bool) -> str:
    error = f"{1e3 * row['e_mean']:.2g}"
    return f"{error} ({1e3 * row['wall_time']:.1f})" if timed else error
