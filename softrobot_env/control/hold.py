"""Hold still: keep whatever action is in force at the start."""

import numpy as np

from softrobot_env.control.base import Controller, usable
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams


class Hold(Controller):
    """Repeat the action in force; the baseline that any controller has to beat."""

    requires = ("previous_action",)

    def start(self, observation: Observation) -> np.ndarray:
        """The action to keep."""
        return usable(observation["previous_action"])

    def act(self, observation: Observation, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The kept action."""
        return state.copy(), state


def make_hold(robot: RobotParams, control_period: float) -> Hold:
    """The policy holds any robot, at any control period [s]."""
    return Hold()
