"""Motors on a bus that are simulated: what a `virtual_robot.VirtualRobot` runs in a board's place.

Tables, framing, time on the wire, return delay and faults are as the makers describe them. A motor
without torque stays where it is, as a geared one does under a soft robot's pull.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, pi

import numpy as np
from numpy import ndarray

from .dynamixel import MODES, Dynamixel
from .feetech import Feetech
from .motor_file import Motor, MotorFile
from .motors import MotorBus
from .virtual_robot import Plant

PING, READ, WRITE, REBOOT, SYNC_READ, SYNC_WRITE = 1, 2, 3, 8, 0x82, 0x83
BROADCAST = 0xFE

_LARGEST = 4096  # bytes of a host that no packet begins in
_USUAL_CONSTANT = 1.0  # N m / A, of a file that says none
_FASTEST = 10.0  # rad/s, of a motor that is given no speed
_REBOOT = 0.2  # s
_SHORTEST, _LONGEST = 5e-4, 0.05  # s, of a step: between answers motors need none
_ROOM, _SUPPLY = 25.0, 12.0  # °C, V

#: Data-range and access errors of an answer.
RANGE, ACCESS = 4, 7


@dataclass
class VirtualMotor:
    """A motor of an emulated bus; tests change what it suffers.

    Attributes:
        motor: As it really is: its zero may be another than a host believes.
        table: Its registers.
        length: [m], what it has wound.
        silent: Whether it says nothing.
        stuck: Whether it no longer turns.
        temperature, supply: [°C], [V].
        errors: Bits that are set by force.
        away: Until when [s] it restarts.
    """

    motor: Motor
    table: bytearray = field(default_factory=lambda: bytearray(256))
    length: float = 0.0
    silent: bool = False
    stuck: bool = False
    temperature: float = _ROOM
    supply: float = _SUPPLY
    errors: int = 0
    away: float = -inf
    heard: float = -inf
    turns: float = 0.0  # [rad] that it has forgotten
    was_on: bool = False


class VirtualMotors(ABC):
    """A bus of motors; see `virtual_robot.Device`.

    Attributes:
        kind: Their registers.
        motors: In the order of the file.
        applied: (n,) [m], where the tendons are driven.
        noise: Share of bytes to and from the host that arrive damaged.
        due: [s], when the next bytes leave.
    """

    kind: type[MotorBus]
    model: int
    width: int  # bytes of an address

    def __init__(self, file: MotorFile, seed: int = 0) -> None:
        """Motors as a file says, at length zero and without torque."""
        self.file, self.noise, self._rng = file, 0.0, np.random.default_rng([seed, 2])
        self.motors = [VirtualMotor(motor) for motor in file.motors]
        self._tendon = [file.tendon_names.index(motor.tendon) for motor in file.motors]
        self._received, self._sent = bytearray(), []
        self._now, self._free, self._turned = 0.0, 0.0, 0.0
        self.applied, self.due = np.zeros(len(file.tendon_names)), inf
        for one in self.motors:
            one.table[:2] = self.model.to_bytes(2, "little")
            self.put(one, "id", one.motor.id)
            self.put(one, "return_delay", 5e-4)
            self.put(one, "temperature_limit", 80)

    def put(self, one: VirtualMotor, name: str, value: float) -> None:
        """Set a register, in SI units; of one that the kind has not nothing comes."""
        register = self.kind.registers.get(name)
        if register is None:
            return
        at = register.address
        one.table[at : at + register.size] = self.kind.coded(register, value)

    def get(self, one: VirtualMotor, name: str) -> float:
        """A register, in SI units; zero of one that the kind has not."""
        register = self.kind.registers.get(name)
        if register is None:
            return 0.0
        at = register.address
        return self.kind.decoded(register, bytes(one.table[at : at + register.size]))

    @property
    def command(self) -> ndarray:
        """See `Device`: without torque motors stay by themselves."""
        return self.applied

    @property
    def powered(self) -> bool:
        """See `Device`."""
        return any(self.get(one, "torque") for one in self.motors)

    # ------------------------------------------------------------ the bus

    @abstractmethod
    def packets(self, data: bytearray) -> Iterator[tuple[int, int, bytes, int]]:
        """Number, instruction, parameters and size of whole packets, which leave `data`."""

    @abstractmethod
    def status(self, number: int, error: int, data: bytes) -> bytes:
        """An answer."""

    def receive(self, data: bytes) -> None:
        """See `Device`."""
        self._received += self._damaged(data)
        del self._received[:-_LARGEST]

    def transmit(self) -> bytes:
        """See `Device`."""
        out = b""
        while self._sent and self._sent[0][0] <= self._now:
            out += self._sent.pop(0)[1]
        self.due = self._sent[0][0] if self._sent else inf
        return self._damaged(out)

    def _damaged(self, data: bytes) -> bytes:
        if not self.noise or not data:
            return data
        hit = self._rng.random(len(data)) < self.noise
        return bytes(
            b ^ int(self._rng.integers(1, 256)) if h else b for b, h in zip(data, hit, strict=True)
        )

    def _answer(self, ones: list[VirtualMotor], error: int, data: list[bytes]) -> None:
        """Send what motors of one number answer; two at once pull each other's bits down."""
        talking = [(one, d) for one, d in zip(ones, data, strict=True) if not one.silent]
        said = [self.status(self._number(one), error | self._alert(one), d) for one, d in talking]
        if not said:
            return
        packet = said[0]
        for other in said[1:]:
            packet = bytes(a & b for a, b in zip(packet, other, strict=False))
        delay = self.get(talking[0][0], "return_delay")
        self._free = max(self._free, self._now) + delay + 10 * len(packet) / self.file.baud
        self._sent.append((self._free, packet))
        self.due = self._sent[0][0]

    def _alert(self, one: VirtualMotor) -> int:
        """What an answer's error says of the motor's state."""
        return 0

    def _number(self, one: VirtualMotor) -> int:
        return int(self.get(one, "id"))

    def _called(self, number: int) -> list[VirtualMotor]:
        there = [one for one in self.motors if one.away <= self._now]
        return [one for one in there if number in (BROADCAST, self._number(one))]

    def _obey(self, number: int, instruction: int, params: bytes) -> None:
        width, called = self.width, self._called(number)
        for one in called:
            one.heard = self._now
        address = int.from_bytes(params[:width], "little")
        if instruction == PING and number != BROADCAST:
            self._answer(called, 0, [self._introduction(one) for one in called])
        elif instruction == READ:
            size = int.from_bytes(params[width : 2 * width], "little")
            self._answer(called, 0, [bytes(one.table[address : address + size]) for one in called])
        elif instruction == WRITE:
            error = max((self._write(one, address, params[width:]) for one in called), default=0)
            self._answer(called, error, [b""] * len(called))
        elif instruction == REBOOT:
            self._answer(called, 0, [b""] * len(called))
            for one in called:
                self.reboot(one)
        elif instruction == SYNC_READ:
            size = int.from_bytes(params[width : 2 * width], "little")
            for wanted in params[2 * width :]:
                ones = self._called(wanted)
                self._answer(ones, 0, [bytes(one.table[address : address + size]) for one in ones])
        elif instruction == SYNC_WRITE:
            size = int.from_bytes(params[width : 2 * width], "little")
            rest = params[2 * width :]
            for at in range(0, len(rest), size + 1):
                for one in self._called(rest[at]):
                    self._write(one, address, rest[at + 1 : at + 1 + size])

    def _introduction(self, one: VirtualMotor) -> bytes:
        """Data of the answer to a ping."""
        return b""

    def _write(self, one: VirtualMotor, address: int, data: bytes) -> int:
        """Write to a motor's table; the error that it answers with."""
        torque = self.kind.registers["torque"].address
        if address < torque and self.get(one, "torque") and self._is_kept(address):
            return ACCESS
        if self.get(one, "watchdog") < 0 and address == self.kind.registers["goal"].address:
            return RANGE
        one.table[address : address + len(data)] = data
        return 0

    def _is_kept(self, address: int) -> bool:
        """Whether a register survives a loss of power, and is locked under torque."""
        return True

    def reboot(self, one: VirtualMotor) -> None:
        """What a motor does when it is told to, or its voltage dips: it forgets turns and goals."""
        one.away, one.errors = self._now + _REBOOT, 0
        torque = self.kind.registers["torque"].address
        one.table[torque:] = bytes(len(one.table) - torque)
        one.turns += 2 * pi * np.floor(self._angle(one) / (2 * pi))

    # ------------------------------------------------------------ the motors

    def _angle(self, one: VirtualMotor) -> float:
        return one.motor.angle(one.length) - one.turns

    def run(self, now: float, plant: Plant) -> None:
        """See `Device`."""
        self._now = now
        for number, instruction, params, size in self.packets(self._received):
            self._free = max(self._free, now) + 10 * size / self.file.baud
            self._obey(number, instruction, params)
        if now - self._turned >= _SHORTEST:
            self._advance(min(now - self._turned, _LONGEST), plant)
            self._turned = now

    def _advance(self, passed: float, plant: Plant) -> None:
        """Let the motors turn for a while [s], and measure."""
        length, tension = plant.length, plant.tension
        for k, one in zip(self._tendon, self.motors, strict=True):
            self._turn(one, passed, float(tension[k]))
            self._measure(one, float(length[k]), float(tension[k]))
        wound = [one.length for one in self.motors]
        self.applied = np.bincount(self._tendon, wound) / np.bincount(self._tendon)

    def _turn(self, one: VirtualMotor, passed: float, tension: float) -> None:
        """Follow the goal for a while, if torque is on and the watchdog has not bitten."""
        limit = self.get(one, "temperature_limit")
        if one.temperature >= limit > 0:
            one.errors |= 1 << 2
        on = bool(self.get(one, "torque")) and not one.errors and one.away <= self._now
        if on and not one.was_on:
            self.put(one, "goal", self._angle(one))
            one.heard = self._now
        one.was_on = on
        if not on:
            self.put(one, "torque", 0)
            return
        watchdog = self.get(one, "watchdog")
        if watchdog > 0 and self._now - one.heard > watchdog:
            self.put(one, "watchdog", -self.kind.registers["watchdog"].unit)
            self.put(one, "goal", self._angle(one))
        goal = one.motor.length(self._goal(one) + one.turns)
        way = (self.get(one, "speed") or _FASTEST) * passed * one.motor.spool_radius
        step = min(max(goal - one.length, -way), way)
        most = self._most_current(one)
        if one.stuck or (most and step > 0 and self._current(one, tension) >= most):
            return
        one.length += step

    def _goal(self, one: VirtualMotor) -> float:
        """[rad], where it goes: within the range that it keeps itself."""
        goal = self.get(one, "goal")
        if not self._has_range(one):
            return goal
        unit = self.kind.registers["goal"].unit
        return min(max(goal, unit * self.get(one, "minimum")), unit * self.get(one, "maximum"))

    def _has_range(self, one: VirtualMotor) -> bool:
        return self.get(one, "maximum") > 0

    def _current(self, one: VirtualMotor, tension: float) -> float:
        """[A] that a tension [N] asks of a motor; two share it."""
        shared = len(self.file.of_tendon(one.motor.tendon))
        constant = one.motor.torque_constant or _USUAL_CONSTANT
        return tension * one.motor.spool_radius / constant / shared

    def _most_current(self, one: VirtualMotor) -> float:
        """[A] at which the motor no longer pulls; 0: no limit."""
        return self.get(one, "goal_current") * self.kind.models[self.model][1]

    def _measure(self, one: VirtualMotor, length: float, tension: float) -> None:
        own = one.motor.angle(length) - one.turns if self._is_alone(one) else self._angle(one)
        self.put(one, "position", own)
        ampere = self.kind.models[self.model][1]
        current = one.motor.direction * self._current(one, tension) * (1 if one.was_on else 0)
        self.put(one, "current", min(current / ampere, 30000) if ampere else 0)
        self.put(one, "voltage", one.supply)
        self.put(one, "temperature", one.temperature)
        self.put(one, "error", one.errors)

    def _is_alone(self, one: VirtualMotor) -> bool:
        return len(self.file.of_tendon(one.motor.tendon)) == 1


