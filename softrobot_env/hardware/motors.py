"""Motors on a bus: what a kind of them has to say (`MotorBus`), and the robot that they drive.

The host keeps range, speed, current, temperature and voltage within what the file says. Motors have
no program of ours: when the host dies, those with a watchdog of their own stop where they are, and
others end the step they were given, at most a control period's way, and hold.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from math import ceil, floor, pi
from time import monotonic, sleep
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import ndarray

from .errors import FaultInfo, LinkError, RefusedError, RobotError, RobotFaultError
from .interface import Hardware, Reading
from .motor_file import Motor, MotorFile
from .protocol.messages import DeviceState, Fault, Reason
from .protocol.session import LinkCounters
from .transport import Transport

_TRIES = 3  # of what is asked or written once, and noise may have hit
_PATIENT = 0.05  # s, latency that is allowed for then


class MotorFault(IntEnum):
    """Why motors stop that no board reports; others are a `Fault`."""

    OVERHEATED = 101
    SILENT = 102
    BROKEN = 103  # an error of the motor's own parts
    RESTARTED = 104  # its torque is off although nobody switched it off


class Register(NamedTuple):
    """A number in a motor's control table: address, bytes, SI in one count, and its sign."""

    address: int
    size: int
    unit: float = 1.0
    signed: bool = False


class MotorState(NamedTuple):
    """What a motor says: angle [rad], current [A], [V], [°C], torque on, error bits, watchdog."""

    angle: float
    current: float
    voltage: float
    temperature: float
    powered: bool
    errors: int
    expired: bool


class BusPort:
    """A transport as the vendors' libraries know a port; it waits where theirs spins."""

    def __init__(
        self,
        transport: Transport,
        baud: int,
        latency: float,
        now: Callable[[], float] = monotonic,
    ) -> None:
        """A port at a rate, whose answers take `latency` [s] longer than their bytes."""
        self._transport, self.baudrate, self._latency, self._now = transport, baud, latency, now
        self._bytes, self._end = bytearray(), 0.0
        self.is_open, self.is_using = True, False

    @contextmanager
    def patient(self) -> Iterator[None]:
        """Wait longer for answers within it, for what is done once."""
        before, self._latency = self._latency, max(self._latency, _PATIENT)
        try:
            yield
        finally:
            self._latency = before

    def free(self) -> None:
        """Give up what a signal or an error has interrupted."""
        self.is_using = False

    def getBaudRate(self) -> int:
        """Its rate."""
        return self.baudrate

    def clearPort(self) -> None:
        """Forget what has come."""
        self._bytes.clear()
        self._transport.read(0.0)

    def writePort(self, packet: Iterable[int]) -> int:
        """Send a packet; its size."""
        data = bytes(packet)
        self._transport.write(data)
        return len(data)

    def readPort(self, length: int) -> bytes:
        """At most `length` bytes, those that come until the packet's time is over."""
        if len(self._bytes) < length:
            self._bytes += self._transport.read(max(0.0, self._end - self._now()))
        data = bytes(self._bytes[:length])
        del self._bytes[:length]
        return data

    def setPacketTimeout(self, length: int) -> None:
        """Wait for so many bytes from now on."""
        self._end = self._now() + 10 * length / self.baudrate + 2 * self._latency + 2e-3

    def setPacketTimeoutMillis(self, duration: float) -> None:
        """Wait for a time [ms] from now on."""
        self._end = self._now() + 1e-3 * duration

    def isPacketTimeout(self) -> bool:
        """Whether that is over."""
        return self._now() >= self._end


