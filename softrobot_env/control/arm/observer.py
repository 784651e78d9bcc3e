"""Output feedback: policies of the full state, given tip and curvatures only.

A Kalman filter on the arm's equations of motion estimates the curvature rates.
"""

from math import ceil
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from softrobot_env.beams.closed_forms.planar_arm import PlanarArm, inertia_forces, make_planar_arm
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.control.arm.operating_points import linear_model
from softrobot_env.control.base import Controller, usable
from softrobot_env.control.limits import finite
from softrobot_env.control.linear_quadratic import discretized
from softrobot_env.fields import Positive, Range, check_argument
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

if TYPE_CHECKING:
    from softrobot_env.control.scheduled.observer import LinearObserver

#: [s], longest step of the prediction.
_STEP = 1e-3

#: Standard deviations between prediction and measurement that make an outlier; at least a
#: hundredth of the curvature limit has to lie between them.
_OUTLIER = 10.0

#: Outliers in a row that are ignored.
_PATIENCE = 3

#: Standard deviations, of which the squares can be computed with.
_Deviation = Annotated[float, Range("in (0, 1e6]", lambda x: 0 < x <= 1e6)]


class RateObserver:
    """Estimates curvatures, their rates and unexplained forces on them.

    Predicts with the nonlinear model of the nominal arm (linearly implicit Euler, whose steps the
    stiffness does not limit), corrects with the stationary Kalman gain of the straight arm. The
    forces d are a random walk, so that the estimates have no offset where the model is wrong.

    A curvature far from its prediction is taken for an outlier, up to three times in a row; then
    the estimate begins anew from what is measured, at rest.

    Attributes:
        in_force: Observable that says what was applied.
    """

    in_force = "previous_action"

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        curvature_noise: float = 1e-2,
        force_walk: float = 0.5,
    ) -> None:
        """Compute the gain.

        Args:
            robot: Nominal robot.
            control_period: [s] between two updates.
            curvature_noise: [1/m], standard deviation of the measured curvatures.
            force_walk: [1/s^0.5], growth of the deviation of d, over the full actuation. More
                follows a wrong model faster and lets more noise through.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("curvature_noise", curvature_noise, _Deviation)
        check_argument("force_walk", force_walk, _Deviation)
        self._arm = make_planar_arm(robot)
        self._limit = TendonMap(robot).input_scale
        self._period = control_period
        walk = force_walk * np.max(self._arm.inputs @ self._limit)
        self._gain, deviation = _stationary_gain(self._arm, control_period, curvature_noise, walk)
        self._limits = np.array([_OUTLIER * deviation, 0.01 * robot.curvature_limit])

    def start(self, curvature: np.ndarray) -> np.ndarray:
        """Estimate (4, n), at rest: curvature [1/m], rate [1/(m s)], force [N m2], outliers.

        The last row holds the number of outliers in a row.
        """
        estimate = np.zeros((4, self._arm.n))
        estimate[0] = usable(curvature)
        return estimate

    def update(self, estimate: np.ndarray, action: np.ndarray, curvature: np.ndarray) -> np.ndarray:
        """Next estimate (4, n).

        Args:
            estimate: (4, n), the one before.
            action: (n_inputs,) [1], applied since then.
            curvature: (n,) [1/m], measured now; where it is not finite it is predicted only.
        """
        steps = ceil(self._period / _STEP - 1e-9)
        return _update(
            self._arm,
            self._period,
            steps,
            self._gain,
            float(np.max(self._limits)),
            estimate,
            usable(action) * self._limit,
            np.ascontiguousarray(curvature),
        )


def rate_observer(robot: RobotParams, control_period: float) -> "RateObserver | LinearObserver":
    """The observer of a robot: nonlinear of planar arms in closed form, linear of others.

    Args:
        robot: Nominal robot.
        control_period: [s] between two updates.
    """
    try:
        return RateObserver(robot, control_period)
    except ValueError:
        from softrobot_env.control.scheduled.observer import LinearObserver

        return LinearObserver(robot, control_period)


class ObservedState(NamedTuple):
    """State of `OutputFeedback`.

    Attributes:
        estimate: (4, n), of the observer; the second row are the rates.
        inner: State of the policy.
    """

    estimate: np.ndarray
    inner: Any

    @property
    def status(self) -> str | None:
        """Why the action is not the one wanted, or None."""
        return getattr(self.inner, "status", None)


class OutputFeedback(Controller):
    """A policy whose curvature rates come from an observer.

    The observer goes on in every control period, also while the policy holds its action.
    Policies that estimate unexplained forces themselves then do so in series with the observer:
    `mpc_preview` oscillates if the robot is a third as heavy as it was told.
    """

    def __init__(self, policy: Controller, robot: RobotParams, control_period: float) -> None:
        """Of a policy for a nominal robot, called every control period [s]."""
        self._policy, self._observer = policy, rate_observer(robot, control_period)
        self.hold = policy.hold
        self._in_force = self._observer.in_force
        measured = ("curvature", self._in_force)
        others = (n for n in policy.requires if n not in (*measured, "curvature_rate"))
        self.requires = (*measured, *others)
        self.sizes = {k: v for k, v in policy.sizes.items() if k in self.requires}

    def start(self, observation: Observation) -> ObservedState:
        """At rest, with the policy yet to start."""
        return ObservedState(np.empty(0), None)

    def act(
        self, observation: Observation, state: ObservedState
    ) -> tuple[np.ndarray, ObservedState]:
        """The policy's action with estimated rates."""
        estimate = self._estimate(state, observation[self._in_force], observation["curvature"])
        full = {**observation, "curvature_rate": estimate[1]}
        action, inner = self._policy.predict(full, state.inner)
        return action, ObservedState(estimate, inner)

    def _estimate(
        self, state: ObservedState | None, action: np.ndarray, curvature: np.ndarray
    ) -> np.ndarray:
        """Estimate (4, n), at the start of an episode that of rest."""
        if state is None or state.inner is None:
            return self._observer.start(curvature)
        return self._observer.update(state.estimate, action, curvature)

    def _decide_stacked(
        self, observation: Observation, states: list[ObservedState | None]
    ) -> tuple[np.ndarray, list[ObservedState]]:
        """One observer after the other, and the policy as it serves many."""
        seen = observation["previous_action"], observation["curvature"]
        estimates = [self._estimate(*one) for one in zip(states, *seen, strict=True)]
        full = {**observation, "curvature_rate": np.stack([one[1] for one in estimates])}
        inner = [None if state is None else state.inner for state in states]
        actions, inner = self._policy.predict(full, inner)
        return actions, [ObservedState(*both) for both in zip(estimates, inner, strict=True)]

    # The policy itself holds its actions.
    _go_on = _decide = act


