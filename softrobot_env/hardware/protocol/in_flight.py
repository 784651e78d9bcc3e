"""Set-points under way."""

from softrobot_env.hardware.errors import UnansweredError
from softrobot_env.hardware.protocol.link import newer

#: Most set-points that may be under way without an answer.
MOST_IN_FLIGHT = 3


class Flight:
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