class VirtualDynamixel(VirtualMotors):
    """Dynamixel X motors, protocol 2.0."""

    kind, model, width = Dynamixel, 1020, 2

    def packets(self, data: bytearray) -> Iterator[tuple[int, int, bytes, int]]:
        """See `VirtualMotors`: ff ff fd 00, number, size (2), instruction, ..., CRC (2)."""
        while (at := data.find(b"\xff\xff\xfd\x00")) >= 0:
            del data[:at]
            if len(data) < 7:
                return
            size = 7 + int.from_bytes(data[5:7], "little")
            if size > 1024 or size < 10:
                del data[:4]
                continue
            if len(data) < size:
                return
            packet = bytes(data[:size])
            if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                del data[:4]
                continue
            del data[:size]
            body = packet[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            yield packet[4], body[0], body[1:], size

    def status(self, number: int, error: int, data: bytes) -> bytes:
        """See `VirtualMotors`."""
        body = (bytes([0x55, error]) + data).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet = (
            b"\xff\xff\xfd\x00" + bytes([number]) + (len(body) + 2).to_bytes(2, "little") + body
        )
        return packet + crc16(packet).to_bytes(2, "little")

    def _introduction(self, one: VirtualMotor) -> bytes:
        return bytes(one.table[:2]) + b"\x2e"

    def _alert(self, one: VirtualMotor) -> int:
        return 0x80 if one.errors else 0

    def _has_range(self, one: VirtualMotor) -> bool:
        return self.get(one, "mode") == MODES["position"]


def _remainder(byte: int) -> int:
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


_REMAINDERS = [_remainder(byte) for byte in range(256)]


def crc16(data: bytes) -> int:
    """CRC-16 of protocol 2.0: polynomial 0x8005, from 0, highest bit first."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ _REMAINDERS[crc >> 8 ^ byte]
    return crc


class VirtualFeetech(VirtualMotors):
    """Feetech STS motors."""

    kind, model, width = Feetech, 777, 1

    def __init__(self, file: MotorFile, seed: int = 0) -> None:
        super().__init__(file, seed)
        for one in self.motors:
            one.table[:2], one.table[3:5] = b"\x03\x09", self.model.to_bytes(2, "little")
            one.table[55] = 1

    def packets(self, data: bytearray) -> Iterator[tuple[int, int, bytes, int]]:
        """See `VirtualMotors`: ff ff, number, size, instruction, ..., sum."""
        while (at := data.find(b"\xff\xff")) >= 0:
            del data[:at]
            if len(data) < 4:
                return
            size = 4 + data[3]
            if data[2] == 0xFF or size < 6:
                del data[:1]
                continue
            if len(data) < size:
                return
            packet = bytes(data[:size])
            if ~sum(packet[2:-1]) & 0xFF != packet[-1]:
                del data[:2]
                continue
            del data[:size]
            yield packet[2], packet[4], packet[5:-1], size

    def status(self, number: int, error: int, data: bytes) -> bytes:
        """See `VirtualMotors`."""
        body = bytes([number, len(data) + 2, error]) + data
        return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])

    def _alert(self, one: VirtualMotor) -> int:
        return one.errors & 0x7F

    def _is_kept(self, address: int) -> bool:
        return False  # its lock decides, which the driver opens

    def _write(self, one: VirtualMotor, address: int, data: bytes) -> int:
        if address < 40 and one.table[55]:
            return 0  # accepted, and not kept
        return super()._write(one, address, data)
