"""Output feedback: policies of the full state that measure only tip and curvatures.

A Kalman filter on a robot's equations of motion estimates the curvature rates.
"""

from collections.abc import Callable
from functools import partial
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import inv, solve
from scipy.linalg import solve_discrete_are

from softrobot_env.beams.planar_arm import PlanarArm, inertia_forces, make_planar_arm, tip
from softrobot_env.compile.kernels import kernel
from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.inverse import workspace_of
from softrobot_env.scene.linearised import Linearizer, LinearModel

from .base import Controller, Held, usable
from .limits import finite
from .linear_quadratic import discretized

#: [s], longest step of the prediction by the closed form of the arm.
_STEP = 1e-3

#: Standard deviations between prediction and measurement from which on a measurement is an outlier,
#: if it also differs by a hundredth of the curvature limit.
_OUTLIER = 10.0

#: Outliers in a row that are ignored.
_PATIENCE = 3

#: For the arm: standard deviation [1/m] of measured curvatures; growth [1/s^0.5] of the deviation
#: of unexplained forces, over the full actuation (a larger one corrects a wrong model faster and
#: passes more noise); and process over measurement noise, which must not be zero because of
#: rounding.
_ARM_NOISE, _ARM_WALK, _ARM_PROCESS = 1e-2, 0.5, 1e-2

#: For other robots: the same for a shift of the curvatures, the first one times the length.
_NOISE, _WALK, _PROCESS = 5e-3, 0.5, 1e-4

#: Function that predicts an estimate (4, n) of `RateObserver` a period later under what was applied
#: (m,).
Prediction = Callable[[ndarray, ndarray], ndarray]


class Filter(NamedTuple):
    """A stationary Kalman filter.

    Attributes:
        ahead, by_input: (3 n, 3 n) and (3 n, m), exact over a period.
        gain: (3 n, n), of the innovation, measurement minus prediction.
        deviation: [1/m], largest standard deviation of the innovation.
    """

    ahead: ndarray
    by_input: ndarray
    gain: ndarray
    deviation: float


def stationary_filter(
    model: LinearModel, shift: ndarray, period: float, noise: float, walk: float, process: float
) -> Filter:
    """A Kalman filter of curvatures, rates and a disturbance that shifts them, a random walk.

    Args:
        model: The robot.
        shift: (n, n), force [N m2] per unit of the disturbance.
        period: [s] between two updates.
        noise: [1/m], standard deviation of measured curvatures.
        walk: [1/s^0.5], growth of the deviation of the disturbance.
        process: Deviation [1] of the curvatures' process noise, over the measurement noise.
    """
    a, b, _ = model.state_space()
    n, m = len(model.mass), b.shape[1]
    force = np.vstack([np.zeros((n, n)), solve(model.mass, shift)])
    a, both = discretized(a, np.hstack([b, force]), period)
    ahead = np.block([[a, both[:, m:]], [np.zeros((n, 2 * n)), np.eye(n)]])
    own = np.diag(np.repeat([(process * noise) ** 2, 0.0, walk**2 * period], n))
    seen, measured = np.eye(n, 3 * n), noise**2 * np.eye(n)
    covariance = solve_discrete_are(ahead.T, seen.T, own, measured)
    expected = seen @ covariance @ seen.T + measured
    gain = covariance @ seen.T @ inv(expected)
    by_input = np.vstack([both[:, :m], np.zeros((n, m))])
    return Filter(ahead, by_input, gain, float(np.sqrt(np.diag(expected).max())))


class RateObserver:
    """Estimates curvatures, their rates and a disturbance, with the stationary Kalman gain.

    The disturbance, forces or a change of the curvatures at rest, is modelled as a random walk, so
    that the estimates have no offset where the model is wrong. A curvature far from its prediction
    counts as an outlier, up to three times in a row; then the estimate restarts from the
    measurement, at rest.

    Attributes:
        predicted: An estimate a period later, without a measurement.
        tip: Position (3,) [m] of the tip at curvatures (n,), up to a constant.
        in_force: Observable that holds what was applied.
    """

    def __init__(
        self,
        robot: RobotParams,
        predicted: Prediction,
        tip: Callable[[ndarray], ndarray],
        known: Filter,
        in_force: str,
    ) -> None:
        """Put the parts together; see `arm_observer` and `chain_observer`."""
        self.predicted, self.tip, self.in_force = predicted, tip, in_force
        self._gain = known.gain
        self._limit = max(_OUTLIER * known.deviation, 0.01 * robot.curvature_limit)

    def start(self, curvature: ndarray) -> ndarray:
        """Estimate (4, n), at rest: curvature [1/m], rate [1/(m s)], shift, outliers in a row."""
        estimate = np.zeros((4, len(curvature)))
        estimate[0] = usable(curvature)
        return estimate

    def update(self, estimate: ndarray, applied: ndarray, curvature: ndarray) -> ndarray:
        """Next estimate (4, n).

        Args:
            estimate: (4, n), the previous one.
            applied: (m,), value of the observable `in_force` since then.
            curvature: (n,) [1/m], measured now; entries that are not finite are only predicted.
        """
        ahead = self.predicted(estimate, usable(applied))
        return _corrected(self._gain, self._limit, ahead, np.ascontiguousarray(curvature))


