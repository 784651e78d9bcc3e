"""A line between host and robot that does harm, by a clock that its user reads."""

import random
from collections import Counter
from dataclasses import dataclass
from heapq import heappop, heappush


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

    def packet(self, data: bytes, now: float) -> None:
        """A whole packet of another protocol enters at `now` [s]."""
        self._harm(data, now)

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
