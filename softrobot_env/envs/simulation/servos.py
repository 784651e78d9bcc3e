"""Position servos that wind up tendons: limited speed, offset and backlash."""

import numpy as np


class Servos:
    """n servos; the pull-in of a horn is the length of tendon it has wound up.

    The motor turns towards the command, not faster than `speed`. Play of width `backlash` lies
    between motor and horn: the horn stays while the motor crosses the play, and follows it at
    half the width behind. The horn pulls in `offset` more than it believes. How much a servo can
    pull is the scene's matter (the tendons' `tension_limit`).

    Attributes:
        motor, horn: (n,) [m], pulled in now.
    """

    def __init__(self, speed: float, offset: np.ndarray, backlash: np.ndarray) -> None:
        """Servos at command zero.

        Args:
            speed: [m/s].
            offset: (n,) [m].
            backlash: (n,) [m].
        """
        self._speed = speed
        self._offset = np.array(offset, dtype=float)
        self._half = np.array(backlash, dtype=float) / 2
        self.start(np.zeros(len(self._offset)))

    def start(self, command: np.ndarray) -> None:
        """At rest at a command (n,) [m], in the middle of the play."""
        self.motor = self._offset + command
        self.horn = self.motor.copy()

    @property
    def reading(self) -> np.ndarray:
        """(n,) [m], as read by potentiometers on the motors: they miss offset and play."""
        return self.motor - self._offset

    def move(self, command: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Follow a command (n,) [m] until the last of some times.

        Args:
            command: [m], held from now on.
            times: (k,) [s] after now, increasing.

        Returns:
            Pull-in (1 + j, n) [m] of the horns now and at the first j times, up to the one at which
            all motors have arrived.
        """
        way = self._offset + command - self.motor
        arrival = np.abs(way).max() / self._speed
        moving = min(len(times), int(np.searchsorted(times, arrival)) + 1)
        most = self._speed * times[:moving, None]
        # The motors turn one way, so each horn is pushed by one side of the play at most.
        motors = self.motor + np.clip(way, -most, most)
        horns = np.clip(self.horn, motors - self._half, motors + self._half)
        path = np.concatenate((self.horn[None], horns))
        self.motor, self.horn = motors[-1], horns[-1]
        return path
