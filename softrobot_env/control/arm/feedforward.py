"""Inverse statics as feedforward: the tensions that hold the tip at the present reference."""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import (
    ConstantCurvatureStatics,
    InverseStatics,
)
from softrobot_env.control.base import Controller, usable
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams

#: Status of a policy that was shown something that is no number.
NOT_FINITE = "observation not finite"


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
        self.sizes = {"reference": 2, "previous_action": self._statics.n_inputs}

    def start(self, observation: Observation) -> FeedforwardState:
        """Begin from the inputs in force."""
        inputs = usable(observation["previous_action"]) * self._statics.limit
        return FeedforwardState(np.full(2, np.nan), InverseStatics(inputs, 0.0, True), None)

    def act(
        self, observation: Observation, state: FeedforwardState
    ) -> tuple[np.ndarray, FeedforwardState]:
        """Statics of the present reference."""
        action = keep_if_not_finite(observation, self.requires)
        if action is not None:
            return action, replace(state, status=NOT_FINITE)
        solution = self.solve(observation["reference"], state)
        action, saturated = saturate(solution.reduced / self._statics.limit)
        status = explain(solution, saturated)
        return action, FeedforwardState(observation["reference"].copy(), solution, status)

    def solve(self, target: np.ndarray, state: FeedforwardState) -> InverseStatics:
        """Inverse statics of a target (2,) [m], reused while the target rests."""
        if np.array_equal(target, state.target):
            return state.statics
        return self._statics.inverse(target, state.statics.reduced)


def keep_if_not_finite(observation: Observation, names: tuple[str, ...]) -> np.ndarray | None:
    """The previous action, or zero, if a named observable is not finite; else None."""
    if all(np.isfinite(observation[name]).all() for name in names):
        return None
    return usable(observation["previous_action"])


def saturate(action: np.ndarray) -> tuple[np.ndarray, bool]:
    """Limit an action to [-1, 1], and tell whether that changed it."""
    limited = np.clip(action, -1.0, 1.0)
    return limited, bool(np.any(limited != action))


def explain(solution: InverseStatics, saturated: bool) -> str | None:
    """Why an action falls short, for people; None if it does not."""
    if not solution.converged:
        return "reference out of reach"
    return "tension limit reached" if saturated else None


def make_feedforward(robot: RobotParams, control_period: float) -> Feedforward:
    """The policy of a robot; it works at any control period [s]."""
    return Feedforward(robot)
