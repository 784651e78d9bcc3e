"""A recorded robot instead of a real one."""

from collections import deque
from threading import Event

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.protocol.messages import Arm, Hello
from softrobot_env.hardware.transport import Direction, LinkLog


class ReplayTransport:
    """Gives a recorded robot's bytes to a driver that sends what the recorded host sent.

    Bytes arrive once the driver has written as often as the host had. Give `clock` and `draw` to
    the driver, so that it lives in the recorded time and draws the recorded numbers.
    """

    def __init__(self, recording: LinkLog) -> None:
        self._chunks = deque(recording.chunks)
        self._written, self._wrote = 0, Event()
        self._time = self._chunks[0].time if self._chunks else 0.0
        messages = [message for _, message, _ in recording.messages()]
        hellos = [message.nonce for message in messages if isinstance(message, Hello)]
        arms = [message.session for message in messages if isinstance(message, Arm)]
        self._drawn = {32: deque(dict.fromkeys(hellos)), 16: deque(dict.fromkeys(arms))}

    def clock(self) -> float:
        """Time [s] of the recording that has been reached."""
        return self._time

    def draw(self, bits: int) -> int:
        """Next recorded number of that many bits.

        Raises:
            LinkError: There are no more.
        """
        if not self._drawn.get(bits):
            raise LinkError("the recording has no further session")
        return self._drawn[bits].popleft()

    def read(self, timeout: float) -> bytes:
        """See `Transport`.

        Raises:
            LinkError: The driver has written something after the end of the recording.
        """
        self._wrote.clear()
        while self._chunks and self._chunks[0].direction == Direction.TO_ROBOT and self._written:
            self._written -= 1
            self._time = self._chunks.popleft().time
        if not self._chunks and self._written:
            raise LinkError("the recording is over")
        if not self._chunks or self._chunks[0].direction == Direction.TO_ROBOT:
            self._wrote.wait(timeout)
            return b""
        chunk = self._chunks.popleft()
        self._time = chunk.time
        return chunk.data

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        self._written += 1
        self._wrote.set()

    def close(self) -> None:
        """Nothing to free."""
