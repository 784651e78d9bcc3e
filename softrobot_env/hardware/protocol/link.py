"""How well the link works."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from softrobot_env.hardware.protocol.messages import Reason

_WRAP = 1 << 16

#: Steps back in the count of messages that mean a late or doubled one; more, that it began anew.
_LATEST = 4


def newer(seq: int, than: int) -> int:
    """How many steps a sequence number is ahead of another one; negative if it is behind."""
    return (seq - than + _WRAP // 2) % _WRAP - _WRAP // 2


@dataclass
class LinkCounters:
    """Counters of one connection.

    Attributes:
        sent, received: Messages.
        lost: Messages of the robot that never arrived.
        old: Messages of the robot that arrived twice or out of order, and were ignored.
        crc_errors, frame_errors: Frames that arrived damaged here.
        device_crc_errors, device_frame_errors: Frames that arrived damaged there.
        nacks: Refusals by reason.
        round_trip, longest_round_trip: [s] from a set-point to its echo, which the board delays by
            the robot file's `state_delay`.
        delay, longest_delay: [s] that the last state arrived later than the quickest, and the
            longest of these: what waits in buffers on its way.
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    old: int = 0
    crc_errors: int = 0
    frame_errors: int = 0
    device_crc_errors: int = 0
    device_frame_errors: int = 0
    nacks: Counter = field(default_factory=Counter)
    round_trip: float | None = None
    longest_round_trip: float = 0.0
    delay: float = 0.0
    longest_delay: float = 0.0
    _last: int | None = field(default=None, repr=False)

    def note_arrival(self, seq: int) -> bool:
        """Count a message by its number; False if it is old and must be ignored."""
        ahead = 1 if self._last is None else newer(seq, self._last)
        if -_LATEST < ahead <= 0:
            self.old += 1
            return False
        self.received += 1
        self.lost += max(0, ahead - 1)
        self._last = seq
        return True

    def note_refusal(self, reason: int) -> None:
        """Count a refusal."""
        known = reason in list(Reason)
        self.nacks[Reason(reason).name.lower() if known else str(reason)] += 1

    def note_round_trip(self, duration: float) -> None:
        """Note how long [s] an echo took."""
        self.round_trip = duration
        self.longest_round_trip = max(self.longest_round_trip, duration)

    def note_delay(self, duration: float) -> None:
        """Note how long [s] a state message was under way beyond the quickest."""
        self.delay = duration
        self.longest_delay = max(self.longest_delay, duration)

    def as_dict(self) -> dict[str, Any]:
        """The counters by name."""
        shown = {name: value for name, value in vars(self).items() if not name.startswith("_")}
        return shown | {"nacks": dict(self.nacks)}
