"""What every real robot can do, whatever moves its tendons: a board's servos or motors on a bus.

A new kind of hardware is a `Hardware`, and an entry of `registry.HARDWARE`.
"""

import atexit
import os
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from math import ceil, inf, nan
from threading import current_thread, main_thread
from time import monotonic, sleep
from types import FrameType
from typing import Any, Protocol, Self

import numpy as np
from numpy import ndarray

from .errors import FaultInfo, LinkError, RobotError
from .protocol.messages import LENGTH_UNIT, DeviceState, Fault, Warning
from .transport import Transport

#: [s]; a robot that has said nothing for longer is taken for dead.
FRESH = 0.5

_THERE = 1.5 * LENGTH_UNIT

_NO_WARNING = Warning(0)


class Limits(Protocol):
    """Where a tendon may be: pulled-in lengths [m], and the one where a stop ends."""

    minimum: float
    maximum: float
    rest: float


class HardwareFile(Protocol):
    """What is known of a real robot before it moves, whatever its kind.

    Attributes:
        name, port, baud: For people; the serial port and its rate.
        tendons: Limits of each.
        control_period: [s] between set-points.
        watchdog: [s] without a set-point after which the robot stops by itself.
        state_delay: [s] from a set-point to the measurement that answers it, at most.
        slew, ramp: [m/s], largest speed of an output, and that of a stop.
        tip: What measures the tip.
    """

    name: str
    port: str
    baud: int
    tendons: tuple[Limits, ...]
    control_period: float
    watchdog: float
    state_delay: float
    slew: float
    ramp: float
    tip: Any

    def jogged(self) -> Self:
        """The robot with ranges as wide as can be, slow and patient, to be calibrated."""

    def calibrated(self, marks: tuple[tuple[float, float, float, float], ...]) -> Self:
        """The robot with marks (n, 4) [m] of each tendon: zero, minimum, maximum, rest.

        Raises:
            ValueError: They contradict each other.
        """


@dataclass(frozen=True)
class Reading:
    """What a robot does and measures at an instant.

    Attributes:
        time: [s], when it arrived on the host's clock.
        taken: [s], when it was sent by the host's clock, up to the delay of the quickest message
            of the connection. A message that waited somewhere has been taken before it arrived.
        device_time: [s] of a board's clock, which wraps after 4295 s; NaN of motors.
        seq: Last set-point of this session that a board had accepted; None before the first.
        round_trip: [s] from sending that set-point; None unless this reading was its first echo.
        applied: (n,) [m], what the outputs were driven to.
        length: (n,) [m], measured; as applied if that cannot be.
        force: (n,) [N], zero if the robot cannot measure it.
        adc: (4,) counts of the converter.
        supply: [V].
        state: What it is doing.
        warnings: Does not stop it.
        faults: What stopped it, in no order.
        current, temperature: Largest magnitude [A] and [°C] of a tendon's motors, (n,); None of
            boards.
    """

    time: float
    taken: float
    round_trip: float | None
    applied: ndarray
    length: ndarray
    force: ndarray
    adc: ndarray
    supply: float
    state: DeviceState
    faults: tuple[Fault, ...]
    device_time: float = nan
    seq: int | None = None
    warnings: Warning = _NO_WARNING
    current: ndarray | None = None
    temperature: ndarray | None = None

    def age(self, now: float) -> float:
        """How old it is [s] at `now` [s] on the host's clock."""
        return now - self.taken

    def is_at(self, length: ndarray) -> bool:
        """Whether the outputs have come to lengths (n,) [m], to the last count."""
        return bool(np.abs(self.applied - length).max() < _THERE)


