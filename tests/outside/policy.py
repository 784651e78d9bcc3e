"""A policy of one's own, in one file: proportional control of two tip coordinates."""

import numpy as np

from softrobot_env import register_policy


class Proportional:
    """Pulls towards the reference, by a gain."""

    environment = {"control_period": 0.02}  # noqa: RUF012

    def __init__(self, robot, control_period, gain=2.0):
        self.inputs, self.gain = len(robot.tendons) // 2, gain

    def act(self, observation):
        error = observation["reference"] - observation["tip_position"]
        return np.full(self.inputs, np.clip(self.gain * error[0], -1, 1), np.float32)


def register():
    """What an entry point of the group `softrobot_env` names."""
    register_policy("proportional", Proportional)
