"""Numbers of a robot file: key, unit, resolution and range in one place.

A field `x: Annotated[float, Key("x_mm", 1e-3, 0.01, 0, 10)]` is kept in metres and written in the
file as millimetres. A number that is finer than what a message can carry is refused, not rounded.
"""

from dataclasses import fields
from functools import cache
from math import isfinite
from typing import Any, NamedTuple, get_args, get_type_hints

_RESOLUTION = 0.01  # mm, mm/s and N in a message
_EXACT = 1e-6  # of a step; what is left of a decimal number after a change of units


class RobotFileError(ValueError):
    """A robot file says something that is not allowed."""


class Key(NamedTuple):
    """How a number is written: key, its unit in SI, its step and range in that unit."""

    name: str
    unit: float
    step: float
    least: float
    most: float

    def written(self, value: float) -> float:
        """The number in the file of a value in SI."""
        return round(value / self.unit, 9)

    def read(self, number: float) -> float:
        """The value in SI of a number in the file."""
        return round(number * self.unit, 12)

    def counts(self, value: float) -> int:
        """A value in SI as the number of steps that a message carries."""
        return round(value / self.unit / self.step)

    def check(self, value: float) -> None:
        """Refuse what is not allowed.

        Raises:
            RobotFileError: No number, outside the range, or finer than a step.
        """
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise RobotFileError(f"{self.name} must be a finite number, got {value!r}")
        number = self.written(value)
        if not self.least <= number <= self.most:
            raise RobotFileError(
                f"{self.name} must lie in [{self.least:g}, {self.most:g}], got {number:g}"
            )
        if abs(number / self.step - round(number / self.step)) > _EXACT:
            raise RobotFileError(f"{self.name} has steps of {self.step:g}, got {number!r}")


def millimetres(name: str, least: float, most: float) -> Key:
    """Key of a length or a speed, in mm or mm/s."""
    return Key(name, 1e-3, _RESOLUTION, least, most)


def milliseconds(name: str, least: float, most: float) -> Key:
    """Key of a time."""
    return Key(name, 1e-3, 1.0, least, most)


def newtons(name: str) -> Key:
    """Key of a force."""
    return Key(name, 1.0, _RESOLUTION, 0.0, 600.0)


@cache
def keys(kind: type) -> dict[str, Key]:
    """Keys of a dataclass by field."""
    hints = get_type_hints(kind, include_extras=True)
    found = ((field.name, get_args(hints[field.name])) for field in fields(kind))
    return {name: args[1] for name, args in found if len(args) > 1 and isinstance(args[1], Key)}


def check_numbers(record: Any) -> None:
    """Refuse a dataclass with a number that is not allowed.

    Raises:
        RobotFileError: See `Key.check`.
    """
    for name, key in keys(type(record)).items():
        key.check(getattr(record, name))


def check_whole(name: str, value: Any, most: int) -> None:
    """Refuse what is no whole number from 0 to `most`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise RobotFileError(f"{name} must be a whole number from 0 to {most}, got {value!r}")


def check_text(name: str, value: Any) -> None:
    """Refuse what is no text, or an empty one."""
    if not isinstance(value, str) or not value:
        raise RobotFileError(f"{name} must be a text, got {value!r}")
