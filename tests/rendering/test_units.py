"""Factors of units: of every column of every table, and in texts, against conversions of their own.

Records are in SI units. A column whose heading has a unit, or that stands right of such a one
without a unit of its own, shows numbers in it.
"""

import ast
import re
from importlib import import_module
from itertools import pairwise
from math import pi
from pathlib import Path

import pytest

from softrobot_env.identification.fit.report import _UNITS
from softrobot_env.rendering.tables import FACTORS, Column

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [*(ROOT / "softrobot_env").rglob("*.py"), *(ROOT / "scripts" / "studies").rglob("*.py")]

#: How many of a unit are one in SI.
IN_SI = {
    "mm": 1000,
    "ms": 1000,
    "mrad": 1000,
    "mN": 1000,
    "mV": 1000,
    "µs": 1_000_000,
    "1e-6": 1_000_000,
    "%": 100,
    "kB": 1 / 1000,
    "deg": 180 / pi,
}
_UNIT = "|".join(sorted(map(re.escape, IN_SI), key=len, reverse=True))
_HEADED = re.compile(rf"(?:^|[\s\[(])({_UNIT})(?:$|[\s\]),])")
_NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")

#: In degrees already, as the sensors of the gripper's study read; and a confidence.
_AS_THEY_ARE = {"bends deg", "95 %"}


class Probe(float):
    """A number that is every field and entry of itself, and of its fields."""

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return self

    def __getitem__(self, _):
        return self

    def get(self, _, default=None):
        return self


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[1:] if parts[0] == "scripts" else parts).removesuffix(".__init__")


def is_column(node):
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Column"


def written_columns():
    """Columns that sources make, in groups that stand in one table; those of local names are not
    there, if they have no unit of their own."""
    for path in SOURCES:
        text = path.read_text("utf-8")
        if "Column(" not in text:
            continue
        names = vars(import_module(module_of(path)))
        for value in names.values():  # also those that are made by a comprehension
            if isinstance(value, tuple) and value and all(isinstance(x, Column) for x in value):
                yield path, list(value)
        for holder in ast.walk(ast.parse(text)):
            made = [node for node in ast.iter_child_nodes(holder) if is_column(node)]
            found = []
            for node in made:
                try:
                    code = compile(ast.Expression(node), str(path), "eval")
                    found.append(eval(code, dict(names)))
                except NameError:
                    assert not _HEADED.search(ast.unparse(node)), (path, ast.unparse(node))
            if found:
                yield path, found


def shown_units():
    """Columns with the unit that a reader takes their numbers to be in."""
    for path, columns in written_columns():
        unit = None
        for column in columns:
            headed = _HEADED.search(column.heading)
            unit = headed[1] if headed else unit
            if (headed or column.unit) and column.heading not in _AS_THEY_ARE:
                yield path, column, unit


def test_every_column_shows_numbers_in_the_unit_of_its_heading():
    checked, wrong = set(), []
    for path, column, unit in shown_units():
        assert unit is not None, f"{path}: {column.heading!r} has a unit that nobody reads"
        probe = Probe(0.2 if IN_SI[unit] > 1 else 2e5)
        try:
            text = str(column.cell(probe))
        except KeyError:  # a function that looks its record up
            text = str(Column("", "x", column.form, column.unit).cell({"x": float(probe)}))
        numbers = [float(number) for number in _NUMBER.findall(text)]
        expected = pytest.approx(IN_SI[unit] * probe, rel=0.03)
        if not numbers or any(number != expected for number in numbers):
            wrong.append((str(path.relative_to(ROOT)), column.heading, text))
        checked.add((path, column.heading))
    assert not wrong
    assert len(checked) > 25


def test_factors_are_those_of_their_units():
    assert {unit: FACTORS[unit] for unit in FACTORS} == {unit: IN_SI[unit] for unit in FACTORS}
    for unit, factor in _UNITS.values():
        assert factor == pytest.approx(IN_SI[unit], rel=1e-15)


def factors_in_texts():
    """Factors of numbers that stand before a unit in a text, and that unit."""
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            parts = node.values if isinstance(node, ast.JoinedStr) else []
            for value, after in pairwise(parts):
                if not (isinstance(value, ast.FormattedValue) and isinstance(after, ast.Constant)):
                    continue
                unit = re.match(rf"\)? ?({_UNIT})(?![\w/])", after.value)
                product = value.value
                if unit and isinstance(product, ast.BinOp) and isinstance(product.op, ast.Mult):
                    for one in (product.left, product.right):
                        if isinstance(one, ast.Constant):
                            yield path, node.lineno, unit[1], one.value


def test_texts_have_the_factor_of_the_unit_behind_the_number():
    found = list(factors_in_texts())
    wrong = {(path.name, unit, x) for path, _, unit, x in found if x != IN_SI[unit]}
    assert wrong == {("cases.py", "ms", 250)}  # a quarter of a step
    assert len(found) > 40
