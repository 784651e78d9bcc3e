"""Tables show what records hold, and nothing else."""

from dataclasses import dataclass
from io import StringIO

import pytest
from rich.console import Console

from softrobot_env.rendering.tables import (
    Column,
    make_table,
    named_values,
    new_table,
    number,
    verdict,
)


@dataclass(frozen=True)
class Run:
    name: str
    error: float | None
    n: int | None = None


COLUMNS = (
    Column("name"),
    Column("error\nmm", "error", ".2f", "mm"),
    Column("n", form="d"),
    Column("twice", lambda run: run.n and 2 * run.n, ">"),
)


def shown(table) -> list[str]:
    page = Console(record=True, width=100, file=StringIO())
    page.print(table)
    return [line.strip() for line in page.export_text().splitlines() if line.strip()]


def test_a_line_per_record_in_units_with_dashes_for_none():
    lines = shown(make_table("Runs", COLUMNS, [Run("a", 1.234e-3, 7), Run("b", None)]))
    assert lines[0] == "Runs"
    assert [line.split() for line in lines[-2:]] == [["a", "1.23", "7", "14"], ["b", *"---"]]


def test_mappings_are_records_too():
    table = make_table("", COLUMNS[:2], [{"name": "a", "error": 2e-3}])
    assert shown(table)[-1].split() == ["a", "2.00"]


def test_texts_are_no_markup():
    lines = shown(make_table("[b]", (Column("time [ms]", "name"),), [Run("[red]x", None)]))
    assert (lines[0], lines[1], lines[-1]) == ("[b]", "time [ms]", "[red]x")


def test_what_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="nan"):
        make_table("", COLUMNS, [Run("a", float("nan"))])


def test_number_has_a_unit_and_a_word_for_none():
    assert number(0.01234, ".1f", "mm") == "12.3"
    assert number(0.5, ".0f", "%") == "50"
    assert number(None, missing="never") == "never"


def test_numbers_are_never_cut_short_on_a_narrow_terminal():
    table = new_table("", ("policy",), ("a long heading",))
    table.add_row("a_name_that_is_much_longer_than_the_terminal", "123456789")
    page = Console(record=True, width=30, file=StringIO())
    page.print(table)
    assert "123456789" in page.export_text()


def test_named_values_have_no_headings():
    assert [line.split() for line in shown(named_values("", {"a": "b", "c": 1}))] == [
        ["a", "b"],
        ["c", "1"],
    ]


def test_verdicts():
    assert [str(verdict(met)) for met in (True, False, None)] == ["yes", "NO", "-"]