def linear_model(arm: PlanarArm, curvature: ndarray) -> LinearModel:
    """The linear model of a planar arm, (6.25) to (6.27), from inputs [N] to the tip (x, z).

    Args:
        arm: The arm.
        curvature: (n,) [1/m], at rest in equilibrium.
    """
    n = arm.n
    mass, gyroscopic, point, jacobian = np.empty((n, n)), np.empty(n), np.empty(2), np.empty((2, n))
    inertia_forces(arm, curvature, np.zeros(n), mass, gyroscopic)
    tip(arm, curvature, point, jacobian)
    stiffness = arm.stiffness * np.eye(n)
    damping, elastic = arm.damping_time * stiffness, arm.stiffness * curvature
    return LinearModel(mass, damping, stiffness, arm.inputs, jacobian, elastic)


def arm_observer(robot: RobotParams, control_period: float) -> RateObserver:
    """The observer of a planar arm: predicts with its nonlinear model, estimates forces [N m2].

    It integrates by the linearly implicit Euler method, whose steps the stiffness does not limit.
    The gain is that of the straight arm.

    Args:
        robot: Nominal robot.
        control_period: [s] between two updates.

    Raises:
        ValueError: The robot is not a planar arm.
    """
    check_argument("control_period", control_period, Positive)
    arm, limit = make_planar_arm(robot), TendonMap(robot).input_scale
    walk = _ARM_WALK * np.max(arm.inputs @ limit)
    model = linear_model(arm, np.zeros(arm.n))
    noise = _ARM_NOISE, walk, _ARM_PROCESS
    known = stationary_filter(model, np.eye(arm.n), control_period, *noise)
    steps = ceil(control_period / _STEP - 1e-9)
    later = partial(_arm_later, arm, limit, control_period, steps)
    return RateObserver(robot, later, partial(_arm_tip, arm), known, "previous_action")


def chain_observer(robot: RobotParams, control_period: float) -> RateObserver:
    """The observer of any robot: predicts with its chain linearised in the middle of its workspace.

    Errors of the linear model, also far from there, become a shift [1/m] of the curvatures at rest.
    """
    check_argument("control_period", control_period, Positive)
    space = workspace_of(robot)
    linearizer, inputs = Linearizer(space.scene), space.ground.inputs
    angles = space.inverse.posture(inputs)
    model, length = linearizer.about(angles, inputs), robot.drive.kind == "length"
    full = np.abs(solve(model.stiffness, model.inputs)).sum(axis=1).max()
    noise = _NOISE / robot.length, _WALK * full, _PROCESS
    known = stationary_filter(model, model.stiffness, control_period, *noise)
    scale = linearizer.inputs.input_scale if length else np.ones(len(inputs))
    middle, rest = linearizer.mean @ angles, linearizer.action(inputs)
    ahead = partial(_chain_later, known.ahead, known.by_input / scale, middle, rest * scale)
    in_force = "tendon_length" if length else "previous_action"
    spread = np.linalg.pinv(linearizer.mean)

    def place(curvature: ndarray) -> ndarray:
        return space.scene.tip(angles + spread @ (curvature - middle))

    return RateObserver(robot, ahead, place, known, in_force)


def rate_observer(robot: RobotParams, control_period: float) -> RateObserver:
    """The observer of a robot, called every control period [s]; for planar arms in closed form."""
    try:
        return arm_observer(robot, control_period)
    except ValueError:
        return chain_observer(robot, control_period)


class ObservedState(NamedTuple):
    """State of `OutputFeedback`.

    Attributes:
        estimate: (4, n), of the observer; the second row holds the rates.
        inner: State of the policy.
    """

    estimate: ndarray
    inner: Any

    #: As in the policy.
    status = Held.status


