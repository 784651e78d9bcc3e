"""Inverse statics as feedforward: the tensions that hold the tip at the present reference."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics, InverseStatics
from softrobot_env.control.base import Controller
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams


@dataclass(frozen=True)
class FeedforwardState:
    """What the next call needs.

    Attributes:
        target: (2,) [m], reference that `statics` belongs to.
        statics: Inputs that hold the tip there.
        status: Why the action is not the one wanted, or None.
    """

    target: np.ndarray
    statics: InverseStatics
    status: str | None


class Feedforward(Controller):
    """Constant-curvature inverse statics, redundancy resolved by minimum tension norm.

    Follows the inverse along the reference by warm starts. Out of reach, the inputs of the
    smallest residual are held and the state's `status` says so.
    """

    requires = ("reference", "previous_action")

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError for robots without constant-curvature statics."""
        self._statics = ConstantCurvatureStatics(robot)

    def start(self, observation: Observation) -> FeedforwardState:
        """Begin from the inputs in force."""
        inputs = observation["previous_action"] * self._statics.limit
        return FeedforwardState(np.full(2, np.nan), InverseStatics(inputs, 0.0, True), None)

    def act(
        self, observation: Observation, state: FeedforwardState
    ) -> tuple[np.ndarray, FeedforwardState]:
        """Statics of the present reference."""
        solution = self.solve(observation["reference"], state)
        action, saturated = saturate(solution.reduced / self._statics.limit)
        status = explain(solution, saturated)
        return action, FeedforwardState(observation["reference"], solution, status)

    def solve(self, target: np.ndarray, state: FeedforwardState) -> InverseStatics:
        """Inverse statics of a target (2,) [m], reused while the target rests."""
        if np.array_equal(target, state.target):
            return state.statics
        return self._statics.inverse(target, state.statics.reduced)


def saturate(action: np.ndarray) -> tuple[np.ndarray, bool]:
    """Limit an action to [-1, 1], and tell whether that changed it."""
    limited = np.clip(action, -1.0, 1.0)
    return limited, bool(np.any(limited != action))


def explain(solution: InverseStatics, saturated: bool) -> str | None:
    """Why an action falls short, for people; None if it does not."""
    if not solution.converged:
        return f"reference out of reach by {1e3 * solution.residual:.1f} mm"
    return "tension limit reached" if saturated else None
