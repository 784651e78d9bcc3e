"""NatNet packets as Motive sends them, put together byte by byte, and a server that sends them.

Written from the public description of the bit stream (docs.optitrack.com, NatNet SDK, and its
samples of direct depacketization), not from the decoder that it is to judge.
"""

import socket
import struct
from collections.abc import Mapping
from threading import Thread
from time import monotonic_ns

#: Ticks a second of a server's clock.
FREQUENCY = 10_000_000

#: A body: its number, place [m], quaternion with the real part last, and whether it is tracked.
Body = tuple[int, tuple[float, float, float], tuple[float, float, float, float], bool]


def packet(number: int, content: bytes) -> bytes:
    """A datagram."""
    return number.to_bytes(2, "little") + len(content).to_bytes(2, "little") + content


def server_info(version: tuple[int, int]) -> bytes:
    """What a server answers to a hello."""
    content = b"Motive".ljust(256, b"\0") + bytes([3, 1, 0, 0]) + bytes([*version, 0, 0])
    content += FREQUENCY.to_bytes(8, "little") + (1511).to_bytes(2, "little") + b"\1"
    return packet(1, content + bytes([239, 255, 42, 99]))


def _counted(count: int, content: bytes, version: tuple[int, int]) -> bytes:
    """A section; its size is told since 4.1."""
    size = len(content).to_bytes(4, "little") if version >= (4, 1) else b""
    return count.to_bytes(4, "little") + size + content


def _int(value: int) -> bytes:
    return value.to_bytes(4, "little", signed=True)


def _floats(*values: float) -> bytes:
    return b"".join(struct.pack("<f", value) for value in values)


def _body(body: Body) -> bytes:
    number, place, turn, tracked = body
    error = _floats(2e-4)
    return _int(number) + _floats(*place) + _floats(*turn) + error + bytes([int(tracked), 0])


def frame(
    version: tuple[int, int],
    number: int,
    bodies: list[Body],
    exposed: int,
    sent: int,
    full: bool = True,
    changed: bool = False,
) -> bytes:
    """A frame.

    Args:
        version: Of the packets.
        number: Of the frame.
        bodies: Rigid bodies.
        exposed, sent: Ticks at mid-exposure and at sending.
        full: Whether there also are marker sets, a skeleton, and all else that can be there.
        changed: Whether the tracked models have changed.
    """
    markers = b"all\0" + _int(2) + _floats(1, 2, 3, 4, 5, 6) + b"none\0" + _int(0)
    bone = _body((7, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), True))
    labeled = _int(1 << 16 | 5) + _floats(0.1, 0.2, 0.3, 0.01) + b"\2\0" + _floats(1e-4)
    channels = _int(3) + _int(2) + _int(1) + _floats(9) + _int(3) + _floats(1, 2, 3)
    assets = _int(4) + _int(1) + bone + _int(1)
    assets += _int(1) + _floats(0, 0, 0, 0.01) + b"\0\0" + _floats(0)
    content = _int(number)
    content += _counted(2, markers, version) if full else _counted(0, b"", version)
    content += _counted(1, _floats(7, 8, 9), version) if full else _counted(0, b"", version)
    content += _counted(len(bodies), b"".join(map(_body, bodies)), version)
    sections = [(1, _int(2) + _int(1) + bone)]
    sections += [(1, assets)] if version >= (4, 1) else []
    sections += [(2, labeled + labeled), (1, channels), (1, channels)]
    for count, section in sections:
        content += _counted(count, section, version) if full else _counted(0, b"", version)
    content += _int(0) + _int(0) + struct.pack("<d", number / 240)
    content += b"".join(ticks.to_bytes(8, "little") for ticks in (exposed, exposed + 100, sent))
    content += _int(11) + _int(22) if version >= (4, 1) else b""
    content += bytes([2 if changed else 0, 0])
    return packet(7, content + _int(0))  # ends with a tag of zero


def descriptions(version: tuple[int, int], names: Mapping[str, int]) -> bytes:
    """Descriptions of a marker set, a skeleton, a camera, and rigid bodies by their names."""

    def body(name: str, number: int) -> bytes:
        found = name.encode() + b"\0" + _int(number) + _int(-1) + _floats(0, 0, 0)
        found += _floats(0, 0, 0, 1) if version >= (4, 2) else b""
        found += _int(3) + _floats(*range(9)) + _int(1) + _int(2) + _int(3)
        return found + (b"one\0two\0three\0" if version >= (4, 0) else b"")

    items = [
        (0, b"all\0" + _int(2) + b"a\0b\0"),
        (5, b"camera 1\0" + _floats(*range(7))),
        (2, b"person\0" + _int(2) + _int(2) + body("hip", 1) + body("head", 9)),
        (3, _int(1) + b"no 1\0" + _floats(*range(161)) + _int(0) + _int(1) + _int(1) + b"Fx\0"),
        (4, _int(1) + b"daq\0no 2\0" + _int(0) + _int(1) + _int(2) + b"u\0v\0"),
        *((1, body(name, number)) for name, number in names.items()),
    ]
    content = _int(len(items))
    for kind, item in items:
        content += _int(kind) + (_int(len(item)) if version >= (4, 1) else b"") + item
    return packet(5, content)


class Motive:
    """A server at a port of this machine that answers one client and sends it frames (unicast)."""

    def __init__(self, version: tuple[int, int], names: Mapping[str, int]) -> None:
        self.version, self.names = version, dict(names)
        self._number, self._client = 0, None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        Thread(target=self._answer, daemon=True).start()

    def _answer(self) -> None:
        while True:
            try:
                data, client = self._socket.recvfrom(2048)
            except OSError:
                return
            if data[0] == 0:
                self._socket.sendto(server_info(self.version), client)
                self._client = client
            elif data[0] == 4:
                self._socket.sendto(descriptions(self.version, self.names), client)

    def show(self, bodies: list[Body], age: float = 0.0, **options: bool) -> None:
        """Send a frame that was exposed an age [s] ago."""
        self._number += 1
        now = monotonic_ns() // 100  # ticks
        exposed = now - round(age * FREQUENCY)
        self.send(frame(self.version, self._number, bodies, exposed, now, **options))

    def send(self, data: bytes) -> None:
        """Send a datagram to the client."""
        self._socket.sendto(data, self._client)

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