class OutputFeedback(Controller):
    """A policy whose curvature rates come from an observer.

    The observer runs in every control period, even while the policy holds its action. Policies that
    estimate unexplained forces themselves then do so in series with the observer: `mpc_preview`
    oscillates if the robot's mass is a third of its model's.
    """

    def __init__(self, policy: Controller, robot: RobotParams, control_period: float) -> None:
        """Wrap a policy for a nominal robot, called every control period [s]."""
        self._policy, self._observer = policy, rate_observer(robot, control_period)
        self.hold = policy.hold
        self._in_force = self._observer.in_force
        measured = ("curvature", self._in_force)
        others = (n for n in policy.requires if n not in (*measured, "curvature_rate"))
        self.requires = (*measured, *others)
        self.sizes = {k: v for k, v in policy.sizes.items() if k in self.requires}

    def start(self, observation: Observation) -> ObservedState:
        """Begin at rest; the policy has not started yet."""
        return ObservedState(np.empty(0), None)

    def act(self, observation: Observation, state: ObservedState) -> tuple[ndarray, ObservedState]:
        """The policy's action with estimated rates."""
        estimate = self._estimate(state, observation[self._in_force], observation["curvature"])
        full = {**observation, "curvature_rate": estimate[1]}
        action, inner = self._policy.predict(full, state.inner)
        return action, ObservedState(estimate, inner)

    def _estimate(
        self, state: ObservedState | None, action: ndarray, curvature: ndarray
    ) -> ndarray:
        """Estimate (4, n); at rest at the start of an episode."""
        if state is None or state.inner is None:
            return self._observer.start(curvature)
        return self._observer.update(state.estimate, action, curvature)

    def _decide_stacked(
        self, observation: Observation, states: list[ObservedState | None]
    ) -> tuple[ndarray, list[ObservedState]]:
        """The observers one after the other, then the policy for all at once."""
        seen = observation["previous_action"], observation["curvature"]
        estimates = [self._estimate(*one) for one in zip(states, *seen, strict=True)]
        full = {**observation, "curvature_rate": np.stack([one[1] for one in estimates])}
        inner = [None if state is None else state.inner for state in states]
        actions, inner = self._policy.predict(full, inner)
        return actions, [ObservedState(*both) for both in zip(estimates, inner, strict=True)]

    # The policy holds its actions itself.
    _go_on = _decide = act


@kernel
def _arm_later(
    arm: PlanarArm, limit: ndarray, period: float, steps: int, estimate: ndarray, action: ndarray
) -> ndarray:
    n = arm.n
    out = estimate.copy()
    q, v, force = out[0], out[1], out[2]
    mass, gyroscopic, right = np.empty((n, n)), np.empty(n), np.empty(n)
    h = period / steps
    for _ in range(steps):
        inertia_forces(arm, q, v, mass, gyroscopic)
        for i in range(n):
            right[i] = h * (force[i] - gyroscopic[i] - arm.stiffness * q[i])
            for j in range(len(action)):
                right[i] += h * arm.inputs[i, j] * action[j] * limit[j]
            for k in range(n):
                right[i] += mass[i, k] * v[k]
        for i in range(n):
            mass[i, i] += h * (arm.damping_time + h) * arm.stiffness
        v[:] = solve(mass, right)
        q += h * v
    return out


def _arm_tip(arm: PlanarArm, curvature: ndarray) -> ndarray:
    point, jacobian = np.empty(2), np.empty((2, arm.n))
    tip(arm, curvature, point, jacobian)
    return np.array([point[0], 0.0, point[1]])


@kernel
def _chain_later(
    by_state: ndarray,
    by_input: ndarray,
    middle: ndarray,
    rest: ndarray,
    estimate: ndarray,
    applied: ndarray,
) -> ndarray:
    n, out = len(middle), estimate.copy()
    out[0] -= middle
    out[:3] = (by_state @ out[:3].ravel() + by_input @ (applied - rest)).reshape(3, n)
    out[0] += middle
    return out


@kernel
def _corrected(gain: ndarray, limit: float, out: ndarray, measured: ndarray) -> ndarray:
    """The estimate after a measurement (n,), from the prediction (4, n), which is modified."""
    n = len(measured)
    error = measured - out[0]
    for k in range(n):
        fine = abs(error[k]) <= limit
        out[3, k] = 0.0 if fine else out[3, k] + 1
        if out[3, k] > _PATIENCE and finite(measured):
            out[:] = 0.0
            out[0] = measured
            return out
    for k in range(n):
        if abs(error[k]) <= limit:
            for x in range(3):
                for i in range(n):
                    out[x, i] += gain[x * n + i, k] * error[k]
    return out
