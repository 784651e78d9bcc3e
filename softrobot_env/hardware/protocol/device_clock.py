"""When a microcontroller measured something, by the host's clock."""

from softrobot_env.hardware.protocol.messages import CLOCK_UNIT

_WRAP = 1 << 32  # where the device's clock wraps, in its units

#: Share of the elapsed time by which the least offset may rise: a ceramic resonator's drift of
#: 0.5 % is no age. As in the firmware.
_DRIFT = 1 / 128


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
            stamp: Its time in units of the wire, which wraps.
            now: [s], when it arrived; times are on this clock.
        """
        passed = 0.0 if self._stamp is None else CLOCK_UNIT * _signed(stamp - self._stamp)
        self._time += passed
        offset = now - self._time
        if self._stamp is None or passed < 0:
            self._offset = offset
        else:
            self._offset = min(offset, self._offset + _DRIFT * passed)
        self._stamp = stamp
        return self._time + self._offset


def _signed(difference: int) -> int:
    """A difference of times that wrap, as a signed number."""
    return (difference + _WRAP // 2) % _WRAP - _WRAP // 2
