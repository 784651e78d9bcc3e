"""Inverse model of a robot's drives: commands that put its tendons where they should be."""

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams

from .motion import TURNING, ahead_of

SLOW, WEAK = "servo too slow", "force limit of a servo reached"


class Commands:
    """Commands that make servo horns move as wanted; tensions need no correction.

    A servo without a gain needs time to get to its command. The command of one with a gain, see
    `scene.integration.motors`, leads by the force that moves its motor, over the gain:

        c = x + (m x'' + D x' + (1 + 2 a x) T + friction) / K,

    and by half a count of its encoder; the caller has to look ahead by its dead time. Tendons lag
    by half of the backlash, and by their constant friction over their stiffness.

    Attributes:
        late: [s], dead time from a command to the control loop.
        speed: [m/s], of servos; inf for other drives.
    """

    def __init__(self, robot: RobotParams, period: float) -> None:
        """Commands are held for a period [s]."""
        self._drive, self._period = robot.drive, period
        self.late, self.speed = robot.drive.command_delay, robot.drive.speed
        self._ideal = robot.drive.kind != "length"
        if not self._ideal:
            self._friction = robot.of_tendons("friction")
            give = self._friction / robot.of_tendons("stiffness")
            self._lag = robot.drive.backlash / 2 + give
            self._ideal = np.isinf(robot.drive.speed) and not self._lag.any()
            self._ideal &= robot.drive.gain is None

    def leading(
        self, wanted: ndarray, tension: ndarray, before: ndarray | None, rate: ndarray | None
    ) -> tuple[ndarray, ndarray | None, str | None]:
        """Commands (m,), the rate (m,) of the wanted values, and what drives cannot do, or None.

        Args:
            wanted: (m,) [m], positions of the horns in the middle of the period; or tensions [N].
            tension: (m,) [N], at the drives.
            before: The wanted values a period ago; None at the start.
            rate: Their rate, as returned then.
        """
        if self._ideal:
            return wanted, None, None
        drive, speed = self._drive, self.speed
        now = np.zeros_like(wanted) if before is None else (wanted - before) / self._period
        reason = SLOW if np.abs(now).max() > speed else None
        if drive.gain is None:
            return wanted + ahead_of(now, self._period, speed, self._lag), now, reason
        able = np.clip(now, -speed, speed)
        change = 0.0 if rate is None else (able - np.clip(rate, -speed, speed)) / self._period
        way = np.tanh(able / TURNING)
        load = (1 + 2 * drive.layers * wanted) * (tension + self._friction * way)
        force = drive.reflected_mass * change + load + drive.gear_friction * way
        count = drive.encoder_step / 2 * np.sign(force)
        ahead = (force + drive.velocity_gain * able) / drive.gain + count + self._lag * way
        weak = np.abs(force).max() > drive.force_limit
        return wanted + ahead, now, reason or (WEAK if weak else None)
