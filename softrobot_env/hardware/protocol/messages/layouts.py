"""Where the fields of a message lie, and the hash of all tables that both sides must share."""

from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple, get_args, get_origin, get_type_hints
from zlib import crc32

from softrobot_env.hardware.protocol.messages.codes import ENUMERATIONS, FLAGS
from softrobot_env.hardware.protocol.messages.tables import PROTOCOL, TYPES, UNSEEDED

#: Bytes of a body before its fields: protocol, type, sequence number.
HEADER_SIZE = 4


class Field(NamedTuple):
    """A field: its name, its number as `struct` codes it, and how many of them.

    A count of "n" is one for each of the message's tendons.
    """

    name: str
    code: str
    count: int | str


def _layout(kind: type) -> tuple[Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(field.name, hints[field.name]) for field in fields(kind))


def _field(name: str, hint: object) -> Field:
    base, code, *count = get_args(hint)
    if get_origin(base) is not tuple:
        return Field(name, code, 1)
    return Field(name, code, count[0] if count else "n")


#: Type of a message -> its fields.
LAYOUTS = {number: _layout(kind) for number, kind in TYPES.items()}


def schema_text() -> str:
    """Messages and enumerations as text, one a line; what `SCHEMA` is the hash of."""
    return "\n".join([f"protocol {PROTOCOL}", *_told_messages(), *_told_codes()])


def _told_messages() -> Iterator[str]:
    for number, kind in TYPES.items():
        parts = (f"{name}:{code}{count}" for name, code, count in LAYOUTS[number])
        yield " ".join([str(number), kind.__name__, *parts])


def _told_codes() -> Iterator[str]:
    for kind in (*ENUMERATIONS, *FLAGS):
        yield " ".join([kind.__name__, *(f"{code.name}={code.value}" for code in kind)])


SCHEMA = crc32(schema_text().encode())


def seed(number: int) -> int:
    """What the checksum of a message type starts from."""
    return 0 if number in UNSEEDED else SCHEMA
