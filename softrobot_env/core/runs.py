"""Typed rows of reports."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar


@dataclass(frozen=True)
class Row:
    """A row of a report; subclasses are frozen dataclasses of numbers and texts.

    Fields declared with `for_pictures()` hold what only pictures need, and stand in a file beside
    the report.
    """

    def row(self) -> dict[str, Any]:
        """What is written: column -> value in SI units, None where there is none."""
        return {name: getattr(self, name) for name in self.written()}

    @classmethod
    def written(cls) -> list[str]:
        """Columns of a row."""
        return [f.name for f in fields(cls) if f.metadata != _DRAWN]

    def shown(self) -> dict[str, Any]:
        """What only the pictures need, where there is any."""
        mine = [f for f in fields(self) if f.metadata == _DRAWN]
        values = {f.name: (getattr(self, f.name), f.default) for f in mine}
        return {name: value for name, (value, none) in values.items() if value is not none}


_DRAWN = {"drawn": True}

#: The name of rows in studies.
Record = Row

AnyRecord = TypeVar("AnyRecord")


def for_pictures(default: Any = None) -> Any:
    """A field of a record for pictures alone, such as arrays over time."""
    return field(default=default, metadata=_DRAWN, repr=False)


def select(records: Iterable[AnyRecord], **values: Any) -> list[AnyRecord]:
    """Records that have given values in some fields."""
    return [r for r in records if all(getattr(r, k) == v for k, v in values.items())]


def groups(records: Iterable[AnyRecord], *names: str) -> dict[tuple, list[AnyRecord]]:
    """Records by the values of some of their fields, in the order of their first appearance."""
    out: dict[tuple, list[AnyRecord]] = {}
    for record in records:
        out.setdefault(tuple(getattr(record, name) for name in names), []).append(record)
    return out


def one(records: Iterable[AnyRecord], **values: Any) -> AnyRecord | None:
    """The first record that has given values in some fields; None if there is none."""
    return next(iter(select(records, **values)), None)


def of_kind(records: Iterable[Any], kind: type[AnyRecord]) -> list[AnyRecord]:
    """Records of a kind."""
    return [record for record in records if isinstance(record, kind)]


def names(records: Iterable[Any]) -> list[str]:
    """Policies in the order of their first records."""
    return [policy for (policy,) in groups(records, "policy")]
