"""A task of one's own, in one file: the tip goes to and fro on a line."""

from dataclasses import dataclass

import numpy as np

from softrobot_env import register_task
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.tasks import Task


@dataclass(frozen=True)
class ToAndFro:
    """A sine along x about the straight robot's tip; `size` and `height` in m, `rate` in rad/s."""

    size: float
    height: float
    rate: float

    def position(self, t):
        return self._along(np.sin(self.rate * t), self.height)

    def velocity(self, t):
        return self._along(self.rate * np.cos(self.rate * t))

    def acceleration(self, t):
        return self._along(-(self.rate**2) * np.sin(self.rate * t))

    def path(self):
        return self.position(np.linspace(0, 2 * np.pi / self.rate, 50))

    def _along(self, x, height=0.0):
        return np.stack([self.size * x, 0 * x, np.full_like(x, height)], axis=-1)


def to_and_fro(robot, size=0.02, period=2.0):
    """Of any planar robot."""
    run = ToAndFro(size, robot.length, 2 * np.pi / period)
    start = tuple(robot_inputs(robot).input_centre)
    return Task("to_and_fro", robot, run, 2 * period, start)


def register():
    """What an entry point of the group `softrobot_env` names."""
    register_task("to_and_fro", to_and_fro)
