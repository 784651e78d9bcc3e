"""Rigid bodies of OptiTrack's Motive, which it sends as NatNet packets of versions 3 and 4.

The layouts are those of the depacketization samples of NaturalPoint's NatNet SDK. Of the package
`natnet` (0.3.0) nothing is used: its thread dies of the first packet that is cut short or comes
before the server has said its version, and it reserves as much memory as a damaged count asks for.
"""

import socket
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from select import select
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import check_argument

from .errors import LinkError
from .tip import POLL, Port, PoseTip, TipMeasurement, listen, matrix_of, unit_quaternion

# Numbers of messages.
_CONNECT, _SERVER_INFO, _REQUEST_DESCRIPTIONS, _DESCRIPTIONS = 0, 1, 4, 5
_FRAME, _KEEP_ALIVE = 7, 10

_ASKED_EVERY = 1.0  # s
_RESTARTED = 1.0  # s without a newer frame, after which numbers may begin anew

Version = tuple[int, int]

#: With these, a section says how many bytes it has.
_SIZED: Version = (4, 1)


class _Columns(tuple):
    """A layout of lists as long as a number before them says: all of one part, then the next."""


# A layout is a sequence of formats of `struct`, of _TEXT, which ends with a zero, of `_Columns`,
# and of other tuples, which are layouts that come as often as a number before them says.
_TEXT = "text"
_BODY = "i3f4ffh"  # number, position, quaternion, error, flags
_CHANNELS = ("i", (("f",),))

_BODIES = 2  # the section of rigid bodies in a frame
_BODY_KIND = 1  # the kind of their descriptions

_TRACKED, _CHANGED = 1, 2  # flags of a body, and of a frame


def _sections(version: Version) -> list[Sequence]:
    """Layouts of a frame's sections."""
    assets = [("i", (_BODY,), ("i3ffhf",))] if version >= _SIZED else []
    markers, skeletons = [(_TEXT, ("3f",)), ("3f",)], ("i", (_BODY,))
    labeled = ("i3ffhf",)
    return [*markers, (_BODY,), skeletons, *assets, labeled, _CHANNELS, _CHANNELS]


def _descriptions(version: Version) -> dict[int, Sequence]:
    """Kind of description -> layout."""
    markers = _Columns(("3f", "i", _TEXT) if version >= (4, 0) else ("3f", "i"))
    body = (_TEXT, "2i3f" if version < (4, 2) else "2i7f", markers)
    return {
        0: (_TEXT, (_TEXT,)),  # marker sets
        _BODY_KIND: body,
        2: (_TEXT, "i", body),  # skeletons
        3: ("i", _TEXT, "2f3f144f12f2i", (_TEXT,)),  # force plates
        4: ("i", _TEXT, _TEXT, "2i", (_TEXT,)),  # devices
        5: (_TEXT, "3f4f"),  # cameras
    }


class Server(NamedTuple):
    """What a server says of itself: version of its packets, and ticks a second of its clock."""

    version: Version
    frequency: int


class Frame(NamedTuple):
    """A frame.

    Attributes:
        number: Counts up.
        bodies: Number of a rigid body -> its numbers, as in `_BODY`.
        age: [s] from the middle of the exposure until it was sent.
        changed: Whether there are other bodies than before.
    """

    number: int
    bodies: dict[int, tuple]
    age: float
    changed: bool


