"""The host's side of the protocol, from the handshake on: bytes in, bytes out.

It has no clock, no threads and no port.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any
from zlib import crc32

from numpy import ndarray

from ..errors import (
    LinkError,
    ProtocolMismatchError,
    RobotError,
    RobotFaultError,
    SessionLostError,
    UnansweredError,
)
from ..interface import FaultInfo, Reading
from ..robot_file import RobotFile
from . import messages as m
from .messages import (
    CLOCK_UNIT,
    PROTOCOL,
    SCHEMA,
    Capability,
    Decoder,
    HelloAck,
    Reason,
    Reset,
    encode,
)
from .unit_conversion import UnitConversion, faults, kind_of_fault

_KEPT = 16  # readings
_CLOCK, _SEQ = 1 << 32, 1 << 16


class Phase(IntEnum):
    """How far a host has come with a robot, from knowing nothing to running."""

    LOST = -1  # the robot has forgotten a session that was going on
    NEW = 0  # nobody has answered
    IDENTIFIED = 1  # the handshake is done
    CONFIGURED = 2
    ARMING = 3
    ARMED = 4
    RUNNING = 5
    STOPPING = 6


_FOLLOWING = {m.DeviceState.ARMED: Phase.ARMED, m.DeviceState.RUNNING: Phase.RUNNING}


class Session:
    """What a host knows of a robot, and what it may say next.

    It never arms by itself: after a fault, a restart or a stop only `arm` begins anew.

    Attributes:
        robot: What the microcontroller is configured with.
        phase: How far it has come.
        info: Who answered, None before.
        readings: The newest ones, the last one last.
        fault: What stopped the robot, None if nothing does.
        fault_reported: Whether `fault` is the robot's report, and not only its kind from a state.
        link: Counters.
        units: Conversion of the robot's units.
    """

    def __init__(self, robot: RobotFile, nonce: int) -> None:
        """Begin with a random number of 32 bits that tells this host's hello from others."""
        self.robot = robot
        self.phase = Phase.NEW
        self.info: DeviceInfo | None = None
        self.readings: deque[Reading] = deque(maxlen=_KEPT)
        self.fault: FaultInfo | None = None
        self.fault_reported = False
        self.link = LinkCounters()
        self.units, self._decoder = UnitConversion(robot), Decoder()
        self._config = robot.to_message()
        self._config_crc = crc32(m.pack(self._config, 0)[m.HEADER_SIZE :])
        self._nonce, self._number, self._seq = nonce, 0, 0
        self._in_flight, self._clock = InFlight(), DeviceClock()
        self._refusals: dict[int, int] = {}  # type of message -> why it was refused

    # What the host says.

    def hello(self) -> bytes:
        """Ask who is there; ends whatever the robot is doing with its ramp."""
        return self._frame(m.Hello(self._nonce, m.PROTOCOL, m.PROTOCOL))

    def configure(self) -> bytes:
        """Send calibration and limits."""
        if self.phase < Phase.IDENTIFIED:
            raise RobotError("needs a robot that is identified: call connect()")
        return self._frame(self._config)

    def arm(self, number: int) -> bytes:
        """Begin a session with a random number from 1 to 65535.

        Raises:
            RobotFaultError: A fault is latched.
            RobotError: Not configured, or armed already.
        """
        self._refuse_faults()
        if self.phase not in (Phase.CONFIGURED, Phase.ARMING):
            raise RobotError(
                f"arm() needs a robot that is configured, it is {self.phase.name.lower()}"
            )
        self._number, self._in_flight = number, InFlight()
        self.phase = Phase.ARMING
        return self._frame(m.Arm(number, self._config_crc))

    def setpoint(self, length: ndarray, now: float) -> tuple[int, bytes]:
        """Sequence number and frame of a set-point (n,) [m], at `now` [s].

        Raises:
            ValueError: Another shape, or outside the robot file's range.
            UnansweredError: Three set-points are under way.
            LinkError: The session is lost.
            RobotFaultError: A fault stopped the robot.
            RobotError: Not armed.
        """
        target = self.units.target(length)
        self._refuse_faults()
        if self.phase not in (Phase.ARMED, Phase.RUNNING):
            raise RobotError(f"a set-point needs an armed robot, it is {self.phase.name.lower()}")
        self._in_flight.check_room(now, self.robot.ttl)
        message = m.Setpoint(
            session=self._number,
            t_host=round(now / m.CLOCK_UNIT) % _CLOCK,
            ttl_ms=round(1e3 * self.robot.ttl),
            mode=m.MODE_LENGTH,
            n=len(target),
            target=target,
        )
        frame = self._frame(message)
        self._in_flight.add(self._seq, now)
        return self._seq, frame

    def stop(self) -> bytes:
        """Ramp to rest, then off."""
        return self._end(m.Stop(self._number, 0))

    def disarm(self) -> bytes:
        """End the session."""
        return self._end(m.Disarm(self._number))

    def estop(self) -> bytes:
        """Cut the outputs at once."""
        return self._frame(m.EStop())

    def clear(self) -> bytes:
        """Clear the latched fault.

        Raises:
            RobotError: There is none.
        """
        if self.fault is None:
            raise RobotError("there is no fault to clear")
        return self._frame(m.Clear(self.fault.code))

    # What the robot says.

    @property
    def reading(self) -> Reading | None:
        """The newest one."""
        return self.readings[-1] if self.readings else None

    def present_target(self) -> ndarray:
        """Lengths (n,) [m] inside the range, nearest to where the robot is.

        Raises:
            LinkError: No reading yet.
        """
        if self.reading is None:
            raise LinkError("the robot has not reported its position")
        measures = m.Capability.LENGTH in self.info.capabilities
        return self.units.nearest_target(self.reading.length if measures else self.reading.applied)

    def echo(self, seq: int) -> Reading | None:
        """First reading kept that answers a set-point or a later one."""
        for reading in tuple(self.readings):  # others may append meanwhile
            if reading.seq is not None and newer(reading.seq, seq) >= 0:
                return reading
        return None

    def refusal(self, kind: type[m.Message]) -> int | None:
        """Why the last message of a type was refused, None if it was not."""
        return self._refusals.get(kind.number)

    def receive(self, data: bytes, now: float) -> bytes:
        """Take in bytes that arrived at `now` [s]; returns bytes to send.

        Raises:
            ProtocolMismatchError: The firmware does not fit to this package.
            SessionLostError: The microcontroller started again.
            RobotError: See `check_needs`; or it got another configuration, or sent what means
                nothing.
        """
        replies = [
            self._take(message, now)
            for message, seq in self._decoder.feed(data)
            if self.link.note_arrival(seq)
        ]
        self.link.crc_errors = self._decoder.crc_errors
        self.link.frame_errors = self._decoder.frame_errors
        return b"".join(replies)

    def _take(self, message: m.Message, now: float) -> bytes:
        if self.info is not None and not self.units.knows(message):
            raise RobotError(f"the robot sent what means nothing, {message}: {_REMEDY}")
        match message:
            case m.HelloAck():
                self._identified(message)
            case m.ConfigAck():
                self._configured(message)
            case m.State() if self.info is not None:
                return self._measured(message, now)
            case m.FaultReport() if self.info is not None:
                self._stopped(self.units.fault(message), reported=True)
            case m.Nack():
                self._refused(message)
        return b""

    def _identified(self, ack: m.HelloAck) -> None:
        if ack.nonce != self._nonce:
            return
        info, before = introduced(ack), self.info
        check_needs(self.robot, info)
        if self.phase == Phase.LOST or (before is not None and before.boot_id != info.boot_id):
            raise SessionLostError(loss_text(before, info))
        self.info = info
        self.phase = max(self.phase, Phase.IDENTIFIED)

    def _configured(self, ack: m.ConfigAck) -> None:
        if self.phase != Phase.IDENTIFIED:
            return
        if ack.crc != self._config_crc:
            raise RobotError("the robot acknowledged another configuration than was sent")
        self.phase = Phase.CONFIGURED

    def _measured(self, state: m.State, now: float) -> bytes:
        self.link.device_crc_errors = state.crc_errors
        self.link.device_frame_errors = state.frame_errors
        ours = self._number != 0 and state.session == self._number
        round_trip = self._in_flight.echo(state.last_seq, now) if ours else None
        if round_trip is not None:
            self.link.note("round_trip", round_trip)
        taken, seq = self._clock.taken(state.t_dev, now), self._in_flight.echoed
        self.link.note("delay", now - taken)
        self.readings.append(
            self.units.reading(state, time=now, taken=taken, seq=seq, round_trip=round_trip)
        )
        found = faults(state)
        if not found:
            self.fault = None
        elif self.fault is None:
            self._stopped(kind_of_fault(found[0]), reported=False)
        return self._follow(m.DeviceState(state.state), ours)

    def _follow(self, state: m.DeviceState, ours: bool) -> bytes:
        """Go on to the phase that the robot is in; ask who it is if it has forgotten us.

        Args:
            state: What the robot does.
            ours: Whether it names our session.
        """
        before = self.phase
        if before == Phase.STOPPING:
            if state in (m.DeviceState.DISARMED, m.DeviceState.LATCHED):
                self.phase = Phase.CONFIGURED
        elif before == Phase.ARMED and state == m.DeviceState.DISARMED:
            self.phase = Phase.CONFIGURED  # no first set-point came in time, or none was accepted
        elif before >= Phase.ARMING and ours:
            self.phase = _FOLLOWING.get(state, before)
        elif before >= Phase.ARMED:
            self.phase = Phase.LOST
        if before >= Phase.ARMING > self.phase:
            self._forget_session()
        return self.hello() if self.phase == Phase.LOST != before else b""

    def _stopped(self, fault: FaultInfo, reported: bool) -> None:
        self.fault, self.fault_reported = fault, reported
        self.phase = min(self.phase, Phase.CONFIGURED)
        self._forget_session()

    def _refused(self, nack: m.Nack) -> None:
        known = nack.reason in list(Reason)
        name = Reason(nack.reason).name.lower() if known else str(nack.reason)
        self.link.nacks[name] += 1
        self._refusals[nack.about] = nack.reason
        if nack.about == m.Setpoint.number:
            self._in_flight.refuse(nack.about_seq)

    def _forget_session(self) -> None:
        self._number, self._in_flight = 0, InFlight()

    def _end(self, message: m.Stop | m.Disarm) -> bytes:
        if self.phase >= Phase.ARMING:
            self.phase = Phase.STOPPING
        return self._frame(message)

    def _frame(self, message: m.Message) -> bytes:
        self._seq = (self._seq + 1) % _SEQ
        self.link.sent += 1
        self._refusals.pop(message.number, None)
        return encode(message, self._seq)

    def _refuse_faults(self) -> None:
        if self.phase == Phase.LOST:
            raise SessionLostError("the robot no longer knows this session: call connect()")
        if self.fault is not None:
            raise RobotFaultError(self.fault)


