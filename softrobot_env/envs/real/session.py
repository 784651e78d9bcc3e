"""The real rig as an environment uses it: microcontroller and tip source.

And what measurements of the tip say: its motion and its error, and whether it has settled.
"""

import os
import weakref
from collections.abc import Callable
from contextlib import suppress
from math import dist, hypot, inf
from threading import Thread, current_thread, main_thread
from time import monotonic, sleep

import numpy as np
from gymnasium import spaces

from softrobot_env.hardware.driver import Driver
from softrobot_env.hardware.errors import (
    LinkError,
    RefusedError,
    RobotError,
    RobotFaultError,
    UnansweredError,
)
from softrobot_env.hardware.robot_file import RobotFile
from softrobot_env.hardware.tip import TipMeasurement, TipSource, make_tip_source
from softrobot_env.hardware.transport import Transport

#: The tip stands still where it moves by less than this [m] in this time [s].
STILL, STILL_TIME = 1.5e-3, 0.4

_LONGEST_REST = 10.0  # s, that a rig may swing
_FIRST_SIGHT = 2.0  # s
_POLL = 0.005  # s
_ESTOP_ECHO = 0.3  # s


class TooLateError(RobotError):
    """The policy missed too many control periods."""


class StaleError(RobotError):
    """Measurements are too old, or out of reach."""


class NotStillError(RobotError):
    """The tip does not come to rest."""


class TipFilter:
    """Position and velocity of the tip, from its measurements as control instants find them.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s], by difference to what the last instant with another picture found.
        time: [s], when the newest was taken.
    """

    def __init__(self, first: TipMeasurement, reach: spaces.Box, speed: float = inf) -> None:
        """Begin with a tip at rest.

        Args:
            first: The first measurement.
            reach: Positions (2,) [m] that the tip can have.
            speed: [m/s] that it can have.

        Raises:
            StaleError: The tip is out of reach.
        """
        self._reach, self._speed = reach, speed
        self._check(first)
        self.position, self.time = first.position, first.time
        self.velocity = np.zeros(2)

    def add(self, sight: TipMeasurement) -> None:
        """The newest measurement at the next instant; the same one again changes nothing.

        Raises:
            StaleError: The tip is out of reach, or too fast.
        """
        self._check(sight)
        passed = sight.time - self.time
        if passed > 0:
            velocity = (sight.position - self.position) / passed
            fast = hypot(*velocity)
            if not fast <= self._speed:
                raise StaleError(
                    f"the tip source says that the tip moves at {fast:.3g} m/s, allowed are "
                    f"{self._speed:.3g} m/s"
                )
            self.velocity = velocity
            self.position, self.time = sight.position, sight.time

    def _check(self, sight: TipMeasurement) -> None:
        if not self._reach.contains(sight.position):
            x, y = 1e3 * sight.position
            raise StaleError(f"the tip source says ({x:.0f}, {y:.0f}) mm, which is out of reach")


def reference_at(points: np.ndarray, step: float) -> np.ndarray:
    """Reference (2,) [m] at a fractional step, from its points (n + 1, 2) [m] at whole ones."""
    steps = np.arange(len(points))
    return np.array([np.interp(step, steps, column) for column in points.T])


def wait_for_rest(look: Callable[[], TipMeasurement | None], source: str) -> None:
    """Wait until the tip stands still.

    Args:
        look: The newest measurement of the tip, None before the first.
        source: What the robot file says of the tip source.

    Raises:
        LinkError: No measurement comes.
        NotStillError: The tip goes on moving.
    """
    begin = monotonic()
    since, place = begin, _first_sight(look, source).position
    while monotonic() - since < STILL_TIME:
        if monotonic() - begin > _LONGEST_REST:
            raise NotStillError(
                f"the tip still moves {_LONGEST_REST:g} s after a stop: more than "
                f"{1e3 * STILL:g} mm in {STILL_TIME:g} s"
            )
        sleep(_POLL)
        sight = look()
        if sight is not None and dist(sight.position, place) > STILL:
            since, place = monotonic(), sight.position


def _first_sight(look: Callable[[], TipMeasurement | None], source: str) -> TipMeasurement:
    end = monotonic() + _FIRST_SIGHT
    while monotonic() < end:
        sight = look()
        if sight is not None and monotonic() - sight.time < STILL_TIME:
            return sight
        sleep(_POLL)
    raise LinkError(
        f"no measurement of the tip in {_FIRST_SIGHT:g} s; the robot file's source is {source}"
    )


class _Opened:
    """What a session has opened, and will close."""

    def __init__(self) -> None:
        self.driver: Driver | None = None
        self.tip: TipSource | None = None

    def close_driver(self) -> None:
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()

    def close(self) -> None:
        tip, self.tip = self.tip, None
        try:
            self.close_driver()
        finally:
            if tip is not None:
                tip.close()