class _Reader:
    """Reads a packet from its begin; ValueError where it ends too early."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def numbers(self, form: str) -> tuple:
        """Numbers, little-endian."""
        form = f"<{form}"
        begin, self._at = self._at, self._at + struct.calcsize(form)
        if self._at > len(self._data):
            raise ValueError("a packet ends too early")
        return struct.unpack_from(form, self._data, begin)

    def text(self) -> str:
        """A text that ends with a zero."""
        begin, end = self._at, self._data.index(b"\0", self._at)
        self._at = end + 1
        return self._data[begin:end].decode()

    def count(self, skipped: int = 0) -> int:
        """How often something comes, each time with a byte or more; some bytes are skipped."""
        (count,) = self.numbers(f"I{skipped}x")
        if count > len(self._data) - self._at:
            raise ValueError(f"a packet cannot hold {count}")
        return count

    def take(self, layout: Sequence) -> list:
        """What a layout describes: numbers of each format, texts, and lists of these."""
        found: list = []
        for part in layout:
            if part == _TEXT:
                found.append(self.text())
            elif isinstance(part, str):
                found.append(self.numbers(part))
            elif isinstance(part, _Columns):
                count = self.count()
                found += [self.take([column] * count) for column in part]
            else:
                found.append([self.take(part) for _ in range(self.count())])
        return found


def message(data: bytes) -> tuple[int, bytes]:
    """Number and content of a datagram; ValueError for one that is cut short."""
    number, size = _Reader(data).numbers("2H")
    if size > len(data) - 4:
        raise ValueError(f"{len(data) - 4} of {size} bytes")
    return number, data[4 : 4 + size]


def server_of(content: bytes) -> Server:
    """What a server says of itself.

    Raises:
        LinkError: Its packets are not of version 3 or 4.
    """
    major, minor, _, _, frequency = _Reader(content).numbers("260x4BQ")
    if major not in (3, 4):
        raise LinkError(f"packets of NatNet {major}.{minor} are not understood, 3.0 to 4.x are")
    return Server((major, minor), frequency)


def frame_of(content: bytes, server: Server) -> Frame:
    """What a frame says of rigid bodies; ValueError for one that is damaged."""
    reader, version = _Reader(content), server.version
    (number,) = reader.numbers("i")
    skipped = 4 if version >= _SIZED else 0
    sections = [
        [reader.take(part) for _ in range(reader.count(skipped))] for part in _sections(version)
    ]
    # Time code, seconds, and ticks at exposure, at arrival from the cameras, and at sending.
    *_, exposed, received, sent = reader.numbers("2id3Q")
    *_, flags = reader.numbers("2ih" if version >= _SIZED else "h")
    taken = exposed or received  # cameras without a shared clock know no exposure
    age = (sent - taken) / server.frequency if taken and server.frequency else 0.0
    bodies = {numbers[0]: numbers for (numbers,) in sections[_BODIES]}
    return Frame(number, bodies, age, bool(flags & _CHANGED))


def names_of(content: bytes, version: Version) -> dict[str, int]:
    """Names of rigid bodies -> their numbers, by a packet of descriptions.

    Raises:
        ValueError, KeyError: It is damaged.
    """
    reader, layouts, found = _Reader(content), _descriptions(version), {}
    for _ in range(reader.count()):
        (kind,) = reader.numbers("i")
        size = reader.numbers("I")[0] if version >= _SIZED else None
        if size is not None and kind != _BODY_KIND:
            reader.numbers(f"{size}x")
            continue
        described = reader.take(layouts[kind])
        if kind == _BODY_KIND:
            name, (number, *_), *_ = described
            found[name] = number
    return found


class NatNetTip(PoseTip):
    """Rigid bodies that Motive tracks, by name or number.

    Of several bodies on the head, or at the base, the first that is tracked counts. Frames in which
    there is none, that are older than one before, or that are damaged are counted in `refused`, as
    are packets of other programs and computers.

    Attributes:
        ready: Whether the server has said its version, and what bodies it has now.
    """

    def __init__(
        self,
        server: str = "127.0.0.1",
        multicast: str = "239.255.42.99",
        host: str = "0.0.0.0",
        port: int = 1510,
        data_port: int = 1511,
        **bodies: Any,
    ) -> None:
        """Connect.

        Args:
            server: Address of Motive's computer.
            multicast: Group to which it sends frames; empty for unicast.
            host: Address of this computer in its network.
            port, data_port: At which it takes commands, and of the group.
            **bodies: See `PoseTip`; Motive's world is the tracker's own frame.

        Raises:
            ValueError: No number of a port, or as of `PoseTip`.
            OSError: A port is taken, or there is no such address.
        """
        super().__init__(**bodies)
        for name, number in {"port": port, "data_port": data_port}.items():
            check_argument(name, number, Port)
        self._address = socket.gethostbyname(server), port
        self._server: Server | None = None
        self._names: Mapping[str, int] = {}
        self.ready = False
        self._asked = self._came = -_ASKED_EVERY
        self._last: int | None = None
        self._sockets = [listen(host, 0)]
        try:
            if multicast:
                self._sockets.append(listen("", data_port, join=(multicast, host)))
        except OSError:
            self._free()
            raise
        self._thread.start()

    def _free(self) -> None:
        for each in self._sockets:
            each.close()

    def _next(self) -> TipMeasurement | None:
        self._ask()
        ready, _, _ = select(self._sockets, [], [], POLL)
        if not ready:
            raise TimeoutError
        data, (sender, _) = ready[0].recvfrom(2**16)
        now = monotonic()
        if sender != self._address[0]:
            raise ValueError(f"from {sender}")
        number, content = message(data)
        if number == _SERVER_INFO:
            self._server = server_of(content)
            self._asked = -_ASKED_EVERY
        elif number == _DESCRIPTIONS and self._server is not None:
            self._names, self.ready = names_of(content, self._server.version), True
            for name in (*self._head, *self._base):
                if self._number_of(name) is None:
                    known = ", ".join(self._names) or "none"
                    raise LinkError(f"Motive has no rigid body {name!r}; it has {known}")
        elif number == _FRAME:
            return self._measured(content, now)
        return None

    def _ask(self) -> None:
        """Say hello, stay alive, and ask for names that are not known, each second."""
        now = monotonic()
        if now - self._asked < _ASKED_EVERY:
            return
        self._asked = now
        wanted = [(_KEEP_ALIVE, b"")]
        if self._server is None:
            wanted.append((_CONNECT, b"Ping"))
        elif not self.ready:
            wanted.append((_REQUEST_DESCRIPTIONS, b""))
        for number, text in wanted:
            with suppress(OSError):  # a network that is down may come back
                packed = struct.pack("<2H", number, len(text) + 1) + text + b"\0"
                self._sockets[0].sendto(packed, self._address)

    def _number_of(self, name: str) -> int | None:
        return self._names.get(name, int(name) if name.isdecimal() else None)

    def _measured(self, content: bytes, now: float) -> TipMeasurement:
        if self._server is None:
            raise ValueError("a frame before the version is known")
        frame = frame_of(content, self._server)
        self.ready = self.ready and not frame.changed
        late = self._last is not None and frame.number < self._last
        if frame.number == self._last or (late and now - self._came < _RESTARTED):
            raise ValueError(f"frame {frame.number} after {self._last}")
        self._last, self._came = frame.number, now
        head = self._pose(frame, self._head)
        base = self._pose(frame, self._base) if self._base else None
        return self._seen(now, frame.age, head, base)

    def _pose(self, frame: Frame, bodies: Mapping[str, ndarray]) -> ndarray:
        """(4, 4) of what carries bodies, in Motive's world; ValueError where none is tracked."""
        from scipy.spatial.transform import Rotation  # takes time to load

        for name, mounted in bodies.items():
            numbers = frame.bodies.get(self._number_of(name))
            if numbers is not None and numbers[-1] & _TRACKED:
                pose = matrix_of("a body", numbers[1:4])
                turn = Rotation.from_quat(unit_quaternion(numbers[4:8]))
                pose[:3, :3] = turn.as_matrix()
                return pose @ np.linalg.inv(mounted)
        raise ValueError("no body is tracked")
