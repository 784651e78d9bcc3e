"""Every byte between host and robot, with its time, in a file.

A file is a header and records `t f64 | direction u8 | size u16 | bytes`, little-endian, appended
as they happen: whatever ends the program, all records but the last one can be read. Records of
bytes to the robot have the time before they were sent, and are written afterwards.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from errno import ENOSPC
from math import isfinite
from os import strerror
from pathlib import Path
from time import monotonic

from softrobot_env.hardware.protocol.framing import Decoder
from softrobot_env.hardware.protocol.messages import SCHEMA, Message
from softrobot_env.hardware.transport import Transport

_MAGIC = b"softrobot link 1\n"
_HEADER = struct.Struct("<I")  # schema
_RECORD = struct.Struct("<dBH")
_LARGEST = 0xFFFF


class Direction(IntEnum):
    """Which way bytes went."""

    TO_ROBOT = 0
    FROM_ROBOT = 1


_DIRECTIONS = frozenset(Direction)


@dataclass(frozen=True)
class Chunk:
    """Bytes that went together.

    Attributes:
        time: [s] of the logging clock.
        direction: Which way they went.
        data: The bytes.
    """

    time: float
    direction: Direction
    data: bytes


@dataclass(frozen=True)
class LinkLog:
    """What a file holds.

    Attributes:
        chunks: In the order of their times.
        complete: Whether the file ends with a whole record.
    """

    chunks: tuple[Chunk, ...]
    complete: bool

    def messages(self) -> Iterator[tuple[Chunk, Message, int]]:
        """Every valid message, with the chunk that completed it and its sequence number."""
        decoders = {direction: Decoder() for direction in Direction}
        for chunk in self.chunks:
            for message, seq in decoders[chunk.direction].feed(chunk.data):
                yield chunk, message, seq


class LoggingTransport:
    """Passes bytes on and writes them to a file.

    Bytes to the robot are sent first. A file that can no longer be written, for instance because
    the disk is full, ends the log and not the link.

    Attributes:
        failure: Why the log has ended too early, or None.
    """

    def __init__(
        self, transport: Transport, path: Path, clock: Callable[[], float] = monotonic
    ) -> None:
        """Begin a new file.

        Raises:
            OSError: The file exists or cannot be written.
        """
        self._transport, self._clock = transport, clock
        self.failure: OSError | None = None
        # Unbuffered: a record is one write, so that records of two threads do not mix.
        self._file = path.open("xb", buffering=0)
        self._file.write(_MAGIC + _HEADER.pack(SCHEMA))

    def read(self, timeout: float) -> bytes:
        """See `Transport`."""
        data = self._transport.read(timeout)
        if data:
            self._note(Direction.FROM_ROBOT, self._clock(), data)
        return data

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        time = self._clock()
        self._transport.write(data)
        self._note(Direction.TO_ROBOT, time, data)

    def close(self) -> None:
        """Close the transport and the file."""
        try:
            self._transport.close()
        finally:
            self._file.close()

    def _note(self, direction: Direction, time: float, data: bytes) -> None:
        for start in range(0, len(data), _LARGEST):
            part = data[start : start + _LARGEST]
            if self.failure is None:
                self._append(_RECORD.pack(time, direction, len(part)) + part)

    def _append(self, record: bytes) -> None:
        try:
            if self._file.write(record) < len(record):
                raise OSError(ENOSPC, strerror(ENOSPC))
        except OSError as error:
            self.failure = error


def read_link_log(path: Path) -> LinkLog:
    """What a file holds, as far as it goes.

    Raises:
        ValueError: It is no such log, damaged, or of another table of messages.
        OSError: It cannot be read.
    """
    data = path.read_bytes()
    start = len(_MAGIC) + _HEADER.size
    if not data.startswith(_MAGIC) or len(data) < start:
        raise ValueError(f"{path} is no log of a serial line")
    (schema,) = _HEADER.unpack_from(data, len(_MAGIC))
    if schema != SCHEMA:
        raise ValueError(
            f"{path} was recorded with another table of messages (schema {schema:08x}, this is "
            f"{SCHEMA:08x})"
        )
    try:
        chunks = sorted(_chunks(data[start:]), key=lambda chunk: chunk.time)
    except ValueError as error:
        raise ValueError(f"{path} is {error}") from None
    size = sum(_RECORD.size + len(chunk.data) for chunk in chunks)
    return LinkLog(tuple(chunks), complete=start + size == len(data))


def _chunks(data: bytes) -> Iterator[Chunk]:
    at = 0
    while at + _RECORD.size <= len(data):
        time, direction, size = _RECORD.unpack_from(data, at)
        at += _RECORD.size + size
        if at > len(data):
            return
        if not isfinite(time) or direction not in _DIRECTIONS:
            raise ValueError(f"damaged before byte {at} of its records")
        yield Chunk(time, Direction(direction), data[at - size : at])
