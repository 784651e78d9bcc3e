"""The real rig as an environment uses it: microcontroller and tip source."""

import os
import weakref
from collections.abc import Callable
from contextlib import suppress
from threading import Thread, current_thread, main_thread
from time import monotonic

import numpy as np

from softrobot_env.envs.real.tip_filter import wait_for_rest
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

_ESTOP_ECHO = 0.3  # s


class TooLateError(RobotError):
    """The policy missed too many control periods."""


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