def _stationary_gain(
    arm: PlanarArm, period: float, curvature_noise: float, force_walk: float
) -> tuple[np.ndarray, float]:
    """Kalman gain (3 n, n) for the straight arm with forces that walk.

    Also the largest standard deviation [1/m] of a measured curvature from its prediction.
    """
    n = arm.n
    a, force, _ = linear_model(arm._replace(inputs=np.eye(n)), np.zeros(n))
    a, b = discretized(a, force, period)
    a = np.block([[a, b], [np.zeros((n, 2 * n)), np.eye(n)]])
    c = np.eye(n, 3 * n)
    # Rounding needs some process noise on every state; this is far below the measured one.
    process = np.diag(np.repeat([1e-4 * curvature_noise**2, 0.0, force_walk**2 * period], n))
    noise = curvature_noise**2 * np.eye(n)
    covariance = solve_discrete_are(a.T, c.T, process, noise)
    expected = c @ covariance @ c.T + noise
    return covariance @ c.T @ np.linalg.inv(expected), float(np.sqrt(np.max(np.diag(expected))))


@kernel
def _update(
    arm: PlanarArm,
    period: float,
    steps: int,
    gain: np.ndarray,
    outlier: float,
    estimate: np.ndarray,
    inputs: np.ndarray,
    measured: np.ndarray,
) -> np.ndarray:
    n = arm.n
    out = estimate.copy()
    q, v, force = out[0], out[1], out[2]
    mass, gyroscopic, right = np.empty((n, n)), np.empty(n), np.empty(n)
    h = period / steps
    for _ in range(steps):
        inertia_forces(arm, q, v, mass, gyroscopic)
        for i in range(n):
            right[i] = h * (force[i] - gyroscopic[i] - arm.stiffness * q[i])
            for j in range(len(inputs)):
                right[i] += h * arm.inputs[i, j] * inputs[j]
            for k in range(n):
                right[i] += mass[i, k] * v[k]
        for i in range(n):
            mass[i, i] += h * (arm.damping_time + h) * arm.stiffness
        v[:] = np.linalg.solve(mass, right)
        q += h * v
    error = measured - q
    for k in range(n):
        strange = not abs(error[k]) <= outlier
        out[3, k] = out[3, k] + 1 if strange else 0.0
        if out[3, k] > _PATIENCE and finite(measured):
            out[:] = 0.0
            out[0] = measured
            return out
    for k in range(n):
        if abs(error[k]) <= outlier:
            for i in range(n):
                q[i] += gain[i, k] * error[k]
                v[i] += gain[n + i, k] * error[k]
                force[i] += gain[2 * n + i, k] * error[k]
    return out