_REMEDY = "flash the firmware that belongs to this package"


@dataclass(frozen=True)
class DeviceInfo:
    """Who answered.

    Attributes:
        boot_id: Another number after every start.
        firmware: "major.minor".
        protocols: Oldest and newest protocol it speaks.
        schema: Hash of its table of messages.
        tendons: Number of its servos.
        capabilities: What it measures.
        reset_cause: Why it started last.
    """

    boot_id: int
    firmware: str
    protocols: tuple[int, int]
    schema: int
    tendons: int
    capabilities: Capability
    reset_cause: Reset


def introduced(ack: HelloAck) -> DeviceInfo:
    """Who answered.

    Raises:
        ProtocolMismatchError: Another protocol, or the same with another table of messages.
    """
    firmware = f"{ack.firmware >> 8}.{ack.firmware & 255}"
    if not ack.min_protocol <= PROTOCOL <= ack.max_protocol:
        raise ProtocolMismatchError(
            f"firmware {firmware} speaks protocol {ack.min_protocol} to {ack.max_protocol}, "
            f"this package {PROTOCOL}: {_REMEDY}"
        )
    if ack.schema != SCHEMA:
        raise ProtocolMismatchError(
            f"firmware {firmware} and this package both speak protocol {PROTOCOL}, but with "
            f"different tables of messages (schema {ack.schema:08x} and {SCHEMA:08x}): {_REMEDY}"
        )
    if ack.reset_cause not in list(Reset):
        raise ProtocolMismatchError(f"firmware {firmware} started for no known reason: {_REMEDY}")
    return DeviceInfo(
        boot_id=ack.boot_id,
        firmware=firmware,
        protocols=(ack.min_protocol, ack.max_protocol),
        schema=ack.schema,
        tendons=ack.n,
        capabilities=Capability(ack.capabilities),
        reset_cause=Reset(ack.reset_cause),
    )


