"""Feetech STS motors by `ftservo-python-sdk` (module `scservo_sdk`); addresses: STS memory table.

They have no watchdog: when the host dies they end the step they were given, and hold.
"""

from collections.abc import Mapping, Sequence
from math import ceil, pi
from typing import ClassVar

from softrobot_env.core.extras import needed

from .errors import RobotError
from .motor_file import Motor, MotorFile
from .motors import BusPort, MotorBus, MotorFault, Register
from .protocol.messages import Fault

_COUNT = 2 * pi / 4096  # rad
_AMPERE = 6.5e-3  # A in a count

#: Farthest goal [counts] of a motor that turns many times: its range has no ends.
_FARTHEST = 30719


class Feetech(MotorBus):
    """Motors of the STS series (STS3215, STS3032, ...)."""

    registers: ClassVar = {
        "id": Register(5, 1),
        "return_delay": Register(7, 1, 2e-6),
        "minimum": Register(9, 2),
        "maximum": Register(11, 2),
        "temperature_limit": Register(13, 1),
        "current_limit": Register(28, 2),
        "mode": Register(33, 1),
        "torque": Register(40, 1),
        "goal": Register(42, 2, _COUNT, True),
        "speed": Register(46, 2, _COUNT),
        "lock": Register(55, 1),
        "position": Register(56, 2, _COUNT, True),
        "voltage": Register(62, 1, 0.1),
        "temperature": Register(63, 1),
        "error": Register(65, 1),
        "current": Register(69, 2, signed=True),
    }
    first, last, turn, overhead = 40, 70, 4096, 6
    bits: ClassVar = {
        0: (Fault.BROWN_OUT, "reports a wrong voltage"),
        1: (MotorFault.BROKEN, "reports that its encoder fails"),
        2: (MotorFault.OVERHEATED, "reports that it is too hot"),
        3: (Fault.FORCE, "reports too much current"),
        5: (Fault.FORCE, "reports an overload"),
    }
    models: ClassVar = {
        777: ("STS3215", _AMPERE),
        1289: ("STS3032", _AMPERE),
        2825: ("STS3250", _AMPERE),
    }

    def __init__(self, file: MotorFile, port: BusPort) -> None:
        super().__init__(file, port)
        if file.mode == "current_position":
            raise RobotError("Feetech STS motors have no mode 'current_position'")
        with needed("Feetech motors need ftservo-python-sdk", "robot"):
            from scservo_sdk import COMM_SUCCESS, GroupSyncRead, sms_sts
        self._packets, self._good, self._group = sms_sts(port), COMM_SUCCESS, GroupSyncRead

    @classmethod
    def coded(cls, register: Register, value: float) -> bytes:
        """See `MotorBus`; the highest bit is the sign."""
        counts, top = round(value / register.unit), 1 << 8 * register.size - 1
        if register.signed and abs(counts) > _FARTHEST:
            raise OverflowError(f"{counts} counts are beyond {_FARTHEST} to either side")
        if register.signed and counts < 0:
            counts = -counts | top
        return counts.to_bytes(register.size, "little")

    @classmethod
    def decoded(cls, register: Register, data: bytes) -> float:
        """See `MotorBus`."""
        counts, top = int.from_bytes(data, "little"), 1 << 8 * register.size - 1
        return register.unit * (top - counts if register.signed and counts & top else counts)

    def ping(self, number: int) -> int | None:
        """See `MotorBus`."""
        data = self.read_bytes(number, 3, 2)  # the library's ping fails with a late answer
        return None if data is None else int.from_bytes(data, "little")

    def read_bytes(self, number: int, address: int, size: int) -> bytes | None:
        """See `MotorBus`."""
        data, result, _ = self._packets.readTxRx(number, address, size)
        return bytes(data) if result == self._good and len(data) == size else None

    def write_table(self, number: int, address: int, data: bytes) -> str:
        """See `MotorBus`; errors of its state are not of writing."""
        result, _ = self._packets.writeTxRx(number, address, len(data), [*data])
        return "" if result == self._good else self._packets.getTxRxResult(result)

    def read_all(self, numbers: Sequence[int], address: int, size: int) -> dict[int, bytes]:
        """See `MotorBus`."""
        group = self._group(self._packets, address, size)
        for number in numbers:
            group.addParam(number)
        group.txRxPacket()
        return {n: bytes(data[1:]) for n, data in group.data_dict.items() if data}

    def write_all(self, address: int, data: Mapping[int, bytes]) -> None:
        """See `MotorBus`."""
        flat = [x for number, one in data.items() for x in (number, *one)]
        size = len(flat) // len(data) - 1
        self._packets.syncWriteTxOnly(address, size, flat, len(flat))

    def _set_up(self, motor: Motor) -> None:
        self._put(motor.id, "lock", 0)
        super()._set_up(motor)
        self._put(motor.id, "lock", 1)

    def settings(self, motor: Motor, ampere: float) -> dict[str, float]:
        """See `MotorBus`; a motor turns many times where both ends of its range are zero."""
        ends = {"minimum": 0, "maximum": 0}
        wanted = {
            "return_delay": 0.0,
            **(self.limits(motor) if self.file.mode == "position" else ends),
            "temperature_limit": motor.max_temperature,
            "mode": 0,
            "speed": _COUNT * ceil(self.file.slew / motor.spool_radius / _COUNT),
        }
        if motor.max_current:
            wanted["current_limit"] = round(motor.max_current / _AMPERE)
        return wanted
