"""Drives a robot, in SI units, and stops it however a program ends.

`Exchange` asks it and waits for its answers, with a thread that listens.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from secrets import randbits
from threading import Condition, Event, RLock, Thread
from time import monotonic
from typing import Any

import numpy as np
from numpy import ndarray

from .errors import FaultInfo, LinkError, RefusedError, RobotError, UnansweredError
from .interface import ExitGuard as ExitGuard
from .interface import Hardware, Reading
from .protocol import messages as m
from .protocol.session import DeviceInfo, Phase, Session, introduced
from .robot_file import LONGEST_RAMP, RobotFile
from .transport import Transport


class Driver(Hardware):
    """A board's servos.

    What goes wrong while listening is raised by the next call. Nothing but `command` and `move_to`
    keeps a robot moving: it stops by itself when set-points stay away for longer than its watchdog
    allows.
    """

    def __init__(self, robot: RobotFile, transport: Transport) -> None:
        """Nothing is sent yet.

        Args:
            robot: Calibration and limits.
            transport: The way to the robot; `close` closes it.
        """
        super().__init__(robot, transport)
        self._session = Session(robot, nonce=0)  # until connect()
        self._exchange = Exchange(transport)

    @property
    def info(self) -> DeviceInfo | None:
        """Who answered; None before `connect`."""
        return self._session.info

    @property
    def about(self) -> dict[str, str]:
        """See `Hardware`."""
        info = self.info
        return {
            "firmware": info.firmware,
            "protocol": f"{info.protocols[0]} to {info.protocols[1]}",
            "schema": f"{info.schema:08x}",
            "tendons": str(info.tendons),
            "measures": ", ".join(c.name.lower() for c in info.capabilities) or "nothing",
            "boot": f"{info.boot_id:08x}, cause {info.reset_cause.name.lower().replace('_', '-')}",
        }

    @property
    def measures_force(self) -> bool:
        """See `Hardware`."""
        return m.Capability.FORCE in self.info.capabilities

    @property
    def keeps_zero(self) -> bool:
        """See `Hardware`."""
        return m.Capability.LENGTH in self.info.capabilities

    @property
    def reading(self) -> Reading | None:
        """The newest reading, None before the first."""
        return self._session.reading

    @property
    def fault(self) -> FaultInfo | None:
        """What stopped the robot, None if nothing did."""
        return self._session.fault

    @property
    def link(self) -> dict[str, Any]:
        """Counters of the connection, see `LinkCounters`."""
        return self._session.link.as_dict()

    def connect(self, timeout: float = 2.0) -> DeviceInfo:
        """Handshake and configuration; the robot stays disarmed. Also after a lost session.

        Raises:
            LinkError: No answer within `timeout` [s].
            ProtocolMismatchError: The firmware does not fit.
            RobotError: The board has another number of servos, or does not measure what the robot
                file wants to be watched.
            RefusedError: It does not take the configuration.
        """
        if self._closed:
            raise LinkError("this driver is closed")
        session = self._session = Session(self.robot, randbits(32))
        end, ask = monotonic() + timeout, self._exchange.ask
        self._exchange.listen(session)
        self._guard.install()
        ask(m.Hello, session.hello, lambda: session.phase >= Phase.IDENTIFIED, end)
        ask(m.Config, session.configure, lambda: session.phase >= Phase.CONFIGURED, end)
        if not self._exchange.wait(lambda: session.reading is not None, end):
            raise LinkError("the robot does not say where it is")
        self._learn_fault(session, end)
        return session.info

    def arm(self, timeout: float = 1.0) -> None:
        """Power the outputs where the robot stands; set-points must follow within the watchdog.

        A position just outside the range is moved to its end, if that is in the arming window.

        Raises:
            RobotFaultError: A fault is latched.
            RefusedError: The robot refuses, for instance because it stands too far outside.
            LinkError: No answer within `timeout` [s].
            RobotError: Not connected, or armed already.
        """
        end, session, number = monotonic() + timeout, self._session, randbits(16) or 1

        def hold() -> bytes:
            return session.setpoint(session.present_target(), monotonic())[1]

        ask = self._exchange.ask
        ask(m.Arm, lambda: session.arm(number), lambda: session.phase >= Phase.ARMED, end)
        ask(m.Setpoint, hold, lambda: session.phase == Phase.RUNNING, end)

    def command(self, length: ndarray) -> int:
        """Send a set-point; returns its sequence number.

        Raises:
            ValueError: See `Session.setpoint`; nothing was sent.
            UnansweredError: Three set-points are under way.
            LinkError: The link is broken.
            RobotFaultError: A fault stopped the robot.
            RobotError: Not armed.
        """
        with self._exchange.held():
            seq, frame = self._session.setpoint(length, monotonic())
        self._exchange.write(frame)
        return seq

    def wait_for(self, seq: int, deadline: float) -> Reading | None:
        """First reading that answers a set-point or a later one.

        Args:
            seq: What `command` returned.
            deadline: [s] of `time.monotonic`.

        Returns:
            None at the deadline, or at once if a fault stops the robot.

        Raises:
            RobotError: What went wrong while listening.
        """
        session = self._session
        self._exchange.wait(
            lambda: session.fault is not None or session.echo(seq) is not None, deadline
        )
        return session.echo(seq)

    def exchange(self, length: ndarray, deadline: float) -> Reading | None:
        """See `Hardware`; `command` and `wait_for` in one."""
        try:
            return self.wait_for(self.command(length), deadline)
        except UnansweredError:
            return None

    def check_target(self, length: ndarray) -> None:
        """See `Hardware`."""
        self._session.units.target(length)

    def wait_until(self, due: float) -> None:
        """See `Hardware`."""
        self._exchange.pause(due)

    def estop(self) -> None:
        """Cut the outputs at once; latches. Works in every state."""
        self._exchange.write(self._session.estop())

    def wait_for_fault(self, timeout: float) -> FaultInfo | None:
        """The fault that stops the robot, None if none does within `timeout` [s]."""
        session = self._session
        self._exchange.wait(lambda: session.fault is not None, monotonic() + timeout)
        return session.fault

    def stop(self, timeout: float = 1.0) -> None:
        """Ramp to rest, then off; nothing to do for a robot that is not armed.

        Args:
            timeout: [s], beyond the duration of the ramp.

        Raises:
            LinkError: It has not stopped in time.
        """
        session = self._session
        if session.phase >= Phase.ARMING:
            end = monotonic() + timeout + self._ramp_duration()
            self._exchange.ask(m.Stop, session.stop, lambda: session.phase < Phase.ARMING, end)

    def clear(self, timeout: float = 1.0) -> None:
        """Clear the latched fault, if there is one; the robot stays disarmed.

        Args:
            timeout: [s], beyond the duration of a ramp under way.

        Raises:
            RefusedError: Its cause is still there.
            LinkError: No answer in time.
        """
        session = self._session
        end = monotonic() + timeout + self._ramp_duration()
        self._learn_fault(session, end)
        self._exchange.ask(m.Clear, session.clear, lambda: session.fault is None, end)

    def _ends(self) -> list[Callable[[], None]]:
        return [self._park, self._disarm, self._exchange.close]

    def _learn_fault(self, session: Session, end: float) -> None:
        """Wait for the report of a fault that is known only by its kind, or until `end` [s]."""
        self._exchange.wait(lambda: session.fault is None or session.fault_reported, end)

    def _disarm(self) -> None:
        if self._session.phase >= Phase.ARMING:
            self._exchange.write(self._session.disarm())

    def _ramp_duration(self) -> float:
        """Longest time [s] to rest from where the outputs are; the board takes no longer."""
        if self.reading is None:
            return 0.0
        rest = np.array([servo.rest for servo in self.robot.tendons])
        speed = min(self.robot.ramp, self.robot.slew)
        return min(LONGEST_RAMP, float(np.abs(self.reading.applied - rest).max() / speed))


_RETRY = 0.2  # s, after which a question is asked again
_POLL = 0.05  # s, in which the listening thread notices the end
_JOIN = 1.0  # s

#: Refusals that may be over when the question is asked again: the robot still ramps.
_PASSING = (m.Reason.STATE, m.Reason.SESSION)


class Exchange:
    """One end of a link. Every wait is bounded.

    What goes wrong while listening ends the thread and is raised by the next call.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        # Both locks are reentrant: a signal's handler may close what it has interrupted.
        self._changed, self._writing, self._closing = Condition(), RLock(), Event()
        self._thread: Thread | None = None
        self._session: Session | None = None
        self._error: RobotError | None = None

    def listen(self, session: Session) -> None:
        """Give what arrives to a session from now on."""
        with self._changed:
            self._session, self._error = session, None
        if self._thread is None or not self._thread.is_alive():
            self._thread = Thread(target=self._listen, name="robot", daemon=True)
            self._thread.start()

    def write(self, data: bytes) -> None:
        """Send bytes, whatever has gone wrong before.

        Raises:
            LinkError: They cannot be sent.
        """
        with self._writing:
            self._transport.write(data)

    @contextmanager
    def held(self) -> Iterator[None]:
        """While nothing is taken in.

        Raises:
            RobotError: What went wrong while listening.
        """
        with self._changed:
            self._raise_error()
            yield

    def wait(self, done: Callable[[], bool], end: float) -> bool:
        """Wait until something is so, at the longest until `end` [s]; whether it is.

        Raises:
            RobotError: What went wrong while listening.
        """
        with self._changed:
            left = max(0.0, end - monotonic())
            self._changed.wait_for(lambda: self._error is not None or done(), left)
            self._raise_error()
            return done()

    def ask(
        self, kind: type[m.Message], make: Callable[[], bytes], done: Callable[[], bool], end: float
    ) -> None:
        """Send a message, again and again, until what it asks for has happened.

        Args:
            kind: Type of the message.
            make: Makes a frame of it.
            done: Whether it has happened.
            end: [s].

        Raises:
            RefusedError: It was refused; at once if asking again is of no use.
            LinkError: It has not happened in time.
            RobotError: What went wrong while listening, or while making the frame.
        """
        session, reason, name = self._session, None, kind.__name__.upper()
        while not self.wait(done, monotonic()):
            if monotonic() >= end:
                if reason is None:
                    raise LinkError(f"the robot has not answered {name} in time")
                raise RefusedError(name, reason)
            with self.held():
                data = make()
            self.write(data)
            retry = min(end, monotonic() + _RETRY)
            self.wait(lambda: done() or session.refusal(kind) is not None, retry)
            reason = session.refusal(kind)
            if reason in _PASSING:
                self.wait(done, retry)
            elif reason is not None and not done():
                raise RefusedError(name, reason)

    def pause(self, end: float) -> None:
        """Wait until `end` [s], or until this is closed."""
        self._closing.wait(max(0.0, end - monotonic()))

    def close(self) -> None:
        """End the thread; twice is harmless."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(_JOIN)

    def _listen(self) -> None:
        try:
            while not self._closing.is_set():
                data = self._transport.read(_POLL)
                if data:
                    self._take(data)
        except RobotError as error:
            self._fail(error)
        except Exception as error:
            self._fail(RobotError(f"cannot understand the robot: {error}"))

    def _fail(self, error: RobotError) -> None:
        with self._changed:
            self._error = error
            self._changed.notify_all()

    def _take(self, data: bytes) -> None:
        with self._changed:
            reply = self._session.receive(data, monotonic())
            self._changed.notify_all()
        if reply:
            self.write(reply)

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error


def identify(transport: Transport, timeout: float = 2.0) -> DeviceInfo:
    """Ask who is at the other end; a robot that moves ramps down.

    Raises:
        LinkError: Nobody answers within `timeout` [s].
        ProtocolMismatchError: See `introduced`.
    """
    hello, decoder = m.Hello(randbits(32), m.PROTOCOL, m.PROTOCOL), m.Decoder()
    end = monotonic() + timeout
    while monotonic() < end:
        transport.write(m.encode(hello, 0))
        retry = min(end, monotonic() + _RETRY)
        while monotonic() < retry:
            for message, _ in decoder.feed(transport.read(_POLL)):
                if isinstance(message, m.HelloAck) and message.nonce == hello.nonce:
                    return introduced(message)
    raise LinkError(f"no robot has answered within {timeout:g} s")