class MotorBus(ABC):
    """A kind of motors: its control table, and how its vendor's library is called.

    Registers that every kind has are torque, goal, speed, position, current, voltage, temperature
    and error; a watchdog is optional.

    Attributes:
        registers: By name.
        first, last: Addresses of the block that is read in every period.
        turn: Counts of position in a turn.
        overhead: Bytes of an answer besides its data.
        bits: Bit of the error register -> what it means.
    """

    registers: ClassVar[Mapping[str, Register]]
    first: ClassVar[int]
    last: ClassVar[int]
    turn: ClassVar[int]
    overhead: ClassVar[int]
    bits: ClassVar[Mapping[int, tuple[IntEnum, str]]]
    models: ClassVar[Mapping[int, tuple[str, float]]]  # number -> name, [A] per count

    def __init__(self, file: MotorFile, port: BusPort) -> None:
        self.file, self.port = file, port
        self._ampere = dict.fromkeys((motor.id for motor in file.motors), 0.0)

    @abstractmethod
    def ping(self, number: int) -> int | None:
        """Model of the motor of a number, None if nobody answers."""

    @abstractmethod
    def read_bytes(self, number: int, address: int, size: int) -> bytes | None:
        """Bytes of a motor's table, None without a whole answer."""

    @abstractmethod
    def write_table(self, number: int, address: int, data: bytes) -> str:
        """Write to a motor's table; why it failed, or nothing."""

    @abstractmethod
    def read_all(self, numbers: Sequence[int], address: int, size: int) -> dict[int, bytes]:
        """Bytes of those motors' tables that answered whole."""

    @abstractmethod
    def write_all(self, address: int, data: Mapping[int, bytes]) -> None:
        """Write to motors' tables, which do not answer."""

    @abstractmethod
    def settings(self, motor: Motor, ampere: float) -> dict[str, float]:
        """What a motor keeps itself, by register in SI units; `ampere` [A] per count or 0."""

    def restart(self, number: int) -> None:
        """Clear a motor's errors as far as it can be asked to."""
        self._put(number, "torque", 0)

    # ------------------------------------------------------------ numbers

    @classmethod
    def coded(cls, register: Register, value: float) -> bytes:
        """The bytes of a value in SI units; raises OverflowError where they do not hold it."""
        return round(value / register.unit).to_bytes(
            register.size, "little", signed=register.signed
        )

    @classmethod
    def decoded(cls, register: Register, data: bytes) -> float:
        """The value in SI units of bytes."""
        return register.unit * int.from_bytes(data, "little", signed=register.signed)

    def _get(self, number: int, name: str) -> float:
        register = self.registers[name]
        for _ in range(_TRIES):
            data = self.read_bytes(number, register.address, register.size)
            if data is not None:
                return self.decoded(register, data)
        raise LinkError(f"motor {number} does not answer when its {name} is read")

    def _put(self, number: int, name: str, value: float) -> None:
        register, error = self.registers[name], ""
        for _ in range(_TRIES):
            error = self.write_table(number, register.address, self.coded(register, value))
            if not error:
                return
        raise RobotError(f"motor {number} does not take {name} = {value:g}: {error}")

    # ------------------------------------------------------------ all motors

    def prepare(self) -> dict[str, str]:
        """Find every motor and set it up; torque goes off only where something has to be set.

        Raises:
            LinkError: One does not answer.
            RobotError: One does not take its settings, or does not measure current.
        """
        about = {}
        for motor in self.file.motors:
            model = next(filter(None, (self.ping(motor.id) for _ in range(_TRIES))), None)
            if model is None:
                raise LinkError(self._missing(motor))
            name, ampere = self._named(model)
            if not ampere and (motor.max_current or self.file.mode == "current_position"):
                raise RobotError(
                    f"motor {motor.id}, {name}, has no current in A: max_current_a = 0"
                )
            self._ampere[motor.id] = ampere
            about[f"motor {motor.id}"] = f"{name}, tendon {motor.tendon}"
        self.guard(False)
        for motor in self.file.motors:
            self._set_up(motor)
        return about

    def _set_up(self, motor: Motor) -> None:
        wanted = self.settings(motor, self._ampere[motor.id])
        for name, value in wanted.items():
            unit = self.registers[name].unit
            if abs(self._get(motor.id, name) - value) > 0.51 * unit:
                self._put(motor.id, "torque", 0)
                self._put(motor.id, name, value)

    def _missing(self, motor: Motor) -> str:
        return (
            f"motor {motor.id} (tendon {motor.tendon}) does not answer at {self.file.port} with "
            f"{self.file.baud} baud, or two motors have its number; those that answer: "
            f"{', '.join(map(str, self.present())) or 'none'}"
        )

    def present(self) -> dict[int, str]:
        """Numbers that answer, of the first twenty, and their models' names."""
        found = {number: self.ping(number) for number in range(1, 21)}
        return {k: self._named(model)[0] for k, model in found.items() if model is not None}

    def _named(self, model: int) -> tuple[str, float]:
        return self.models.get(model, (f"model {model}", 0.0))

    def limits(self, motor: Motor) -> dict[str, float]:
        """A motor's range within a turn, in whole counts, as it keeps it itself."""
        ends = [
            motor.angle(x) / self.registers["goal"].unit for x in (motor.minimum, motor.maximum)
        ]
        return {"minimum": floor(min(ends)), "maximum": min(ceil(max(ends)), self.turn - 1)}

    def power(self, on: bool) -> None:
        """Switch all torque on or off; every motor is asked, also where another one fails."""
        failed = []
        for motor in self.file.motors:
            try:
                self._put(motor.id, "torque", int(on))
            except RobotError as error:
                failed.append(error)
        if failed:
            raise failed[0]

    def guard(self, on: bool) -> None:
        """Switch the motors' own watchdogs on or off, where they have any; it also revives them."""
        register = self.registers.get("watchdog")
        if register is None:
            return
        for value in [0.0, max(self.file.watchdog, register.unit)][: 1 + on]:
            data = self.coded(register, value)
            self.write_all(register.address, {motor.id: data for motor in self.file.motors})

    def write(self, angles: Iterable[float]) -> None:
        """Goals [rad] of all motors."""
        goal = self.registers["goal"]
        pairs = zip(self.file.motors, angles, strict=True)
        self.write_all(goal.address, {motor.id: self.coded(goal, angle) for motor, angle in pairs})

    def read(self) -> list[MotorState | None]:
        """What every motor says; None of those that did not answer whole."""
        numbers = [motor.id for motor in self.file.motors]
        size = self.last - self.first + 1
        found = self.read_all(numbers, self.first, size)
        return [
            self._state(n, found[n]) if len(found.get(n, b"")) == size else None for n in numbers
        ]

    def _state(self, number: int, data: bytes) -> MotorState:
        def value(name: str) -> float:
            register = self.registers[name]
            at = register.address - self.first
            return self.decoded(register, data[at : at + register.size])

        watchdog = self.registers.get("watchdog")
        return MotorState(
            angle=value("position"),
            current=value("current") * self._ampere[number],
            voltage=value("voltage"),
            temperature=value("temperature"),
            powered=bool(value("torque")),
            errors=int(value("error")),
            expired=watchdog is not None and value("watchdog") < 0,
        )

    @classmethod
    def period(cls, file: MotorFile) -> float:
        """Least time [s] that a set-point and all answers take on the bus."""
        sizes = cls.last - cls.first + 1 + cls.overhead, 1 + cls.registers["goal"].size
        return 10 * len(file.motors) * sum(sizes) / file.baud


