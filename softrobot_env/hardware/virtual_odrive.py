"""ODrive motors that are simulated; see `virtual_motors`. Their watchdog is that of the file."""

from collections.abc import Iterator

from .can_line import frames, text
from .motor_file import MotorFile
from .odrive import CLEAR, CLOSED_LOOP, EXPIRED, HEARTBEAT, MESSAGE_BITS, SET_STATE, ODrive
from .virtual_motors import VirtualMotor, VirtualMotors
from .virtual_robot import Plant

_BEAT = 0.1  # s
_REQUEST = 32  # added to the number of a message that is asked for
_VERSION = bytes([2, 5, 2, 0, 0, 6, 11, 0])  # protocol, board, firmware


class VirtualODrive(VirtualMotors):
    """ODrive S1, each with a motor."""

    kind, model, width = ODrive, 5, 1

    def __init__(self, file: MotorFile, seed: int = 0) -> None:
        super().__init__(file, seed)
        self._beat = 0.0
        for one in self.motors:
            one.table[:8] = _VERSION
            self.put(one, "torque", 0)

    def packets(self, data: bytearray) -> Iterator[tuple[int, int, bytes, int]]:
        """See `VirtualMotors`."""
        for name, content in frames(data):
            request, size = (_REQUEST, 5) if content is None else (0, MESSAGE_BITS // 10)
            yield name >> 5, name & 31 | request, content or b"", size

    def status(self, number: int, error: int, data: bytes) -> bytes:
        """See `VirtualMotors`: a message, whose number is `error`."""
        return text(number << 5 | error, data)

    def _obey(self, number: int, instruction: int, params: bytes) -> None:
        called = self._called(number)
        for one in called:
            one.heard = self._now
            if instruction == SET_STATE:
                self.put(one, "torque", params[0] == CLOSED_LOOP and not one.errors)
            elif instruction == CLEAR:
                one.errors = 0
            elif instruction < _REQUEST:
                one.table[8 * instruction : 8 * instruction + len(params)] = params
        if instruction >= _REQUEST:
            self._send(called, instruction - _REQUEST)

    def _send(self, ones: list[VirtualMotor], command: int) -> None:
        """A message of motors of one number; different ones at once destroy each other."""
        said = {bytes(one.table[8 * command : 8 * command + 8]) for one in ones if not one.silent}
        if len(said) == 1:
            self._free = max(self._free, self._now) + MESSAGE_BITS / self.file.baud
            self._sent.append((self._free, self.status(self._number(ones[0]), command, said.pop())))
            self.due = self._sent[0][0]

    def run(self, now: float, plant: Plant) -> None:
        """See `Device`."""
        super().run(now, plant)
        if now - self._beat >= _BEAT:
            self._beat = now
            for one in self.motors:
                self._send([one] if one.away <= now else [], HEARTBEAT)

    def _damaged(self, data: bytes) -> bytes:
        """Frames are lost whole: adapters check them."""
        if not self.noise:
            return data
        lost = 1 - (1 - self.noise) ** (MESSAGE_BITS // 10)
        return b"".join(s for s in data.splitlines(True) if self._rng.random() > lost)

    def reboot(self, one: VirtualMotor) -> None:
        """See `VirtualMotors`."""
        number = self._number(one)
        super().reboot(one)
        self.put(one, "id", number)
        self.put(one, "torque", 0)

    def _turn(self, one: VirtualMotor, passed: float, tension: float) -> None:
        if self._now - one.heard > self.file.watchdog:
            one.errors |= 1 << EXPIRED
        super()._turn(one, passed, tension)
