"""The way that bytes go: a serial port, and a file of every byte with its time.

The file is a header and records `t f64 | direction u8 | size u16 | bytes`, little-endian, appended
as they happen: whatever ends the program, all records but the last one can be read. Records of
bytes to the robot have the time before they were sent, and are written afterwards.
"""

import os
import struct
import termios
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from errno import EAGAIN, ENOSPC
from math import isfinite
from os import strerror
from pathlib import Path
from select import select
from time import monotonic
from types import ModuleType
from typing import Protocol

from softrobot_env.core.extras import needed
from softrobot_env.core.files import readable

from .errors import LinkError
from .protocol.messages import SCHEMA, Decoder, Message

#: [s] after which a write that nobody reads is given up.
WRITE_TIMEOUT = 0.2


class Transport(Protocol):
    """Carries bytes both ways; one thread may read while another one writes."""

    def read(self, timeout: float) -> bytes:
        """Bytes that have arrived; waits for the first one at most `timeout` [s].

        Returns:
            Nothing if none came.

        Raises:
            LinkError: The way is broken.
        """

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            LinkError: The way is broken, or nobody takes the bytes.
        """

    def close(self) -> None:
        """Free the port; twice is harmless."""


class SerialTransport:
    """A serial port, locked so that no other program of this package opens it meanwhile."""

    def __init__(self, port: str, baud: int) -> None:
        """Open a port.

        Raises:
            LinkError: There is no such port, or another program has it.
            ImportError: pyserial is not installed.
        """
        self._name = port
        serial = load_serial()
        try:
            self._port = serial.Serial(port, baud, timeout=0.0, exclusive=True)
        except (OSError, termios.error, ValueError) as error:
            raise LinkError(f"cannot open {port}: {_reason(error)}") from None

    def read(self, timeout: float) -> bytes:
        """See `Transport`."""
        try:
            if self._port.timeout != timeout:
                self._port.timeout = timeout
            first = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except (OSError, termios.error) as error:
            raise LinkError(f"{self._name} has gone: {error}") from error

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        try:
            self._send(data)
        except (OSError, termios.error) as error:
            raise LinkError(f"cannot write to {self._name}: {error}") from error

    def _send(self, data: bytes) -> None:
        """Not pyserial's `write`: it fails also where all bytes went out and this process slept."""
        port, end = self._port.fileno(), monotonic() + WRITE_TIMEOUT
        while data:
            _, ready, _ = select([], [port], [], max(0.0, end - monotonic()))
            if not ready:
                raise TimeoutError(f"nobody has taken the bytes for {WRITE_TIMEOUT:g} s")
            with suppress(BlockingIOError):
                data = data[os.write(port, data) :]

    def close(self) -> None:
        """See `Transport`."""
        try:
            self._port.close()
        except (OSError, termios.error) as error:
            raise LinkError(f"cannot close {self._name}: {error}") from error


def _reason(error: Exception) -> str:
    """Why a port does not open; the system says of a lock only that it was refused."""
    if isinstance(error, OSError) and error.errno == EAGAIN:
        return (
            "another program drives the robot: end it with Ctrl-C, which ramps the robot down, or "
            "press the emergency switch"
        )
    reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
    return (
        f"{reason}; the port is given by --port, port= or the robot file, and found by "
        "`softrobot robot list`"
    )


def load_serial() -> ModuleType:
    """The package pyserial.

    Raises:
        ImportError: It is not installed; says how to.
    """
    with needed("serial ports need pyserial", "robot"):
        import serial
    return serial


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
            record = _RECORD.pack(time, direction, len(part)) + part
            try:
                if self.failure is None and self._file.write(record) < len(record):
                    raise OSError(ENOSPC, strerror(ENOSPC))
            except OSError as error:
                self.failure = error


def read_link_log(path: Path) -> LinkLog:
    """What a file holds, as far as it goes.

    Raises:
        ValueError: It is no such log, damaged, or of another table of messages.
        OSError: It cannot be read.
    """
    data = readable(path).read_bytes()
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