class MotorRobot(Hardware):
    """A robot whose tendons are wound by motors on a bus.

    It talks to them in the caller's thread, and in no other: nothing keeps them alive.
    """

    robot: MotorFile

    def __init__(
        self,
        robot: MotorFile,
        transport: Transport,
        kind: type[MotorBus],
        now: Callable[[], float] = monotonic,
        wait: Callable[[float], None] = sleep,
    ) -> None:
        """Nothing is sent yet.

        Args:
            robot: Calibration and limits.
            transport: The way to the motors; `close` closes it.
            kind: Of motors.
            now, wait: The clock [s], and what waits so long [s].

        Raises:
            ValueError: The bus is too slow for the control period.
        """
        super().__init__(robot, transport)
        needed = kind.period(robot)
        if needed > robot.control_period:
            raise ValueError(
                f"{len(robot.motors)} motors take {1e3 * needed:.0f} ms at {robot.baud} baud, more "
                f"than control_period_ms = {1e3 * robot.control_period:g}"
            )
        self._now, self._sleep = now, wait
        self._bus = kind(robot, BusPort(transport, robot.baud, robot.latency, now))
        self.reading: Reading | None = None
        self.fault: FaultInfo | None = None
        self._state, self._about, self._counters = DeviceState.DISARMED, {}, LinkCounters()
        self._powered = self._on = False
        index = {name: k for k, name in enumerate(robot.tendon_names)}
        self._tendon = np.array([index[motor.tendon] for motor in robot.motors])
        self._shares = np.bincount(self._tendon)
        self._zero = np.array([motor.zero for motor in robot.motors])
        self._radius = np.array([m.direction * m.spool_radius for m in robot.motors])
        low, high, rest = np.array(robot.tendons).T
        self._low, self._high, self._rest, self._applied = low, high, rest, rest.copy()
        self._sent = 0.0
        self._since: dict[tuple, float] = {}  # what is wrong -> since when [s]
        self.measures_force = all(motor.torque_constant for motor in robot.motors)

    def now(self) -> float:
        """See `Hardware`."""
        return self._now()

    def wait_until(self, due: float) -> None:
        """See `Hardware`."""
        self._sleep(max(0.0, due - self._now()))

    @property
    def link(self) -> dict[str, Any]:
        """See `Hardware`."""
        return self._counters.as_dict()

    @property
    def about(self) -> dict[str, str]:
        """See `Hardware`."""
        return self._about

    def connect(self, timeout: float = 2.0) -> dict[str, str]:
        """See `Hardware`."""
        if self._closed:
            raise LinkError("this driver is closed")
        self._guard.install()
        self.fault, self._state, self._since = None, DeviceState.DISARMED, {}
        with self._bus.port.patient():
            self._about = self._bus.prepare()
        self._zero = np.array([motor.zero for motor in self.robot.motors])
        self._look_until(self.now() + timeout)
        if self.robot.mode != "position":
            self._unwrap()
            self._look_until(self.now() + timeout)
        self._applied = self.reading.length.copy()
        self._powered = self._on  # a host before may have left them so
        return self._about

    def _unwrap(self) -> None:
        """Add whole turns where a range has less than one: motors forget them without power."""
        middle = ((self._low + self._high) / 2)[self._tendon]
        short = (self._high - self._low)[self._tendon] < 2 * pi * abs(self._radius)
        off = (self._lengths - middle) / (2 * pi * self._radius)
        self._zero = self._zero + np.where(short, 2 * pi * np.rint(off), 0.0)

    def arm(self, timeout: float = 1.0) -> None:
        """See `Hardware`."""
        if self.fault is not None:
            raise RobotFaultError(self.fault)
        if not self._about or self._state != DeviceState.DISARMED:
            raise RobotError(f"arm() needs a robot that is connected, it is {self._state.name}")
        self._look_until(self.now() + timeout)
        inside = np.clip(self.reading.length, self._low, self._high)
        if np.abs(inside - self.reading.length).max() > self.robot.arm_window:
            raise RefusedError("ARM", Reason.FAR)
        self._applied = inside
        self._write()
        with self._bus.port.patient():
            self._bus.power(True)
        self._powered = True
        self._bus.guard(True)
        self._write()  # a motor may take its position for its goal as its torque comes on
        self._state, self._since = DeviceState.RUNNING, {}

    def check_target(self, length: ndarray) -> None:
        """See `Hardware`."""
        length = np.asarray(length, float)
        if length.shape != self._low.shape or not np.isfinite(length).all():
            raise ValueError(f"a set-point needs {len(self._low)} finite lengths [m], got {length}")
        for name, x, low, high in zip(
            self.robot.tendon_names, length, self._low, self._high, strict=True
        ):
            if not low - 1e-9 <= x <= high + 1e-9:
                raise ValueError(
                    f"tendon {name}: {1e3 * x:.2f} mm is outside its range of {1e3 * low:.2f} to "
                    f"{1e3 * high:.2f} mm"
                )

    def exchange(self, length: ndarray, deadline: float) -> Reading | None:
        """See `Hardware`."""
        self.check_target(length)
        self._refuse_faults()
        if self._state != DeviceState.RUNNING:
            raise RobotError(f"a set-point needs an armed robot, it is {self._state.name.lower()}")
        silence = self.now() - self._sent
        if silence > self.robot.watchdog:
            self._trip(Fault.WATCHDOG, None, silence, f"no set-point for {silence:.3g} s")
        self._refuse_faults()
        way = self.robot.slew * min(silence, 1.5 * self.robot.control_period)
        self._applied = self._applied + np.clip(
            np.asarray(length, float) - self._applied, -way, way
        )
        self._write()
        reading = self._look()
        self._refuse_faults()
        return reading

    def stop(self, timeout: float = 1.0) -> None:
        """See `Hardware`."""
        if not self._powered:
            return
        self._state, speed = DeviceState.RAMPING, min(self.robot.ramp, self.robot.slew)
        duration = float(np.abs(self._applied - self._rest).max()) / speed
        end, due = self.now() + duration + timeout, self.now()
        self._bus.guard(True)
        while np.abs(self._applied - self._rest).max() > 1e-9:
            if self.now() > end:
                raise LinkError("the motors have not come to rest in time")
            due = max(due, self.now()) + self.robot.control_period
            way = speed * self.robot.control_period
            self._applied = self._applied + np.clip(self._rest - self._applied, -way, way)
            self._write()
            self._look()
            self.wait_until(due)
        self._release(self.robot.at_stop == "hold")

    def _release(self, hold: bool) -> None:
        """The host's part is over: torque off, or held without its watchdog."""
        self._powered = False
        latched = self.fault is not None
        self._state = DeviceState.LATCHED if latched else DeviceState.DISARMED
        self._bus.guard(False)
        if not hold:
            with self._bus.port.patient():
                self._bus.power(False)

    def _ends(self) -> list[Callable[[], None]]:
        return [self._bus.port.free, self._park, self._let_go]

    def _let_go(self) -> None:
        """What is left to do where a stop has failed."""
        if self._powered:
            self._release(self.robot.at_stop == "hold")

    def estop(self) -> None:
        """See `Hardware`."""
        self._bus.port.free()
        self.fault = FaultInfo(Fault.ESTOP, None, None, "emergency stop")
        self._state, self._powered = DeviceState.LATCHED, False
        self._bus.power(False)

    def clear(self, timeout: float = 1.0) -> None:
        """See `Hardware`."""
        if self.fault is None:
            return
        self.stop(timeout)
        for motor, state in zip(self.robot.motors, self._bus.read(), strict=True):
            if state is not None and state.errors:
                self._bus.restart(motor.id)
        self.wait_until(self.now() + 0.3)  # a motor that restarts is away for so long
        self.fault, self._since, self._state = None, {}, DeviceState.DISARMED
        self._look_until(self.now() + timeout)
        end = self.now() + self.robot.patience + self.robot.control_period
        while self.fault is None and self.now() < end:  # what has to last may be there still
            self.wait_until(self.now() + self.robot.control_period)
            self._look()
        if self.fault is not None:
            raise RefusedError("CLEAR", Reason.FAULT)

    # ------------------------------------------------------------ inside

    def _refuse_faults(self) -> None:
        if self.fault is not None:
            raise RobotFaultError(self.fault)

    def _write(self) -> None:
        self._bus.write(self._zero + self._applied[self._tendon] / self._radius)
        self._sent = self.now()
        self._counters.sent += 1

    def _look_until(self, end: float) -> None:
        while self._look() is None:
            if self.now() > end:
                raise LinkError("not all motors say where they are")

    def _look(self) -> Reading | None:
        """Read all motors and judge what they say; None unless all have answered."""
        asked = self.now()
        states = self._bus.read()
        now = self.now()
        self._counters.received += sum(state is not None for state in states)
        self._counters.lost += sum(state is None for state in states)
        self._counters.note("round_trip", now - asked)
        self._on = any(state is not None and state.powered for state in states)
        if None not in states:
            self.reading = self._made(states, asked, now)
        self._judge(states, now)
        return None if None in states else self.reading

    def _made(self, states: list[MotorState], asked: float, now: float) -> Reading:
        self._lengths = (np.array([s.angle for s in states]) - self._zero) * self._radius
        current = np.array([s.current for s in states])
        constant = [motor.torque_constant for motor in self.robot.motors]
        return Reading(
            time=now,
            taken=asked,
            round_trip=now - asked,
            applied=self._applied.copy(),
            length=self._by_tendon(self._lengths) / self._shares,
            force=self._by_tendon(np.maximum(0.0, current * constant / self._radius)),
            adc=np.zeros(4, int),
            supply=min(s.voltage for s in states),
            state=self._state,
            faults=() if self.fault is None else (self.fault.code,),
            current=self._most(np.abs(current)),
            temperature=self._most(np.array([s.temperature for s in states])),
        )

    def _by_tendon(self, values: ndarray) -> ndarray:
        return np.bincount(self._tendon, values)

    def _most(self, values: ndarray) -> ndarray:
        return np.array([values[self._tendon == k].max() for k in range(len(self._shares))])

    def _judge(self, states: list[MotorState | None], now: float) -> None:
        """Stop for what is wrong with a motor, at once or when it has lasted."""
        wrong = {}
        for k, (motor, state) in enumerate(zip(self.robot.motors, states, strict=True)):
            for code, value, text, lasting in self._wrong(k, motor, state):
                wrong[motor.id, code] = since = self._since.get((motor.id, code), now)
                if self.fault is None and now - since >= lasting * self.robot.patience:
                    who = f"motor {motor.id} (tendon {motor.tendon}) "
                    lasted = f" for {now - since:.2g} s" if lasting and now > since else ""
                    self._trip(code, int(self._tendon[k]), value, who + text + lasted)
        self._since = wrong

    def _wrong(
        self, k: int, motor: Motor, state: MotorState | None
    ) -> Iterable[tuple[IntEnum, float | None, str, bool]]:
        """What is wrong with a motor: code, value, text, and whether it has to last."""
        robot = self.robot
        if state is None:
            yield MotorFault.SILENT, None, "does not answer", True
            return
        for bit, (code, text) in self._bus.bits.items():
            if state.errors >> bit & 1:
                yield code, None, text, False
        if state.expired:
            yield Fault.WATCHDOG, robot.watchdog, "has stopped: nobody spoke to it in time", False
        if self._state == DeviceState.RUNNING and not state.powered:
            yield MotorFault.RESTARTED, None, "has lost its torque: it started anew", False
        if motor.max_current and abs(state.current) > motor.max_current:
            yield Fault.FORCE, abs(state.current), f"takes {abs(state.current):.2f} A", True
        if state.temperature > motor.max_temperature:
            heat = state.temperature
            yield MotorFault.OVERHEATED, heat, f"is {heat:.0f} °C hot", True
        if state.voltage < robot.supply:
            yield Fault.BROWN_OUT, state.voltage, f"gets {state.voltage:.1f} V", True
        length = (state.angle - self._zero[k]) * self._radius[k]
        behind = abs(length - self._applied[self._tendon[k]])
        if self._powered and robot.stall and behind > robot.stall:
            yield Fault.STALL, behind, f"stalled {1e3 * behind:.1f} mm behind", True

    def _trip(self, code: IntEnum, channel: int | None, value: float | None, text: str) -> None:
        """Latch the first fault; motors freeze where they are, `stop` ramps them down."""
        self.fault = FaultInfo(code, channel, value, text)
        if self._powered:
            self._state = DeviceState.RAMPING
            if self.reading.age(self.now()) < self.robot.control_period:  # else keep the goals
                self._applied = np.clip(self.reading.length, self._low, self._high)
            self._bus.guard(True)
            self._write()


