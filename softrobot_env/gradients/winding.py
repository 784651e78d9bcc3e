"""Derivatives of what ideal servos wind, see `scene.integration.period.wind`."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.scene.integration import layout
from softrobot_env.scene.servos import Servos


class Turns(NamedTuple):
    """Servos at the beginning of a control period; all (nu,) [m].

    Attributes:
        speed, half: [m/s], half of the backlash.
        motor, horn, goal: Where they are, and what the motor turns to.
    """

    speed: ndarray
    half: ndarray
    motor: ndarray
    horn: ndarray
    goal: ndarray

    @classmethod
    def of(cls, servos: Servos) -> "Turns":
        """Servos as they are."""
        rows = servos.block[0].copy()
        goal = rows[layout.OFFSET] + rows[layout.COMMAND]
        return cls(
            rows[layout.SPEED], rows[layout.HALF], rows[layout.MOTOR], rows[layout.HORN], goal
        )

    def rates(self, tick: float, most: int) -> tuple[ndarray, ndarray]:
        """Derivatives by motor, horn and goal of a path, and of where the motors end.

        Args:
            tick: [s], between rows of the path.
            most: Of them.

        Returns:
            (rows, 3, nu) and (3, nu).
        """
        arrival = np.max(np.abs(self.goal - self.motor) / self.speed, initial=0.0)
        steps = 1
        while steps < most and steps * tick < arrival:
            steps += 1
        path = np.zeros((1 + steps, 3, len(self.motor)))
        path[0, 1] = 1.0
        turned = np.zeros((3, len(self.motor)))
        for k in range(1, 1 + steps):
            reach = self.speed * (k * tick)
            way = self.goal - self.motor
            free = np.abs(way) <= reach
            motor = self.motor + np.clip(way, -reach, reach)
            held = (motor - self.half < self.horn) & (self.horn < motor + self.half)
            turned = np.stack([~free, np.zeros_like(free), free]).astype(float)
            path[k] = np.where(held, [[0.0], [1.0], [0.0]], turned)
        return path, turned
