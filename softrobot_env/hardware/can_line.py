"""A CAN bus as a `transport.Transport`: bytes are the text of serial adapters (slcan, `t00C8...`).

What speaks it itself, such as a CANable, is a serial port; any other adapter is python-can's.
"""

import re
from collections.abc import Iterator

from softrobot_env.core.extras import needed

from .errors import LinkError
from .interface import HardwareFile
from .transport import WRITE_TIMEOUT, SerialTransport, Transport

_RATES = (10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000)  # by number, `S0`
_TEXT = re.compile(rb"([tr])([0-7][0-9a-fA-F]{2})([0-8])((?:[0-9a-fA-F]{2})*)")
_ADAPTER = 115200  # baud, which those on USB ignore
_LONGEST = 64  # bytes of a frame that has not ended


def text(name: int, data: bytes | None = None) -> bytes:
    """A frame of a name of 11 bits; without data a request for it."""
    if data is None:
        return f"r{name:03x}8\r".encode()
    return f"t{name:03x}{len(data)}{data.hex()}\r".encode()


def frames(received: bytearray) -> Iterator[tuple[int, bytes | None]]:
    """Names and data of whole frames, which leave what was received; what is none is dropped."""
    while (end := received.find(b"\r")) >= 0:
        line = bytes(received[:end])
        del received[: end + 1]
        found = _TEXT.fullmatch(line[max(line.rfind(b"t"), line.rfind(b"r"), 0) :])
        if found is not None:
            kind, name, size, data = found.groups()
            if kind == b"r":
                yield int(name, 16), None
            elif len(data) == 2 * int(size):
                yield int(name, 16), bytes.fromhex(data.decode())
    del received[:-_LONGEST]


class CanTransport:
    """An adapter of python-can; see `transport.Transport`."""

    def __init__(self, interface: str, channel: str, baud: int) -> None:
        """Open it; raises LinkError where that fails."""
        with needed("CAN adapters need python-can", "can"):
            import can
        self._can, self._left = can, bytearray()
        try:
            self._bus = can.Bus(channel=channel, interface=interface, bitrate=baud)
        except (can.CanError, OSError, ValueError) as error:
            raise LinkError(f"cannot open {interface}:{channel}: {error}") from None

    def read(self, timeout: float) -> bytes:
        """See `Transport`."""
        found = bytearray()
        try:
            while (one := self._bus.recv(0.0 if found else timeout)) is not None:
                if not (one.is_extended_id or one.is_error_frame):
                    data = None if one.is_remote_frame else bytes(one.data)
                    found += text(one.arbitration_id, data)
        except (self._can.CanError, OSError) as error:
            raise LinkError(f"the CAN bus has gone: {error}") from error
        return bytes(found)

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        self._left += data
        try:
            for name, content in frames(self._left):
                message = self._can.Message(
                    arbitration_id=name,
                    is_extended_id=False,
                    is_remote_frame=content is None,
                    dlc=8 if content is None else len(content),
                    data=content,
                )
                self._bus.send(message, WRITE_TIMEOUT)
        except (self._can.CanError, OSError) as error:
            raise LinkError(f"cannot write to the CAN bus: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        self._bus.shutdown()


def open_can(file: HardwareFile) -> Transport:
    """A port `interface:channel` of python-can, such as `socketcan:can0`, or a serial one."""
    interface, colon, channel = file.port.partition(":")
    if colon:
        return CanTransport(interface, channel, file.baud)
    if file.baud not in _RATES:
        raise ValueError(f"baud of a CAN bus must be one of {_RATES}, got {file.baud}")
    line = SerialTransport(file.port, _ADAPTER)
    line.write(f"C\rS{_RATES.index(file.baud)}\rO\r".encode())
    return line
