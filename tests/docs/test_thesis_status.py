"""The page that says of each figure and table of the thesis where we stand is complete."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "results" / "thesis_status.md"

#: Numbered figures and tables of each chapter, counted in the thesis' lists of both.
FIGURES = {2: 24, 3: 18, 4: 23, 5: 14, 6: 22}
TABLES = {2: 3, 3: 1, 4: 2, 5: 3, 6: 5}

STATUS = ("reproduced", "departs", "not compared", "not done", "taken", "no result")


def rows():
    """Place, printed, here, status and why of each row, as filled."""
    filled = re.sub(r"<!--.*?-->", "", PAGE.read_text(encoding="utf-8"), flags=re.S)
    chapters = filled.split("## What is fitted")[0]
    lines = [line for line in chapters.splitlines() if line.startswith(("| Fig", "| Tab", "| sec"))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.parametrize(("kind", "counts"), [("Fig.", FIGURES), ("Tab.", TABLES)])
def test_each_figure_and_table_has_one_row(kind, counts):
    numbered = [f"{kind} {ch}.{k + 1}" for ch, count in counts.items() for k in range(count)]
    found = [match[0] for row in rows() if (match := re.match(r"(Fig|Tab)\. \d\.\d+", row[0]))]
    assert sorted(x for x in found if x.startswith(kind)) == sorted(numbered)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0].split(",")[0])
def test_a_status_has_its_numbers_or_its_reason(row):
    place, printed, here, status, why = row
    name = re.match(r"\*([a-z ]+)\*", status)[1]
    assert name in STATUS
    if name in ("reproduced", "departs"):
        assert re.search(r"\d", here), f"{place}: no number of ours"
    if name == "reproduced" and printed != "coefficients":
        assert re.search(r"\d", printed), f"{place}: no printed number"
    if name in ("departs", "not done", "not compared", "no result"):
        assert why


def test_what_is_marked_is_explained():
    marked, fitted = PAGE.read_text(encoding="utf-8").split("## What is fitted")
    assert "†" in marked and "how results depend on it" in fitted