def home(hardware: MotorRobot, speed: float | None = None) -> ndarray:
    """Pull every tendon until its motors take `home_current`, and let it out by `home_backoff`.

    All are pulled at once, and one that is taut waits for the others: the robot stays in balance.

    Args:
        hardware: Armed, of a file that is `jogged`.
        speed: [m/s]; the file's `ramp` unless given.

    Returns:
        (n,) [m], where length zero is, by the file's present calibration.

    Raises:
        RobotError: A tendon is not taut after `home_travel`.
    """
    file = hardware.robot
    way = (file.ramp if speed is None else speed) * file.control_period
    start = hardware.reading.applied.copy()
    target, due = start.copy(), hardware.now()
    taut = np.zeros(len(start), bool)
    while not taut.all():
        far = np.flatnonzero(~taut & (target + way > start + file.home_travel))
        if far.size:
            raise RobotError(
                f"tendon {file.tendon_names[far[0]]} is not taut after "
                f"{1e3 * file.home_travel:g} mm: it is not attached, or home_current_a is too large"
            )
        target = target + np.where(taut, 0.0, way)
        due = max(due, hardware.now()) + file.control_period
        reading = hardware.pace(target, due)
        if reading is not None:
            taut |= reading.current >= file.home_current
    zero = target - file.home_backoff
    hardware.move_to(zero, file.ramp, 10.0)
    return zero
