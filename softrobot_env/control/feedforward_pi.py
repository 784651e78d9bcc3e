"""Inverse statics plus PI feedback on the tip position (the structure of thesis sec. 6.1)."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.base import Controller
from softrobot_env.control.feedforward import Feedforward, FeedforwardState, explain, saturate
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

    Quasi-statically the plant from J+ e to e has unit gain; the arm's first resonance raises it to
    1 / (2 zeta), so that pure integral action would need K_I < 2 zeta w_1 = 1.3 1/s. The default
    gains were chosen by a scan over the arm's tasks and Young's moduli of 0.5 to 1.5 times nominal:
    more proportional gain tracks better but fails on large steps.
    """

    requires = ("reference", "previous_action", "tip_position")

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        proportional: float = 2.0,
        integral: float = 0.6,
        damping: float = 1e-3,
    ) -> None:
        """Set the gains.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            proportional: K_P [1].
            integral: K_I [1/s].
            damping: [m/N], singular values of J well below it are not inverted.
        """
        self._feedforward = Feedforward(robot)
        self._statics = ConstantCurvatureStatics(robot)
        self._period = control_period
        self._proportional = proportional
        self._integral = integral
        self._damping = damping

    def start(self, observation: Observation) -> FeedforwardPIState:
        """Begin without integrated error."""
        return FeedforwardPIState(self._feedforward.start(observation), np.zeros(2), None)

    def act(
        self, observation: Observation, state: FeedforwardPIState
    ) -> tuple[np.ndarray, FeedforwardPIState]:
        """Feedforward plus feedback."""
        target = observation["reference"]
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