class Hardware(ABC):
    """A real robot, in SI units. Lengths are (n,) [m] pulled in; all waits are bounded.

    Nothing but `exchange` and what calls it keeps a robot moving.

    Attributes:
        robot: Calibration and limits.
        reading: The newest one, None before the first.
        fault: What stopped the robot, None if nothing did.
        measures_force: Whether `Reading.force` is measured.
        keeps_zero: Whether it measures lengths from a zero of its own.
    """

    robot: HardwareFile
    measures_force = keeps_zero = False

    def __init__(self, robot: HardwareFile, transport: Transport) -> None:
        """Nothing is sent yet; `close` closes the transport."""
        self.robot, self._transport, self._closed = robot, transport, False
        self._guard = ExitGuard(self.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    reading: Reading | None
    fault: FaultInfo | None

    @property
    @abstractmethod
    def link(self) -> dict[str, Any]:
        """Counters of the connection, see `protocol.session.LinkCounters`."""

    @property
    @abstractmethod
    def about(self) -> dict[str, str]:
        """Who answered, by name, for people; after `connect`."""

    @abstractmethod
    def connect(self, timeout: float = 2.0) -> Any:
        """Find the robot and set it up; it is not moved. Also after a lost line.

        Raises:
            LinkError: No answer within `timeout` [s].
            RobotError: What answers does not fit to the file, or refuses it.
        """

    @abstractmethod
    def arm(self, timeout: float = 1.0) -> None:
        """Hold the robot where it stands; set-points must follow within the watchdog.

        Raises:
            RobotFaultError: A fault is latched.
            RefusedError: It stands too far outside its range.
            RobotError: Not connected, or armed already.
        """

    @abstractmethod
    def exchange(self, length: ndarray, deadline: float) -> Reading | None:
        """Send a set-point and wait for the reading that answers it.

        Args:
            length: (n,) [m].
            deadline: [s] of this machine's monotonic clock.

        Returns:
            None if no answer came in time; nothing is sent while earlier ones are awaited.

        Raises:
            ValueError: Another shape, or outside the range; nothing was sent.
            LinkError: The link is broken.
            RobotFaultError: A fault stopped the robot.
            RobotError: Not armed.
        """

    @abstractmethod
    def check_target(self, length: ndarray) -> None:
        """Raise ValueError for lengths (n,) [m] outside the range."""

    @abstractmethod
    def stop(self, timeout: float = 1.0) -> None:
        """Ramp to rest, then off or held as the file says; nothing to do unless armed.

        Args:
            timeout: [s], beyond the duration of the ramp.

        Raises:
            LinkError: It has not stopped in time.
            RobotError: A motor does not confirm that it is off; the others are.
        """

    @abstractmethod
    def estop(self) -> None:
        """Cut the outputs at once; latches. Works in every state."""

    @abstractmethod
    def clear(self, timeout: float = 1.0) -> None:
        """Clear the latched fault, if there is one; the robot stays disarmed.

        Raises:
            RefusedError: Its cause is still there.
            LinkError: No answer within `timeout` [s], beyond a ramp under way.
        """

    def wait_for_fault(self, timeout: float) -> FaultInfo | None:
        """The fault that stops the robot, None if none does within `timeout` [s]."""
        return self.fault

    def close(self) -> None:
        """Stop, disarm and free the port, as far as possible; twice is harmless."""
        if self._closed:
            return
        self._closed = True
        with ExitStack() as left:
            for stage in (self._guard.remove, self._transport.close, *reversed(self._ends())):
                left.callback(_quietly, stage)

    def _ends(self) -> list[Callable[[], None]]:
        """What ends a connection before its transport is closed, in this order."""
        return [self._park]

    def move_to(self, length: ndarray, speed: float, timeout: float) -> Reading:
        """Move an armed robot in a straight line and wait until it is there.

        Args:
            length: (n,) [m].
            speed: [m/s] of the tendon that has the longest way.
            timeout: [s].

        Raises:
            ValueError: Outside the range, or the speed is not positive.
            RobotError: It was not there in time, or see `exchange`.
        """
        self.check_target(length)
        if not 0 < speed < inf:
            raise ValueError(f"speed must be positive, got {speed} m/s")
        if self.reading is None:
            raise RobotError("move_to() needs a robot that is connected and armed")
        start, end = self.reading.applied, self.now() + timeout
        way, period = np.asarray(length, float) - start, self.robot.control_period
        steps = max(1, ceil(np.abs(way).max() / (speed * period)))
        step, due = 0, self.now()
        while self.now() < end:
            step, due = min(step + 1, steps), max(due, self.now()) + period
            reading = self.pace(start + way * step / steps, due)
            if step == steps and reading is not None and reading.is_at(length):
                return reading
        raise RobotError(f"the robot has not come to its target within {timeout:g} s")

    def pace(self, length: ndarray, due: float) -> Reading | None:
        """Command a set-point and wait until `due` [s]; its answer, None if there was none.

        Raises:
            LinkError: The robot is silent.
            RobotError: See `exchange`.
        """
        reading = self.exchange(length, due)
        if reading is None and self.fault is None and not self._is_alive():
            raise LinkError(f"the robot has said nothing for {FRESH:g} s")
        self.wait_until(due)
        return reading

    def now(self) -> float:
        """[s] of this machine's monotonic clock."""
        return monotonic()

    def wait_until(self, due: float) -> None:
        """Wait until a time [s] of `now`, or until this is closed."""
        sleep(max(0.0, due - self.now()))

    def _is_alive(self) -> bool:
        return self.reading is not None and self.now() - self.reading.time < FRESH

    def _park(self) -> None:
        if self._is_alive():
            self.stop()


def _quietly(stage: Callable[[], None]) -> None:
    with suppress(RobotError, OSError):
        stage()


class ExitGuard:
    """Calls a function when the interpreter ends, or when it gets SIGTERM.

    The signal then goes on to whoever had it before. Only Python's main thread gets
    signals; elsewhere the guard does without. What a process has opened is its own: in a forked
    child the guard does nothing.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close, self._owner = close, os.getpid()
        self._previous: signal.Handlers | Callable | int | None = None

    def install(self) -> None:
        """Begin; twice is harmless."""
        self.remove()
        atexit.register(self._close_own)
        if current_thread() is main_thread():
            self._previous = signal.getsignal(signal.SIGTERM)
            if self._previous is not None:
                signal.signal(signal.SIGTERM, self._handle)

    def remove(self) -> None:
        """End; the previous handler gets its signal back."""
        atexit.unregister(self._close_own)
        if current_thread() is main_thread() and signal.getsignal(signal.SIGTERM) == self._handle:
            signal.signal(signal.SIGTERM, self._previous)

    def _close_own(self) -> None:
        if os.getpid() == self._owner:
            self._close()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._close_own()
        signal.signal(signal.SIGTERM, self._previous)
        signal.raise_signal(number)
