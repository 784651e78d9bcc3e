"""Bodies of messages: `protocol u8 | type u8 | seq u16 | fields`, little-endian, without gaps."""

import struct
from functools import cache

from softrobot_env.hardware.protocol.messages.layouts import HEADER_SIZE, LAYOUTS
from softrobot_env.hardware.protocol.messages.tables import (
    MOST_TENDONS,
    PROTOCOL,
    TYPES,
    UNSEEDED,
    Message,
)

_HEADER = struct.Struct("<BBH")


class MessageError(ValueError):
    """Bytes that are no message, or values that do not fit into one."""


@cache
def _format(number: int, n: int) -> struct.Struct:
    parts = (f"{n if count == 'n' else count}{code}" for _, code, count in LAYOUTS[number])
    return struct.Struct("<" + "".join(parts))


def pack(message: Message, seq: int) -> bytes:
    """Body of a message.

    Args:
        message: The message; arrays over tendons have its `n` elements.
        seq: From 0 to 65535.

    Raises:
        MessageError: A value does not fit, or an array has another length.
    """
    number, n = message.number, getattr(message, "n", 0)
    if not 0 <= n <= MOST_TENDONS:
        raise MessageError(f"a message holds 0 to {MOST_TENDONS} tendons, got {n}")
    values: list[int] = []
    for name, _, count in LAYOUTS[number]:
        value = getattr(message, name)
        if count == 1:
            values.append(value)
            continue
        wanted = n if count == "n" else count
        if len(value) != wanted:
            raise MessageError(f"{type(message).__name__}.{name} needs {wanted} numbers")
        values.extend(value)
    try:
        return _HEADER.pack(PROTOCOL, number, seq) + _format(number, n).pack(*values)
    except struct.error as error:
        raise MessageError(f"{type(message).__name__}: {error}") from None


def unpack(body: bytes) -> tuple[Message, int]:
    """Message and sequence number of a body.

    Raises:
        MessageError: Unknown type, another protocol, or a wrong length.
    """
    if len(body) < HEADER_SIZE:
        raise MessageError(f"a body of {len(body)} bytes has no header")
    protocol, number, seq = _HEADER.unpack_from(body)
    if number not in TYPES:
        raise MessageError(f"unknown message type {number}")
    if protocol != PROTOCOL and number not in UNSEEDED:
        raise MessageError(f"protocol {protocol}, this is {PROTOCOL}")
    n = _count(number, body)
    layout = _format(number, n)
    if len(body) != HEADER_SIZE + layout.size:
        raise MessageError(f"a body of type {number} with {len(body)} bytes")
    return TYPES[number](**_named(number, n, layout.unpack_from(body, HEADER_SIZE))), seq


def _count(number: int, body: bytes) -> int:
    """The field `n` of a body; zero where the type has none."""
    offset = HEADER_SIZE
    for name, code, _ in LAYOUTS[number]:
        if name == "n":
            n = body[offset] if offset < len(body) else MOST_TENDONS + 1
            if n > MOST_TENDONS:
                raise MessageError(f"a message holds 0 to {MOST_TENDONS} tendons, got {n}")
            return n
        offset += struct.calcsize(f"<{code}")
    return 0


def _named(number: int, n: int, values: tuple[int, ...]) -> dict[str, int | tuple[int, ...]]:
    named, at = {}, 0
    for name, _, count in LAYOUTS[number]:
        size = n if count == "n" else count
        named[name] = values[at] if count == 1 else values[at : at + size]
        at += size
    return named
