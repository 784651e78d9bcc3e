"""What is searched for settings in: values and ranges, from the command line or a TOML file."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

#: What a file has, and how ranges that are equally likely in every decade are marked.
_TABLE, _LOG = "search", "log"


@dataclass(frozen=True)
class Range:
    """Numbers between two, both included.

    Attributes:
        low, high: The two.
        log: Whether the logarithm is drawn uniformly, not the number itself.
    """

    low: float
    high: float
    log: bool = False


#: Name of a setting -> the values or the range that it is searched in.
Space = dict[str, tuple[float, ...] | Range]


def parsed(text: str) -> tuple[str, tuple[float, ...] | Range]:
    """`name=0.1..0.3`, `name=1e-5..1e-3:log` or `name=1,2,3`.

    Raises:
        ValueError: It is none of them.
    """
    name, _, values = text.partition("=")
    ends, _, scale = values.partition(":")
    low, dots, high = ends.partition("..")
    try:
        if not dots and not scale:
            return name, tuple(dict.fromkeys(_number(part) for part in values.split(",")))
        found = Range(_number(low), _number(high), scale == _LOG)
    except ValueError:
        found = None
    if found is None or scale not in ("", _LOG) or not found.low < found.high:
        raise ValueError(f"{text!r} is not NAME=LOW..HIGH, NAME=LOW..HIGH:log or NAME=V1,V2")
    if found.log and found.low <= 0:
        raise ValueError(f"{text!r}: a range with log must be above zero")
    return name, found


def _number(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError
    return value


def read_space(path: Path) -> Space:
    """The table `[search]` of a TOML file: texts as of `parsed`, or lists of values.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no such file; says why.
    """
    try:
        held = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    table = held.get(_TABLE)
    if not isinstance(table, Mapping) or not table or len(held) > 1:
        raise ValueError(f"{path} must have one table [{_TABLE}] with settings, and nothing else")
    return dict(_entry(path, name, value) for name, value in table.items())


def _entry(path: Path, name: str, value: Any) -> tuple[str, tuple[float, ...] | Range]:
    text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
    try:
        return parsed(f"{name}={text}")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def corners(space: Space) -> list[dict[str, float]]:
    """Settings in which each has each of its values or ends once, to check names and ranges."""
    ends = {
        name: (own.low, own.high) if isinstance(own, Range) else own for name, own in space.items()
    }
    first = {name: values[0] for name, values in ends.items()}
    return [first | {name: value} for name, values in ends.items() for value in values]
