"""ODrive motors (S1, Pro, Micro) by CAN; messages: the ODrive manual, "CAN Protocol" (CANSimple).

A motor's table is one of messages, each of eight bytes at eight times its number. The motors' own
watchdog is set beforehand with `odrivetool`; when it bites, they let go.
"""

from collections.abc import Mapping, Sequence
from math import pi
from struct import pack, unpack
from typing import ClassVar

from .can_line import frames, text
from .errors import RobotError
from .motor_file import Motor, MotorFile
from .motors import BusPort, MotorBus, MotorFault, MotorState, Register
from .protocol.messages import Fault

VERSION, HEARTBEAT, ADDRESS, SET_STATE, ENCODER, MODE, GOAL = 0, 1, 6, 7, 9, 0xB, 0xC
LIMITS, CURRENT, HEAT, SUPPLY, CLEAR = 0xF, 0x14, 0x15, 0x17, 0x18
_ASKED = ENCODER, CURRENT, HEAT, SUPPLY
IDLE, CLOSED_LOOP = 1, 8  # states
EXPIRED = 24  # error's bit
MESSAGE_BITS = 130  # on the wire; a request for one has 50
_PATIENCE, _BEATS = 20, 50  # ms, and times, that a heartbeat is waited for


class ODrive(MotorBus):
    """Motors with an ODrive each; a gear must hold them where a stop shall not let them go."""

    registers: ClassVar = {
        "id": Register(8 * ADDRESS, 1),
        "error": Register(8 * HEARTBEAT, 4),
        "torque": Register(8 * HEARTBEAT + 4, 1),
        "position": Register(8 * ENCODER, 4, 2 * pi, True),
        "goal": Register(8 * GOAL, 4, 2 * pi, True),
        "speed": Register(8 * LIMITS, 4, 2 * pi, True),
        "goal_current": Register(8 * LIMITS + 4, 4, 1.0, True),
        "current": Register(8 * CURRENT + 4, 4, 1.0, True),
        "temperature": Register(8 * HEAT, 4, 1.0, True),
        "voltage": Register(8 * SUPPLY, 4, 1.0, True),
    }
    first, last, turn, overhead = 8 * HEARTBEAT, 8 * SUPPLY + 7, 1, 0
    bits: ClassVar = {
        **dict.fromkeys((0, 1, 2, 4, 5, 6, 26, 27, 28, 30), (MotorFault.BROKEN, "reports a fault")),
        3: (MotorFault.BROKEN, "reports that its encoder fails"),
        **dict.fromkeys((8, 9), (Fault.BROWN_OUT, "reports a wrong voltage")),
        **dict.fromkeys((10, 11, 17), (Fault.FORCE, "reports too much current")),
        12: (Fault.FORCE, "reports an overload"),
        **dict.fromkeys((13, 14), (MotorFault.OVERHEATED, "reports that it is too hot")),
        **dict.fromkeys((15, 16), (MotorFault.BROKEN, "reports that it went too fast or far")),
        EXPIRED: (Fault.WATCHDOG, "has let go: nobody spoke to it in time"),
        25: (Fault.ESTOP, "reports an emergency stop"),
    }
    models: ClassVar = {4: ("ODrive Pro", 1.0), 5: ("ODrive S1", 1.0), 6: ("ODrive Micro", 1.0)}

    def __init__(self, file: MotorFile, port: BusPort) -> None:
        super().__init__(file, port)
        self._left, self._seen, self._on = bytearray(), dict[tuple[int, int], bytes](), False

    @classmethod
    def coded(cls, register: Register, value: float) -> bytes:
        """See `MotorBus`: numbers with a sign are floats, torque is a state."""
        if register == cls.registers["torque"]:
            return bytes([CLOSED_LOOP if value else IDLE])
        if register.signed:
            return pack("<f", value / register.unit)
        return super().coded(register, value)

    @classmethod
    def decoded(cls, register: Register, data: bytes) -> float:
        """See `MotorBus`."""
        if register == cls.registers["torque"]:
            return float(data[0] == CLOSED_LOOP)
        if register.signed:
            return register.unit * unpack("<f", data)[0]
        return super().decoded(register, data)

    @classmethod
    def period(cls, file: MotorFile) -> float:
        """See `MotorBus`."""
        return len(file.motors) * (MESSAGE_BITS + len(_ASKED) * (MESSAGE_BITS + 50)) / file.baud

    def _listen(self) -> None:
        self._left += self.port.readPort(2**16)
        for name, data in frames(self._left):
            if data is not None and len(data) == 8:
                self._seen[name >> 5, name & 31] = data

    def _ask(self, wanted: Sequence[tuple[int, int]]) -> None:
        """Request messages, and wait for them."""
        self.port.setPacketTimeoutMillis(0.0)
        self._listen()  # what has come before is older
        for key in wanted:
            self._seen.pop(key, None)
        self.port.writePort(b"".join(text(n << 5 | c) for n, c in wanted))
        self.port.setPacketTimeout(len(wanted) * (MESSAGE_BITS + 50) // 10)
        while not self._seen.keys() >= set(wanted) and not self.port.isPacketTimeout():
            self._listen()

    def ping(self, number: int) -> int | None:
        """See `MotorBus`."""
        self._ask([(number, VERSION)])
        return self._seen.get((number, VERSION), b"\0\0")[1] or None

    def read_bytes(self, number: int, address: int, size: int) -> bytes | None:
        """See `MotorBus`."""
        self._ask([(number, address // 8)])
        data = self._seen.get((number, address // 8))
        return None if data is None else data[address % 8 :][:size]

    def write_table(self, number: int, address: int, data: bytes) -> str:
        """See `MotorBus`; nobody confirms it."""
        self.write_all(address, {number: data})
        return ""

    def write_all(self, address: int, data: Mapping[int, bytes]) -> None:
        """See `MotorBus`."""
        told = (
            text(number << 5 | address // 8, one.ljust(8, b"\0")) for number, one in data.items()
        )
        self.port.writePort(b"".join(told))

    def read_all(self, numbers: Sequence[int], address: int, size: int) -> dict[int, bytes]:
        """See `MotorBus`; heartbeats come by themselves."""
        self._ask([(number, command) for number in numbers for command in _ASKED])
        found = {}
        for number in numbers:
            parts = {c: self._seen.get((number, c)) for c in (HEARTBEAT, *_ASKED)}
            if None not in parts.values():
                table = bytearray(address + size)
                for command, part in parts.items():
                    table[8 * command : 8 * command + 8] = part
                found[number] = bytes(table[address:])
        return found

    def _state(self, number: int, data: bytes) -> MotorState:
        state = super()._state(number, data)  # the watchdog also bites motors that rest
        return state if self._on else state._replace(errors=state.errors & ~(1 << EXPIRED))

    def prepare(self) -> dict[str, str]:
        """See `MotorBus`; RobotError for what an ODrive cannot do, too."""
        if self.file.mode != "extended_position" or self.file.at_stop == "hold":
            raise RobotError("an ODrive needs mode 'extended_position' and at_stop 'relax'")
        if not all(motor.max_current for motor in self.file.motors):
            raise RobotError("an ODrive needs max_current_a, which it gets with its speed")
        return super().prepare()

    def settings(self, motor: Motor, ampere: float) -> dict[str, float]:
        """See `MotorBus`; they cannot be read."""
        return {}

    def _set_up(self, motor: Motor) -> None:
        speed = self.file.slew / motor.spool_radius / (2 * pi)
        self.write_all(8 * MODE, {motor.id: pack("<2I", 3, 1)})  # position, as it is told
        self.write_all(8 * LIMITS, {motor.id: pack("<2f", speed, motor.max_current)})

    def power(self, on: bool) -> None:
        """See `MotorBus`; heartbeats confirm it, ten a second, and questions feed watchdogs."""
        numbers, wanted = [motor.id for motor in self.file.motors], CLOSED_LOOP if on else IDLE
        for number in numbers:
            beat = self._seen.pop((number, HEARTBEAT), b"\0" * 8)
            if on and int.from_bytes(beat[:4], "little") == 1 << EXPIRED:
                self.restart(number)
        self._on = on
        self.write_all(8 * SET_STATE, dict.fromkeys(numbers, pack("<I", wanted)))
        for _ in range(_BEATS):
            self.port.writePort(b"".join(text(number << 5 | ENCODER) for number in numbers))
            self.port.setPacketTimeoutMillis(_PATIENCE)
            while not self.port.isPacketTimeout():
                self._listen()
            states = {n: self._seen.get((n, HEARTBEAT), bytes(8))[4] for n in numbers}
            if set(states.values()) == {wanted}:
                return
        number = next(n for n in numbers if states[n] != wanted)
        raise RobotError(f"motor {number} does not take torque = {on:d}: state {states[number]}")

    def restart(self, number: int) -> None:
        """See `MotorBus`."""
        self.write_table(number, 8 * CLEAR, b"")
