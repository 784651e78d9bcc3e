"""Records: data classes whose annotations say what fields may hold and how files write them.

`float` is a finite number, `int` a whole one, `str` a text, `tuple[float, float]` two finite
numbers, and so on; `Annotated[float, Range(...)]`, for instance `Positive`, says more. What does
not fit is refused in one line that names the field and what is allowed. Lists and arrays become
tuples, so that records can be compared; nothing else is converted. Arguments of functions can be
checked in the same way.

A file, or a row of a report, is a table of keys and values: `read` makes a record of it, `write`
the opposite, `keys` lists what there may be. The key of a field is its name, followed by the unit
that its annotation says: `length: Annotated[float, Unit("m")]` is `length_m`. A field that is a
record is a table, one that holds a tuple of records a list of tables.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from math import inf, isfinite
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from .files import is_in_one_line


@dataclass(frozen=True)
class Range:
    """Numbers that a field may hold.

    Attributes:
        text: For people, after "must be".
        holds: Whether a number, which may be NaN, lies in it.
    """

    text: str
    holds: Callable[[Any], bool]


@dataclass(frozen=True)
class Unit:
    """Unit of a field, with which its key ends.

    Attributes:
        name: Such as "m" or "1/m".
        si: SI units in one of it. Files have numbers in the unit, fields have them in SI, and
            ranges are those of files.
    """

    name: str
    si: float = 1.0

    def key(self, name: str) -> str:
        """The key of a field."""
        return f"{name}_{re.sub('[ /]', '_', self.name)}"

    def written(self, value: Any) -> Any:
        """The number in a file of a value in SI."""
        exact = self.si == 1 or not (_is_number(value) and isfinite(value))
        return value if exact else round(value / self.si, 9)

    def read(self, number: Any) -> Any:
        """The value in SI of a number in a file."""
        return number if self.si == 1 else round(number * self.si, 12)


@dataclass(frozen=True)
class Key:
    """Key of a field that is written by another name."""

    name: str


def unwritten(default: Any = MISSING, **options: Any) -> Any:
    """A field that no file or row has; options as of `dataclasses.field`."""
    return field(default=default, metadata=_UNWRITTEN, **options)


_UNWRITTEN = {"written": False}


def whole_numbers(least: int, most: int) -> Range:
    """Whole numbers from `least` to `most`."""
    return Range(f"a whole number from {least} to {most}", lambda n: least <= n <= most)


Positive = Annotated[float, Range("finite and positive", lambda x: 0 < x < inf)]
NotNegative = Annotated[float, Range("finite and zero or more", lambda x: 0 <= x < inf)]
Name = Annotated[
    str,
    Range(
        "1 to 100 printable characters without / and \\",
        lambda text: 0 < len(text) <= 100 and is_in_one_line(text),
    ),
]
Share = Annotated[float, Range("in [0, 1]", lambda x: 0 <= x <= 1)]
Count = Annotated[int, Range("a whole number, 1 or more", lambda x: x >= 1)]
Whole = Annotated[int, Range("a whole number, 0 or more", lambda x: x >= 0)]


Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]

AnyRecord = TypeVar("AnyRecord")


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
    for name, entry in _entries(type(record)).items():
        if name in but:
            continue
        value = getattr(record, name)
        frozen = _frozen(value)
        other = entry.unit is not None and entry.unit.si != 1
        said, found = (entry.key, entry.unit.written(frozen)) if other else (name, frozen)
        _check(f"{what}: {said}", found, entry.rule)
        if frozen is not value:
            object.__setattr__(record, name, frozen)


class Record:
    """A data class that is checked as it is made; messages call it `what`, and by its name.

    `what` is an argument of the class, as in `class Step(Record, what="step")`; its name in small
    letters unless given.
    """

    def __init_subclass__(cls, what: str | None = None) -> None:
        cls._what = what or cls.__name__.lower()

    def __post_init__(self) -> None:
        name = vars(self).get("name")
        check_fields(self, self._what if name is None else f"{self._what} {name!r}")


def check_argument(name: str, value: Any, hint: Any) -> None:
    """Raise ValueError unless an argument is what a type hint says, as `check_fields` does."""
    _check(name, _frozen(value), _rule(hint))


def _check(what: str, value: Any, rule: "_Rule") -> None:
    fault = rule.fault(value)
    if fault is not None:
        raise ValueError(f"{what}{fault.where} must be {fault.allowed}, got {shown(fault.found)}")


def check_unique(named: Iterable[Any], what: str) -> None:
    """Raise ValueError unless all names, or those of all things, are different."""
    names = [getattr(one, "name", one) for one in named]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{what} need different names, {twice[0]!r} is there more than once")


class Entry(NamedTuple):
    """How files have a field of a record.

    Attributes:
        name: Of the field.
        key: In files.
        unit: Of its numbers, if it has one.
        kind: Class of the record or the records that it holds, None of others.
        many: Whether it holds records in a tuple.
        default: What it is unless given; MISSING where it has to be.
        rule: What it may hold.
    """

    name: str
    key: str
    unit: Unit | None
    kind: type | None
    many: bool
    default: Any
    rule: _Rule


def keys(kind: type) -> dict[str, Entry]:
    """What a table of a kind of record may hold, by key."""
    hidden = {one.name for one in fields(kind) if one.metadata == _UNWRITTEN}
    return {x.key: x for name, x in _entries(kind).items() if name not in hidden}


def read(
    kind: type[AnyRecord],
    table: Any,
    where: str = "",
    readers: Mapping[str, Callable[[Any, str], Any]] | None = None,
) -> AnyRecord:
    """The record that a table says.

    Args:
        kind: Its class.
        table: Key -> value, see `keys`.
        where: Place of the table, with which messages begin.
        readers: Key -> what makes each table there into what the field holds, given the table and
            its place; `read` itself unless given.

    Raises:
        ValueError: A key is unknown or missing, or a value is not allowed.
    """
    (values,) = read_values(table, where, [kind], readers)
    with placed(where, kind):
        return kind(**values)


def read_values(
    table: Any,
    where: str,
    kinds: Sequence[type],
    readers: Mapping[str, Callable[[Any, str], Any]] | None = None,
    optional: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """Values of fields that a table says, of each of the kinds of records that share it.

    Args:
        table, where, readers: See `read`.
        kinds: Classes of records.
        optional: Keys that may be missing although their fields have no default.

    Raises:
        ValueError: As `read`.
    """
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} must be a table, got {shown(table)}")
    known = [keys(kind) for kind in kinds]
    allowed = {key: entry for one in known for key, entry in one.items()}
    for key in table:
        if key not in allowed:
            raise ValueError(f"{_joined(where, key)} is no key; allowed are {', '.join(allowed)}")
    needed = (key for key, entry in allowed.items() if entry.default is MISSING)
    missing = [key for key in needed if key not in table and key not in optional]
    if missing:
        raise ValueError(f"{where}{': ' if where else ''}{', '.join(missing)} missing")
    return [
        {
            entry.name: _read_value(table[key], _joined(where, key), entry, readers or {})
            for key, entry in one.items()
            if key in table
        }
        for one in known
    ]


def _read_value(value: Any, where: str, entry: Entry, readers: Mapping[str, Any]) -> Any:
    if entry.kind is None:
        frozen = _frozen(value)
        with placed(""):
            _check(where, frozen, entry.rule)
        return frozen if entry.unit is None else entry.unit.read(frozen)
    make = readers.get(entry.key) or (lambda *of: read(entry.kind, *of))
    if not entry.many:
        return make(value, where)
    if not isinstance(value, list | tuple) or not all(isinstance(x, Mapping) for x in value):
        raise ValueError(f"{where} must be tables, each begun with [[{where}]]")
    return tuple(make(x, f"{where}[{k}]") for k, x in enumerate(value, 1))


def write(record: Any, full: bool = False) -> dict[str, Any]:
    """The table that `read` makes a record from.

    Args:
        record: The record.
        full: Whether what has its default is there as well, as in rows of a report.
    """
    table = {}
    for key, entry in keys(type(record)).items():
        value = getattr(record, entry.name)
        if full or value != entry.default:
            if entry.many:
                value = [write(one, full) for one in value]
            elif entry.kind is not None and value is not None:
                value = write(value, full)
            table[key] = value if entry.unit is None else entry.unit.written(value)
    return table


@contextmanager
def placed(where: object, kind: type | None = None) -> Iterator[None]:
    """Begin messages of errors within with a place; fields of a kind are called by their keys."""
    try:
        yield
    except (ValueError, OverflowError) as error:
        text = str(error).replace("a tuple", "a list")
        for entry in () if kind is None else keys(kind).values():
            if entry.unit is not None:
                text = re.sub(rf"\b{entry.name}\b", entry.key, text)
        begun = not str(where) or text.startswith(f"{where}: ")
        raise ValueError(text if begun else f"{where}: {text}") from None


def _joined(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


@cache
def _entries(kind: type) -> dict[str, Entry]:
    """How each field of a data class is checked and written, by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: _entry(one, hints[one.name]) for one in fields(kind)}


def _entry(one: Any, hint: Any) -> Entry:
    said = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    unit = next((x for x in said if isinstance(x, Unit)), None)
    own = one.name if unit is None else unit.key(one.name)
    key = next((x.name for x in said if isinstance(x, Key)), own)
    bare = get_args(hint)[0] if said else hint
    options = get_args(bare) if get_origin(bare) in (Union, UnionType) else (bare,)
    held = next((x for x in options if x is not NoneType), None)
    many = get_origin(held) is tuple and get_args(held)[1:] == (...,)
    held = get_args(held)[0] if many else held
    held = held if isinstance(held, type) and is_dataclass(held) else None
    default = one.default if one.default_factory is MISSING else one.default_factory()
    return Entry(one.name, key, unit, held, many and held is not None, default, _rule(hint))


def _rule(hint: Any) -> _Rule:
    """What a type hint allows."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        kind, *said = arguments
        allowed = next((x for x in said if isinstance(x, Range)), None)
        if allowed is None:
            return _rule(kind)
        fits = {int: _is_whole, str: _is_text}.get(kind, _is_number)
        return _simple(allowed.text, lambda value: fits(value) and allowed.holds(value))
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


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


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
