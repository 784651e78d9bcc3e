"""Inverse statics as feedforward, alone or with PI feedback (the structure of thesis sec. 6.1)."""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.arm.statics import InverseStatics, least_norm
from softrobot_env.control.base import Controller, usable
from softrobot_env.control.status import NOT_FINITE, REASONS, SATURATED, UNREACHABLE
from softrobot_env.fields import NotNegative, Positive, check_argument
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams

#: [m/N], singular values of J well below it are not inverted.
_DAMPING = 1e-3


@dataclass(frozen=True)
class FeedforwardState:
    """What the next call needs.

    Attributes:
        target: (2,) [m], reference that `statics` belongs to.
        statics: Inputs that hold the tip there.
        integral: (2,) [m s], integrated tip error; zero without feedback.
        status: Why the action is not the one wanted, or None.
    """

    target: np.ndarray
    statics: InverseStatics
    integral: np.ndarray
    status: str | None


class Feedforward(Controller):
    """The tensions of least norm that hold the tip at the present reference.

    Follows the inverse along the reference by warm starts. Out of reach, the inputs of the
    smallest residual are held and the state's `status` says so.
    """

    requires = ("reference", "previous_action")

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """At any control period [s]; ValueError for robots without constant-curvature statics."""
        self._statics = ConstantCurvatureStatics(robot)
        self.sizes = {"reference": 2, "previous_action": self._statics.n_inputs}

    def start(self, observation: Observation) -> FeedforwardState:
        """Begin from the inputs in force."""
        inputs = usable(observation["previous_action"]) * self._statics.limit
        in_force = InverseStatics(inputs, 0.0, True)
        return FeedforwardState(np.full(2, np.nan), in_force, np.zeros(2), None)

    def act(
        self, observation: Observation, state: FeedforwardState
    ) -> tuple[np.ndarray, FeedforwardState]:
        """Statics of the present reference, with feedback if there is any."""
        if not all(np.isfinite(observation[name]).all() for name in self.requires):
            kept = usable(observation["previous_action"])
            return kept, replace(state, status=REASONS[NOT_FINITE])
        target, statics = observation["reference"].copy(), state.statics
        if not np.array_equal(target, state.target):  # it rests most of the time
            statics = least_norm(self._statics, target, statics.reduced)
        inputs, integral = self._correct(observation, statics.reduced, state.integral)
        wanted = inputs / self._statics.limit
        action, status = np.clip(wanted, -1.0, 1.0), None
        if np.any(action != wanted):
            integral, status = state.integral, REASONS[SATURATED]
        if not statics.converged:
            status = REASONS[UNREACHABLE]
        return action, FeedforwardState(target, statics, integral, status)

    def _correct(
        self, observation: Observation, inputs: np.ndarray, integral: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (n_inputs,) [N] after feedback, and the integrated error (2,) [m s]."""
        return inputs, integral


class FeedforwardPI(Feedforward):
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
    ) -> None:
        """Set the gains.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit.
        """
        super().__init__(robot, control_period)
        check_argument("control_period", control_period, Positive)
        check_argument("proportional", proportional, NotNegative | None)
        check_argument("integral", integral, NotNegative | None)
        self.sizes = {**self.sizes, "tip_position": 2}
        self._period = control_period
        decay = robot.damping_time * (2 * np.pi * robot.first_frequency) ** 2
        gain = min(2.0, 0.8 * robot.damping_time / control_period)
        self._proportional = gain if proportional is None else proportional
        self._integral = 0.45 * decay if integral is None else integral

    def _correct(
        self, observation: Observation, inputs: np.ndarray, integral: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `Feedforward`; J+ is damped."""
        error = observation["reference"] - observation["tip_position"]
        integral = integral + self._period * error
        jacobian = self._statics.jacobian(inputs)
        square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(2)
        change = self._proportional * error + self._integral * integral
        return inputs + jacobian.T @ np.linalg.solve(square, change), integral
