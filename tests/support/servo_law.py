"""The law of position servos in closed form, for a control period at a time."""

import numpy as np
from numpy import ndarray


class ServoLaw:
    """n servos of limited speed, with offset and backlash, see `scene.servos`.

    Attributes:
        motor, horn: (n,) [m], pulled in now.
    """

    def __init__(self, speed: float, offset: ndarray, backlash: ndarray) -> None:
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

    def start(self, command: ndarray) -> None:
        """At rest at a command (n,) [m], in the middle of the backlash."""
        self.motor = self._offset + command
        self.horn = self.motor.copy()

    def move(self, command: ndarray, times: ndarray) -> ndarray:
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
        # The motors turn one way, so each horn is pushed by one side of the backlash at most.
        motors = self.motor + np.clip(way, -most, most)
        horns = np.clip(self.horn, motors - self._half, motors + self._half)
        path = np.concatenate((self.horn[None], horns))
        self.motor, self.horn = motors[-1], horns[-1]
        return path
