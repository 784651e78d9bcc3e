"""The way that bytes go: a serial port."""

import os
import termios
from contextlib import suppress
from errno import EAGAIN
from select import select
from time import monotonic
from types import ModuleType
from typing import Protocol

from softrobot_env.core.extras import install_command
from softrobot_env.hardware.errors import LinkError

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
            raise LinkError(f"cannot open {port}: {_told(error)}") from None

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


def _told(error: Exception) -> str:
    """Why a port does not open; the system says of a lock only that it was refused."""
    if isinstance(error, OSError) and error.errno == EAGAIN:
        return (
            "another program drives the robot: end it with Ctrl-C, which ramps the robot down, or "
            "press the emergency switch"
        )
    reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
    return (
        f"{reason}; the port is told by --port, port= or the robot file, and found by "
        "`softrobot robot list`"
    )


def load_serial() -> ModuleType:
    """The package pyserial.

    Raises:
        ImportError: It is not installed; says how to.
    """
    try:
        import serial
    except ImportError as error:
        raise ImportError(f"serial ports need pyserial: {install_command('robot')}") from error
    return serial
