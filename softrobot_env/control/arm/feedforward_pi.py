"""Inverse statics plus PI feedback on the tip position (the structure of thesis sec. 6.1)."""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.arm.feedforward import (
    NOT_FINITE,
    Feedforward,
    FeedforwardState,
    explain,
    keep_if_not_finite,
    saturate,
)
from softrobot_env.control.base import Controller
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams


@dataclass(frozen=True)
class FeedforwardPIState:
    """What the next call needs.

    Attributes:
        feedforward: State of the feedforward part.
        integral: (2,) [m s], integrated tip error.
        status: Why the action is not the one wanted, or None.
    """

    feedforward: FeedforwardState
    integral: np.ndarray
    status: str | None


class FeedforwardPI(Controller):
    """u = u_ff(z_ref) + J+ (K_P e + K_I int e dt), e = z_ref - z.

    J is the static tip Jacobian at u_ff; J+ is damped, because J loses rank in the straight pose.
    The error is integrated only while no tension is at its limit (no wind-up).

    Quasi-statically the plant from J+ e to e has unit gain, and its first mode (frequency w,
    damping rate mu w^2) limits both gains: an action held for a period T acts T / 2 late on
    average, which takes K_P w^2 T / 2 from the damping rate, so K_P < 2 mu / T; pure integral
    action needs K_I < mu w^2. The default gains are fractions of these limits, and K_P at most 2.
    They track better than feedforward alone but damp nothing, so that a step swings longer.
    """

    requires = ("reference", "previous_action", "tip_position")

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        proportional: float | None = None,
        integral: float | None = None,
        damping: float = 1e-3,
    ) -> None:
        """Set the gains.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit.
            damping: [m/N], singular values of J well below it are not inverted.
        """
        self._feedforward = Feedforward(robot)
        self._statics = ConstantCurvatureStatics(robot)
        self.sizes = {**self._feedforward.sizes, "tip_position": 2}
        self._period = control_period
        decay = robot.damping_time * (2 * np.pi * robot.first_frequency) ** 2
        gain = min(2.0, 0.8 * robot.damping_time / control_period)
        self._proportional = gain if proportional is None else proportional
        self._integral = 0.45 * decay if integral is None else integral
        self._damping = damping

    def start(self, observation: Observation) -> FeedforwardPIState:
        """Begin without integrated error."""
        return FeedforwardPIState(self._feedforward.start(observation), np.zeros(2), None)

    def act(
        self, observation: Observation, state: FeedforwardPIState
    ) -> tuple[np.ndarray, FeedforwardPIState]:
        """Feedforward plus feedback."""
        action = keep_if_not_finite(observation, self.requires)
        if action is not None:
            return action, replace(state, status=NOT_FINITE)
        target = observation["reference"].copy()
        error = target - observation["tip_position"]
        solution = self._feedforward.solve(target, state.feedforward)
        integral = state.integral + self._period * error
        feedback = self._proportional * error + self._integral * integral
        inputs = solution.reduced + self._pull_back(solution.reduced, feedback)
        action, saturated = saturate(inputs / self._statics.limit)
        status = explain(solution, saturated)
        return action, FeedforwardPIState(
            FeedforwardState(target, solution, status),
            state.integral if saturated else integral,
            status,
        )

    def _pull_back(self, inputs: np.ndarray, tip_change: np.ndarray) -> np.ndarray:
        """Input change (n_inputs,) [N] that moves the tip by (2,) [m], damped."""
        jacobian = self._statics.jacobian(inputs)
        square = jacobian @ jacobian.T + self._damping**2 * np.eye(2)
        return jacobian.T @ np.linalg.solve(square, tip_change)
