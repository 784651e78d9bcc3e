"""A line between host and robot that does harm: for a virtual clock, or between two terminals."""

import os
import random
import select
import threading
import tty
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from time import monotonic

_READ = 4096  # bytes at once
_WAIT = 0.002  # s
_JOIN = 5.0  # s


# ---------------------------------------------------------------------- a line in one direction


@dataclass(frozen=True)
class Harm:
    """What happens to frames, as shares of them from 0 to 1; one thing to each at the most.

    Attributes:
        corrupt: One bit is flipped.
        drop: Nothing arrives.
        truncate: Only the beginning arrives.
        delay: It arrives `held` later; others overtake it.
        duplicate: It arrives at once, and then `copies` times again every `held`.
        held: [s].
        copies: See `duplicate`.
        piece: Most bytes that arrive together, 0 for any number.
        garbage: Bytes from nowhere, every time somebody looks.
    """

    corrupt: float = 0.0
    drop: float = 0.0
    truncate: float = 0.0
    delay: float = 0.0
    duplicate: float = 0.0
    held: float = 0.03
    copies: int = 1
    piece: int = 0
    garbage: int = 0


KINDS = ("corrupt", "drop", "truncate", "delay", "duplicate")


class Line:
    """Carries frames one way, by a clock that the caller reads.

    Attributes:
        harm: What happens to frames from now on.
        done: How often each of `KINDS` has happened.
    """

    def __init__(self, seed: int) -> None:
        self.harm, self.done = Harm(), Counter()
        self._random = random.Random(seed)
        self._rest = b""  # of a frame whose end has not been given yet
        self._waiting: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._due = b""

    def put(self, data: bytes, now: float) -> None:
        """Bytes enter, cut anywhere, at `now` [s]."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        for body in filter(None, frames):
            self._harm(b"\0" + body + b"\0", now)

    def take(self, now: float) -> bytes:
        """Bytes that leave at `now` [s]."""
        while self._waiting and self._waiting[0][0] <= now:
            self._due += heappop(self._waiting)[2]
        size = self._random.randint(1, self.harm.piece) if self.harm.piece else len(self._due)
        piece, self._due = self._due[:size], self._due[size:]
        return piece + self._random.randbytes(self.harm.garbage)

    def _harm(self, frame: bytes, now: float) -> None:
        harm = self.harm
        chances = [getattr(harm, kind) for kind in KINDS]
        (kind,) = self._random.choices((*KINDS, None), [*chances, 1.0 - sum(chances)])
        self.done[kind] += 1
        match kind:
            case "corrupt":
                self._send(self._flipped(frame), now)
            case "truncate":
                self._send(frame[: self._random.randrange(1, len(frame))], now)
            case "delay":
                self._send(frame, now + harm.held)
            case "duplicate":
                for copy in range(harm.copies + 1):
                    self._send(frame, now + copy * harm.held)
            case None:
                self._send(frame, now)

    def _flipped(self, frame: bytes) -> bytes:
        changed = bytearray(frame)
        changed[self._random.randrange(len(frame))] ^= 1 << self._random.randrange(8)
        return bytes(changed)

    def _send(self, data: bytes, due: float) -> None:
        self._count += 1  # keeps the order of what is due together
        heappush(self._waiting, (due, self._count, data))


# ---------------------------------------------------------------------- two pseudo-terminals


class SerialProxy:
    """Two lines between a port for the host and the port of a virtual robot; a context manager.

    Attributes:
        port: Path that the host opens; another one after `plug`.
        to_robot, from_robot: The lines.
        reads: Cleared for a peer that does not take what the host writes.
    """

    def __init__(self, robot_port: str, seed: int = 0) -> None:
        self.to_robot, self.from_robot = Line(seed), Line(seed + 1)
        self.reads = threading.Event()
        self.reads.set()
        self._robot = os.open(robot_port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._host: int | None = None
        self._over, self._pull, self._gone = (threading.Event() for _ in range(3))
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.plug()

    def __enter__(self) -> "SerialProxy":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(_JOIN)
        if self._host is not None:
            self._hang_up()
        os.close(self._robot)

    def plug(self) -> None:
        """Open a new port for the host."""
        master, self._slave = os.openpty()  # the slave stays open, so that a host may come and go
        tty.setraw(self._slave)
        os.set_blocking(master, False)
        self.port = os.ttyname(self._slave)
        self._pull.clear()
        self._gone.clear()
        self._host = master

    def unplug(self) -> None:
        """Hang up on the host."""
        self._pull.set()
        assert self._gone.wait(_JOIN)

    def _serve(self) -> None:
        while not self._over.is_set():
            if self._pull.is_set() and self._host is not None:
                self._hang_up()
            self._pump()

    def _pump(self) -> None:
        """Carry what has come, or wait a little."""
        host = self._host
        listening = [self._robot]
        if host is not None and self.reads.is_set():
            listening.append(host)
        readable, _, _ = select.select(listening, [], [], _WAIT)
        if host in readable:
            self.to_robot.put(os.read(host, _READ), monotonic())
        if self._robot in readable:
            self.from_robot.put(os.read(self._robot, _READ), monotonic())
        _write(self._robot, self.to_robot.take(monotonic()))
        arrived = self.from_robot.take(monotonic())
        if host is not None:
            _write(host, arrived)

    def _hang_up(self) -> None:
        os.close(self._host)
        os.close(self._slave)
        self._host = None
        self._gone.set()


def _write(end: int, data: bytes) -> None:
    """What a reader has no room for is lost, as on a wire."""
    with suppress(BlockingIOError):
        os.write(end, data)
