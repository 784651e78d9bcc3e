"""Tables for terminals and reports: one look, and columns that say how a record's values are shown.

Texts are shown as they are: square brackets in them are no markup.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from statistics import median
from typing import Any

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

#: Unit shown -> factor from SI.
FACTORS = {"mm": 1e3, "mrad": 1e3, "ms": 1e3, "µs": 1e6, "%": 100.0, "1e-6": 1e6, "kB": 1e-3}

#: What stands where there is no number.
NONE = "-"

_WIDTH = 110  # characters of a page


def number(value: float | None, form: str = ".2g", unit: str = "", missing: str = NONE) -> str:
    """A number in SI units, written in a unit.

    Args:
        value: The number; None gives `missing`.
        form: Format, such as ".2f" or "d".
        unit: One of `FACTORS`; any other has the factor 1.
        missing: Text in place of None.

    Raises:
        ValueError: The number is infinite or not a number; what failed must say None.
    """
    if value is None:
        return missing
    if not math.isfinite(value):
        raise ValueError(f"{value} in a table is not finite")
    return format(FACTORS.get(unit, 1) * value, form)


def spread(values: Sequence[float | None], form: str = ".3g", unit: str = "") -> str:
    """Median of some numbers in SI units, and in brackets the least and the largest.

    Args:
        values: The numbers; None where there is none, which is said.
        form, unit: As of `number`.
    """
    known = [value for value in values if value is not None]
    if not known:
        return NONE
    missing = "" if len(known) == len(values) else f", {len(values) - len(known)} never"
    if len(known) == 1:
        return number(known[0], form, unit) + missing
    middle, least, most = (number(f(known), form, unit) for f in (median, min, max))
    return f"{middle} ({least} to {most}{missing})"


@dataclass(frozen=True)
class Column:
    """One quantity of the records of a table.

    Attributes:
        heading: What stands above it.
        value: Field of a record, or a function of the record, which gives a number, a text or
            None; the field that is called like the heading unless given.
        form: Format of the numbers; ">" for other values on the right, "" for texts on the left.
        unit: Unit that numbers are shown in, see `FACTORS`.
    """

    heading: str
    value: str | Callable[[Any], Any] | None = None
    form: str = ""
    unit: str = ""

    def cell(self, record: Any) -> Text:
        """What stands in the line of a record.

        Raises:
            ValueError: A number is not finite.
        """
        name = self.heading if self.value is None else self.value
        value = name(record) if callable(name) else _field(record, name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = number(value, self.form, self.unit)
        return _text(value)


def _field(record: Any, name: str) -> Any:
    return record.get(name) if isinstance(record, Mapping) else getattr(record, name)


def _text(value: Any) -> Text:
    return value if isinstance(value, Text) else Text(NONE if value is None else str(value))


def new_table(title: str, left: Sequence[str] = (), right: Sequence[str] = ()) -> "PlainTable":
    """An empty table with columns on the left, which fold on a narrow terminal, and on the right.

    Args:
        title: Above the table.
        left: Headings of columns of text.
        right: Headings of columns of numbers, which are never cut short.
    """
    out = PlainTable(
        title=Text(title),
        title_justify="left",
        header_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for heading in left:
        out.add_column(Text(heading), overflow="fold")
    for heading in right:
        out.add_column(Text(heading), justify="right", no_wrap=True)
    return out


class PlainTable(Table):
    """A table whose cells are texts, numbers as they are, or None."""

    def add_row(self, *cells: Any) -> None:
        """Add a line."""
        super().add_row(*map(_text, cells))


def make_table(
    title: str, columns: Sequence[Column], records: Iterable[Any], *, caption: str = ""
) -> PlainTable:
    """A line for each record, with its columns in the given order.

    Args:
        title: Above the table.
        columns: What is shown.
        records: Dataclasses or mappings.
        caption: Below the table.
    """
    out = new_table(title)
    for column in columns:
        layout = {"justify": "right", "no_wrap": True} if column.form else {"overflow": "fold"}
        out.add_column(Text(column.heading), **layout)
    for record in records:
        out.add_row(*(column.cell(record) for column in columns))
    out.caption = Text(caption) if caption else None
    return out


def named_values(title: str, values: Mapping[str, Any]) -> PlainTable:
    """Names on the left, and what each of them is."""
    out = new_table(title, ("", ""))
    out.show_header = False
    for name, value in values.items():
        out.add_row(name, value)
    return out


def verdict(met: bool | None) -> Text:
    """Whether a goal was met; a dash where there was none."""
    if met is None:
        return Text(NONE)
    return Text("yes") if met else Text("NO", style="bold red")


def text_page(title: str, tables: Group, command: str) -> str:
    """A page of Markdown: tables as they appear on a terminal, and the command that made them."""
    page = Console(record=True, width=_WIDTH, file=StringIO())
    page.print(tables)
    text = page.export_text().rstrip()
    return f"# {title}\n\nMade by `{command}`.\n\n```text\n{text}\n```\n"
