"""What a host notes of a link: set-points in flight, the device's clock, and counters."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from softrobot_env.hardware.errors import UnansweredError
from softrobot_env.hardware.protocol.messages import CLOCK_UNIT, Reason

#: Most set-points that may be in flight without an answer.
MOST_IN_FLIGHT = 3

#: Steps back in the count of messages that mean a late or doubled one; more, that it began anew.
_LATEST = 4

#: Share of the elapsed time by which the least offset may rise: a ceramic resonator's drift of
#: 0.5 % is no age. As in the firmware.
_DRIFT = 1 / 128


def newer(count: int, than: int, wrap: int = 1 << 16) -> int:
    """How many steps a count that wraps is ahead of another one; negative if it is behind."""
    return (count - than + wrap // 2) % wrap - wrap // 2


class InFlight:
    """Set-points of a session that were sent and not answered yet.

    Attributes:
        echoed: Sequence number of the newest set-point that the robot has accepted.
    """

    def __init__(self) -> None:
        self.echoed: int | None = None
        self._sent: dict[int, float] = {}  # sequence number -> when it was sent

    def check_room(self, now: float, ttl: float) -> None:
        """Refuse one more at `now` [s]; those older than `ttl` [s] will never be followed.

        Raises:
            UnansweredError: `MOST_IN_FLIGHT` are unanswered.
        """
        self._sent = {seq: sent for seq, sent in self._sent.items() if now - sent <= ttl}
        if len(self._sent) >= MOST_IN_FLIGHT:
            raise UnansweredError(
                f"the robot has not answered the last {MOST_IN_FLIGHT} set-points"
            )

    def add(self, seq: int, now: float) -> None:
        """A set-point was sent at `now` [s]."""
        self._sent[seq] = now

    def echo(self, seq: int, now: float) -> float | None:
        """Time [s] from sending to this echo at `now` [s]; None if it is not the first one."""
        sent = self._sent.get(seq)
        if sent is None:
            return None
        self._sent = {s: t for s, t in self._sent.items() if newer(s, seq) > 0}
        self.echoed = seq
        return now - sent

    def refuse(self, seq: int) -> None:
        """The robot refused a set-point."""
        self._sent.pop(seq, None)


class DeviceClock:
    """Offset of the host's clock from the device's, from messages that arrive.

    The quickest message so far tells the offset; what comes later than that has waited somewhere.
    """

    def __init__(self) -> None:
        self._stamp: int | None = None  # of the newest message, in units of the device
        self._time = self._offset = 0.0  # s: of the device since the first message; least offset

    def taken(self, stamp: int, now: float) -> float:
        """When a message of the device was sent, at the latest [s].

        A stamp that is older than the one before belongs to a clock that has started again.

        Args:
            stamp: Its time in units of the device, which wraps at 2**32.
            now: [s], when it arrived; times are on this clock.
        """
        passed = 0.0 if self._stamp is None else CLOCK_UNIT * newer(stamp, self._stamp, 1 << 32)
        self._time += passed
        offset = now - self._time
        if self._stamp is None or passed < 0:
            self._offset = offset
        else:
            self._offset = min(offset, self._offset + _DRIFT * passed)
        self._stamp = stamp
        return self._time + self._offset


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
            up to the robot file's `state_delay`.
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

    def note(self, what: str, duration: float) -> None:
        """Note a duration [s], "round_trip" or "delay"."""
        longest = max(getattr(self, f"longest_{what}"), duration)
        vars(self).update({what: duration, f"longest_{what}": longest})

    def as_dict(self) -> dict[str, Any]:
        """The counters by name."""
        shown = {name: value for name, value in vars(self).items() if not name.startswith("_")}
        return shown | {"nacks": dict(self.nacks)}