def check_needs(robot: RobotFile, info: DeviceInfo) -> None:
    """Refuse a board that does not fit to a robot file.

    Raises:
        RobotError: Another number of servos, or it does not measure what is to be watched.
    """
    if info.tendons != len(robot.tendons):
        raise RobotError(
            f"the board drives {info.tendons} servos, robot {robot.name!r} has "
            f"{len(robot.tendons)} tendons"
        )
    for what, key in robot.needs().items():
        if what not in info.capabilities:
            raise RobotError(
                f"robot {robot.name!r} asks for {key}, but the board does not measure "
                f"{what.name.lower()}: set it to nothing in the robot file, or use another board"
            )


def loss_text(before: DeviceInfo, now: DeviceInfo) -> str:
    """Why a session was lost, from who answered at its beginning and who answers now."""
    if before.boot_id == now.boot_id:
        return "the robot dropped the session without starting again: call connect()"
    cause = now.reset_cause.name.lower().replace("_", "-")
    return (
        f"the microcontroller started again (cause: {cause}; boot {before.boot_id:08x}, now "
        f"{now.boot_id:08x}): call connect()"
    )


# ---------------------------------------------------------------- what is noted of a link
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

    def note(self, what: str, duration: float) -> None:
        """Note a duration [s], "round_trip" or "delay"."""
        longest = max(getattr(self, f"longest_{what}"), duration)
        vars(self).update({what: duration, f"longest_{what}": longest})

    def as_dict(self) -> dict[str, Any]:
        """The counters by name."""
        shown = {name: value for name, value in vars(self).items() if not name.startswith("_")}
        return shown | {"nacks": dict(self.nacks)}
