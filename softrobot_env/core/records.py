"""What the fields of a data class may hold: said by their annotations, checked when it is made.

Arguments of functions can be checked in the same way.

`float` is a finite number, `int` a whole one, `str` a text, `tuple[float, float]` two finite
numbers, and so on; `Annotated[float, Range(...)]`, for instance `Positive`, says more. What does
not fit is refused in one line that names the field and what is allowed. Lists and arrays become
tuples, so that data classes can be compared; nothing else is converted.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from math import inf, isfinite
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np


@dataclass(frozen=True)
class Range:
    """Numbers that a field may hold.

    Attributes:
        text: For people, after "must be".
        holds: Whether a number, which may be NaN, lies in it.
    """

    text: str
    holds: Callable[[Any], bool]


Positive = Annotated[float, Range("finite and positive", lambda x: 0 < x < inf)]
NotNegative = Annotated[float, Range("finite and zero or more", lambda x: 0 <= x < inf)]
Share = Annotated[float, Range("in [0, 1]", lambda x: 0 <= x <= 1)]
Count = Annotated[int, Range("a whole number, 1 or more", lambda x: x >= 1)]
Whole = Annotated[int, Range("a whole number, 0 or more", lambda x: x >= 0)]


class _Fault(NamedTuple):
    """What does not fit: where in the field, what is allowed there, and what is found."""

    where: str
    allowed: str
    found: Any


class _Rule(NamedTuple):
    """What a hint allows, in words, and a search for the first fault of a value."""

    allowed: str
    fault: Callable[[Any], _Fault | None]


def check_fields(record: Any, what: str, but: Sequence[str] = ()) -> None:
    """Refuse a data class of which a field does not hold what its annotation says.

    Called first in `__post_init__`.

    Args:
        record: The data class.
        what: It, for people; the message begins with it.
        but: Fields that are not looked at.

    Raises:
        ValueError: A field of another type, shape or range; the message says which is allowed.
    """
    for name, rule in _rules(type(record)).items():
        if name in but:
            continue
        value = getattr(record, name)
        frozen = _frozen(value)
        fault = rule.fault(frozen)
        if fault is not None:
            raise ValueError(
                f"{what}: {name}{fault.where} must be {fault.allowed}, got {shown(fault.found)}"
            )
        if frozen is not value:
            object.__setattr__(record, name, frozen)


def check_argument(name: str, value: Any, hint: Any) -> None:
    """Raise ValueError unless an argument is what a type hint says, as `check_fields` does."""
    fault = _rule(hint).fault(_frozen(value))
    if fault is not None:
        raise ValueError(f"{name}{fault.where} must be {fault.allowed}, got {shown(fault.found)}")


def check_unique(names: list[str], what: str) -> None:
    """Raise ValueError unless all names are different."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{what} need different names, {twice[0]!r} is there more than once")


@cache
def _rules(kind: type) -> dict[str, _Rule]:
    """Rules of the fields of a data class, by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: _rule(hints[field.name]) for field in fields(kind)}


def _rule(hint: Any) -> _Rule:
    """What a type hint allows."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        kind, allowed = arguments
        number = _is_whole if kind is int else _is_number
        return _simple(allowed.text, lambda value: number(value) and allowed.holds(value))
    if origin in (Union, UnionType):
        return _either([_rule(one) for one in arguments])
    if origin is tuple:
        return _many(_rule(arguments[0])) if arguments[1:] == (...,) else _few(arguments)
    if origin is Literal:
        listed = f"one of {', '.join(map(repr, arguments))}"
        return _simple(listed, lambda value: isinstance(value, str) and value in arguments)
    return _PLAIN.get(hint) or _instance(origin or hint)


def _simple(allowed: str, fits: Callable[[Any], bool]) -> _Rule:
    return _Rule(allowed, lambda value: None if fits(value) else _Fault("", allowed, value))


def _either(rules: list[_Rule]) -> _Rule:
    allowed = " or ".join(sorted((rule.allowed for rule in rules), key=lambda text: text != "None"))
    return _simple(allowed, lambda value: any(rule.fault(value) is None for rule in rules))


def _many(entry: _Rule) -> _Rule:
    """A tuple of any length."""
    allowed = f"a tuple, each entry {entry.allowed}"

    def fault(value: Any) -> _Fault | None:
        if not isinstance(value, tuple):
            return _Fault("", allowed, value)
        return _first(map(entry.fault, value))

    return _Rule(allowed, fault)


def _few(hints: tuple) -> _Rule:
    """A tuple with as many entries as hints."""
    entries = [_rule(hint) for hint in hints]
    texts = dict.fromkeys(entry.allowed for entry in entries)
    allowed = f"a tuple of {len(entries)}, each {' or '.join(texts)}"

    def fault(value: Any) -> _Fault | None:
        if not isinstance(value, tuple) or len(value) != len(entries):
            return _Fault("", allowed, value)
        return _first(entry.fault(one) for entry, one in zip(entries, value, strict=True))

    return _Rule(allowed, fault)


def _first(faults: Iterable[_Fault | None]) -> _Fault | None:
    """The first fault of the entries of a tuple, if any."""
    for i, fault in enumerate(faults):
        if fault is not None:
            return fault._replace(where=f"[{i}]{fault.where}")
    return None


def _instance(kind: type) -> _Rule:
    if kind is Callable:
        return _simple("a function", callable)
    text = f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}"
    if getattr(kind, "_is_protocol", False):
        text += f" (with {', '.join(name for name in vars(kind) if name[0] != '_')})"
    return _simple(text, lambda value: isinstance(value, kind))


def _frozen(value: Any) -> Any:
    """Lists and arrays as tuples, also within each other; all else as it is."""
    if isinstance(value, np.ndarray) and value.ndim:
        return _frozen(value.tolist())
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


_PLAIN: dict[Any, _Rule] = {
    float: _simple("a finite number", lambda value: _is_number(value) and isfinite(value)),
    int: _simple("a whole number", _is_whole),
    bool: _simple("True or False", lambda value: isinstance(value, bool | np.bool_)),
    str: _simple("a text that is not empty", lambda value: isinstance(value, str) and value != ""),
    NoneType: _simple("None", lambda value: value is None),
}


def shown(value: Any) -> str:
    """A value in one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 120 else f"{text[:117]}..."
