"""The real rig as an environment uses it: microcontroller, tip source, and waiting for rest."""

from collections.abc import Callable
from contextlib import suppress
from math import dist
from time import monotonic, sleep
from typing import Any

import numpy as np

from softrobot_env.hardware.config import RobotFile
from softrobot_env.hardware.driver import Driver
from softrobot_env.hardware.errors import LinkError, RobotError, RobotFaultError, UnansweredError
from softrobot_env.hardware.messages import Capability
from softrobot_env.hardware.readings import Reading
from softrobot_env.hardware.tip import Sight, TipSource, make_tip_source
from softrobot_env.hardware.transport import Transport

#: The tip stands still where it moves by less than this [m] in this time [s].
STILL, STILL_TIME = 1.5e-3, 0.4

_LONGEST_REST = 10.0  # s, that a rig may swing
_FIRST_SIGHT = 2.0  # s
_ESTOP_ECHO = 0.3  # s
_POLL = 0.005  # s


class StaleError(RobotError):
    """Measurements are too old to be used."""


class TooLateError(RobotError):
    """The policy missed too many control periods."""


class NotStillError(RobotError):
    """The tip does not come to rest."""


class RealSession:
    """A robot, driven set-point by set-point, and its tip."""

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
        self._given_tip, self._tip = tip, None
        self._driver: Driver | None = None
        self.capabilities = Capability(0)

    # ------------------------------------------------------------------ between episodes

    def prepare(self, clear: bool) -> None:
        """Connected, disarmed, and the tip standing still.

        Args:
            clear: Whether to clear a latched fault.

        Raises:
            RobotFaultError: A fault is latched and not to be cleared, or cannot be.
            RobotError: No answer, no tip, or no rest.
        """
        if clear and self._driver is not None and self._driver.fault is not None:
            self._clear()
        if self._driver is None:
            self._connect(clear)
        if self._driver.fault is not None:
            raise RobotFaultError(self._driver.fault)
        self._driver.stop()
        self._wait_for_rest()

    def _connect(self, clear: bool) -> None:
        driver = Driver(self.file, self._line())
        try:
            self.capabilities = driver.connect().capabilities
            if clear and driver.fault is not None:
                driver.clear()
        except BaseException:
            driver.close()
            raise
        self._driver = driver
        if self._tip is None:
            named = self.file.tip
            self._tip = self._given_tip or make_tip_source(named.kind, named.options)

    def _clear(self) -> None:
        """Clear a fault; a line that is lost is opened anew."""
        try:
            self._driver.clear()
        except LinkError:
            self._driver.close()
            self._driver = None

    def _wait_for_rest(self) -> None:
        begin = monotonic()
        since, place = begin, self._first_sight().position
        while monotonic() - since < STILL_TIME:
            if monotonic() - begin > _LONGEST_REST:
                raise NotStillError(
                    f"the tip still moves {_LONGEST_REST:g} s after a stop: more than "
                    f"{1e3 * STILL:g} mm in {STILL_TIME:g} s"
                )
            sleep(_POLL)
            sight = self.sight()
            if sight is not None and dist(sight.position, place) > STILL:
                since, place = monotonic(), sight.position

    def _first_sight(self) -> Sight:
        end = monotonic() + _FIRST_SIGHT
        while monotonic() < end:
            sight = self.sight()
            if sight is not None and monotonic() - sight.time < STILL_TIME:
                return sight
            sleep(_POLL)
        raise LinkError(
            f"no measurement of the tip in {_FIRST_SIGHT:g} s; the robot file's source is "
            f"{self.file.tip.kind!r} with {dict(self.file.tip.options)}"
        )

    def close(self) -> None:
        """Ramp down and close everything; twice is harmless."""
        driver, self._driver = self._driver, None
        tip, self._tip = self._tip, None
        try:
            if driver is not None:
                driver.close()
        finally:
            if tip is not None and tip is not self._given_tip:
                tip.close()

    # ------------------------------------------------------------------ in an episode

    def arm(self) -> None:
        """Begin to follow set-points."""
        self._driver.arm()

    def command(self, length: np.ndarray, deadline: float) -> bool:
        """Send lengths (n,) [m], as far as the robot file's range allows, and await the answer.

        Nothing is sent while the robot is slow to answer what was sent before; measurements that
        grow too old will tell.

        Args:
            length: (n,) [m].
            deadline: [s] of waiting.

        Returns:
            Whether the range limited it.

        Raises:
            RobotFaultError: The robot has stopped.
        """
        allowed = np.clip(length, *self._range)
        with suppress(UnansweredError):
            self._driver.wait_for(self._driver.command(allowed), deadline)
        if self._driver.fault is not None:
            raise RobotFaultError(self._driver.fault)
        return bool(np.any(allowed != length))

    @property
    def reading(self) -> Reading:
        """What the microcontroller said last."""
        return self._driver.reading

    def sight(self) -> Sight | None:
        """The newest measurement of the tip."""
        reading = self._driver.reading
        if reading is None:
            return self._tip.latest(None, monotonic())
        return self._tip.latest(tuple(reading.adc.tolist()), reading.time)

    def link(self) -> dict[str, Any]:
        """Counters of the line."""
        return self._driver.link

    def end(self) -> None:
        """Ramp down; a line that is lost is left to the watchdog."""
        with suppress(RobotError):
            self._driver.stop()

    def emergency_stop(self) -> None:
        """Cut the power, and wait a little for the robot to say that it has.

        A line that is lost is left to the watchdog.
        """
        if self._driver is None:
            return
        end = monotonic() + _ESTOP_ECHO
        with suppress(RobotError):
            self._driver.estop()
            while self._driver.fault is None and monotonic() < end:
                sleep(_POLL)