class RealSession:
    """A robot and its tip, opened when they are needed.

    A session that nobody refers to any more is closed.
    """

    def __init__(
        self, file: RobotFile, line: Callable[[], Transport], tip: TipSource | None
    ) -> None:
        """Nothing is opened yet.

        Args:
            file: The robot.
            line: Opens the way to it.
            tip: Measures the tip, instead of what the file names.
        """
        self.file, self._line = file, line
        self._range = np.array([[s.minimum, s.maximum] for s in file.tendons]).T
        self._given_tip, self._opened = tip, _Opened()
        self._owner = os.getpid()
        weakref.finalize(self, _abandon, self._opened, self._owner).atexit = False

    @property
    def driver(self) -> Driver | None:
        """The open driver, None before the first episode and after a lost line."""
        return self._opened.driver

    def check_process(self) -> None:
        """Raise RuntimeError in a forked child, where nobody listens to the robot."""
        if os.getpid() != self._owner:
            raise RuntimeError(
                f"this robot is driven by process {self._owner}, and not by this child of it, "
                f"{os.getpid()}"
            )

    @property
    def _tip(self) -> TipSource | None:
        return self._opened.tip if self._given_tip is None else self._given_tip

    # ------------------------------------------------------------------ between episodes

    def prepare(self, clear: bool) -> None:
        """Connected, disarmed, and the tip standing still.

        Args:
            clear: Whether to clear a latched fault.

        Raises:
            RobotFaultError: A fault is latched and not to be cleared, or cannot be.
            RobotError: No answer, no tip, or no rest.
        """
        if clear and self.driver is not None:
            self._revive()
        if self.driver is None:
            self._open(clear)
        if self.driver.fault is not None:
            raise RobotFaultError(self.driver.fault)
        self.driver.stop()
        named = self.file.tip
        wait_for_rest(self.sight, f"{named.kind!r} with {dict(named.options)}")

    def _open(self, clear: bool) -> None:
        if self._tip is None:
            try:
                self._opened.tip = make_tip_source(self.file.tip.kind, self.file.tip.options)
            except OSError as error:
                raise LinkError(f"the tip source does not open: {error}") from error
        self._opened.driver = Driver(self.file, self._line())
        try:
            self.driver.connect()
            if clear and self.driver.fault is not None:
                self.driver.clear()
        except BaseException:
            self._opened.close_driver()
            raise

    def _revive(self) -> None:
        """Clear a fault and begin a new connection; one that is broken is closed instead.

        Raises:
            RefusedError: The fault's cause is still there.
        """
        try:
            self.driver.stop()
            self.driver.clear()
            self.driver.connect()
        except RefusedError:
            raise
        except RobotError:
            self._opened.close_driver()

    def close(self) -> None:
        """Ramp down and close everything; twice is harmless."""
        self._opened.close()

    # ------------------------------------------------------------------ in an episode

    def command(self, length: np.ndarray, deadline: float) -> tuple[bool, float | None]:
        """Send lengths (n,) [m], as far as the robot file's range allows, and await the answer.

        Nothing is sent while the robot is slow to answer what was sent before; measurements that
        grow too old will tell.

        Args:
            length: (n,) [m].
            deadline: [s] of waiting.

        Returns:
            Whether the range limited them, and the time [s] until the robot answered; None if it
            has not in time.

        Raises:
            RobotFaultError: The robot has stopped.
        """
        allowed, answer = np.clip(length, *self._range), None
        with suppress(UnansweredError):
            answer = self.driver.wait_for(self.driver.command(allowed), deadline)
        if self.driver.fault is not None:
            raise RobotFaultError(self.driver.fault)
        limited = bool(np.any(allowed != length))
        return limited, None if answer is None else answer.round_trip

    def sight(self) -> TipMeasurement | None:
        """The newest measurement of the tip."""
        reading = self.driver.reading
        if reading is None:
            return self._tip.latest(None, monotonic())
        return self._tip.latest(tuple(reading.adc.tolist()), reading.taken)

    @property
    def tip_refused(self) -> int:
        """What the tip source got since it was opened and could not use."""
        return getattr(self._tip, "refused", 0)

    def end(self) -> None:
        """Ramp down; a line that is lost is left to the watchdog."""
        with suppress(RobotError):
            self.driver.stop()

    def emergency_stop(self) -> None:
        """Cut the power, and wait a little for the robot to say that it has.

        A line that is lost is left to the watchdog.
        """
        if self.driver is None:
            return
        with suppress(RobotError):
            self.driver.estop()
            self.driver.wait_for_fault(_ESTOP_ECHO)


def _abandon(opened: _Opened, owner: int) -> None:
    """Close what a lost session has left open, in the process that opened it.

    Garbage is collected by any thread, also by the one that listens to the robot, whose help
    closing needs.
    """
    if os.getpid() != owner:
        return
    if current_thread() is main_thread():
        opened.close()
    else:
        Thread(target=opened.close, name="close robot").start()
