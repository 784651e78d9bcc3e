"""Dynamixel X motors (protocol 2.0) by `dynamixel-sdk`; addresses: e-manual, control table of X."""

from collections.abc import Mapping, Sequence
from math import ceil, pi
from typing import Any, ClassVar

from softrobot_env.core.extras import needed

from .motor_file import Motor, MotorFile
from .motors import BusPort, MotorBus, MotorFault, Register
from .protocol.messages import Fault

_COUNT = 2 * pi / 4096  # rad
_RPM = 0.229 * 2 * pi / 60  # rad/s

#: Value of the register "mode" by that of the file.
MODES = {"position": 3, "extended_position": 4, "current_position": 5}

#: Instruction of a reboot.
REBOOT = 8

_MILLIAMPERE, _LARGE = 1e-3, 2.69e-3


class Dynamixel(MotorBus):
    """Motors of the X series; their bus watchdog stops them where they are."""

    registers: ClassVar = {
        "id": Register(7, 1),
        "return_delay": Register(9, 1, 2e-6),
        "mode": Register(11, 1),
        "temperature_limit": Register(31, 1),
        "current_limit": Register(38, 2),
        "maximum": Register(48, 4),
        "minimum": Register(52, 4),
        "torque": Register(64, 1),
        "error": Register(70, 1),
        "watchdog": Register(98, 1, 0.02, True),
        "goal_current": Register(102, 2, signed=True),
        "speed": Register(112, 4, _RPM),
        "goal": Register(116, 4, _COUNT, True),
        "current": Register(126, 2, signed=True),
        "position": Register(132, 4, _COUNT, True),
        "voltage": Register(144, 2, 0.1),
        "temperature": Register(146, 1),
    }
    first, last, turn, overhead = 64, 146, 4096, 11
    bits: ClassVar = {
        0: (Fault.BROWN_OUT, "reports a wrong voltage"),
        2: (MotorFault.OVERHEATED, "reports that it is too hot"),
        3: (MotorFault.BROKEN, "reports that its encoder fails"),
        4: (MotorFault.BROKEN, "reports an electrical shock"),
        5: (Fault.FORCE, "reports an overload"),
    }
    models: ClassVar = {
        1020: ("XM430-W350", _LARGE),
        1030: ("XM430-W210", _LARGE),
        1120: ("XM540-W270", _LARGE),
        1130: ("XM540-W150", _LARGE),
        1060: ("XL430-W250", 0.0),  # measures load, not current
        1190: ("XL330-M077", _MILLIAMPERE),
        1200: ("XL330-M288", _MILLIAMPERE),
        1210: ("XC330-M181", _MILLIAMPERE),
        1220: ("XC330-M288", _MILLIAMPERE),
        1230: ("XC330-T181", _MILLIAMPERE),
        1240: ("XC330-T288", _MILLIAMPERE),
    }

    def __init__(self, file: MotorFile, port: BusPort) -> None:
        super().__init__(file, port)
        with needed("Dynamixel motors need dynamixel-sdk", "robot"):
            from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler
        self._packets, self._good = Protocol2PacketHandler(), COMM_SUCCESS

    def ping(self, number: int) -> int | None:
        """See `MotorBus`."""
        model, result, _ = self._packets.ping(self.port, number)
        return model if result == self._good else None

    def read_bytes(self, number: int, address: int, size: int) -> bytes | None:
        """See `MotorBus`."""
        data, result, _ = self._packets.readTxRx(self.port, number, address, size)
        return bytes(data) if result == self._good and len(data) == size else None

    def write_table(self, number: int, address: int, data: bytes) -> str:
        """See `MotorBus`."""
        result, error = self._packets.writeTxRx(self.port, number, address, len(data), [*data])
        if result != self._good:
            return self._packets.getTxRxResult(result)
        return self._packets.getRxPacketError(error & 0x7F)  # bit 7 is of the error register

    def read_all(self, numbers: Sequence[int], address: int, size: int) -> dict[int, bytes]:
        """See `MotorBus`; the library's group loses all motors behind a silent one."""
        self._packets.syncReadTx(self.port, address, size, [*numbers], len(numbers), False)
        found = {}
        for _ in numbers:
            self.port.is_using = True
            packet, result = self._packets.rxPacket(self.port, False)
            if result == self._good:
                found[packet[4]] = bytes(packet[9 : 9 + size])
            elif self.port.isPacketTimeout():
                break
        return found

    def write_all(self, address: int, data: Mapping[int, bytes]) -> None:
        """See `MotorBus`."""
        flat = [x for number, one in data.items() for x in (number, *one)]
        size = len(flat) // len(data) - 1
        self._packets.syncWriteTxOnly(self.port, address, size, flat, len(flat))

    def restart(self, number: int) -> None:
        """See `MotorBus`."""
        self._packets.reboot(self.port, number)

    def settings(self, motor: Motor, ampere: float) -> dict[str, float]:
        """See `MotorBus`; the mode comes before what it sets back.

        Motors keep a range only in the mode `position`.
        """
        wanted: dict[str, Any] = {
            "return_delay": 0.0,
            "mode": MODES[self.file.mode],
            "temperature_limit": motor.max_temperature,
            "speed": _RPM * ceil(self.file.slew / motor.spool_radius / _RPM),
        }
        if self.file.mode == "position":
            wanted |= self.limits(motor)
        if motor.max_current and ampere:
            wanted["current_limit"] = round(motor.max_current / ampere)
            if self.file.mode == "current_position":
                wanted["goal_current"] = wanted["current_limit"]
        return wanted
