"""Rates of the curvatures of any robot, from its curvatures and what is applied to it."""

import numpy as np
from scipy.linalg import solve_discrete_are

from softrobot_env.control.base import usable
from softrobot_env.control.linear_quadratic import discretized
from softrobot_env.control.scheduled.linear_model import Linearizer
from softrobot_env.fields import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene
from softrobot_env.scene.workspace import workspace_of

#: Standard deviations of measured curvatures, over 1 / length; of the process' own noise over that;
#: and growth [1/s^0.5] of the shift of the curvatures that stands for what the model does not know,
#: over full actuation.
_NOISE, _PROCESS, _WALK = 5e-3, 1e-4, 0.5

#: Standard deviations between prediction and measurement that make an outlier, and how many in a
#: row are ignored.
_OUTLIER, _PATIENCE = 10.0, 3


class LinearObserver:
    """Estimates curvatures, their rates, and a shift of the curvatures at rest.

    Predicts with the robot's chain, linearised in the middle of its ground, corrects with the
    stationary Kalman gain. What a linear model does not know, far from there too, is a random walk
    of the curvatures at rest, so that the estimates have no offset.

    Attributes:
        in_force: Observable that says what was applied.
    """

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """Linearise and compute the gain.

        Args:
            robot: Nominal robot.
            control_period: [s] between two updates.
        """
        check_argument("control_period", control_period, Positive)
        scene = build_scene(model_scene(robot))
        linearizer, space = Linearizer(scene), workspace_of(robot)
        inputs = space.ground.inputs
        angles = space.inverse.posture(inputs)
        model = linearizer.about(angles, inputs)
        self.in_force = "tendon_length" if robot.drive.kind == "length" else "previous_action"
        self._scale = linearizer.inputs.input_scale if robot.drive.kind == "length" else 1.0
        self._middle = linearizer.mean @ angles, linearizer.action(inputs)
        a, b, _ = model.state_space()
        n, m = len(model.mass), b.shape[1]
        shift = np.vstack([np.zeros((n, n)), np.linalg.solve(model.mass, model.stiffness)])
        a, both = discretized(a, np.hstack([b, shift]), control_period)
        self._by_action = np.vstack([both[:, :m], np.zeros((n, m))])
        self._ahead = np.block([[a, both[:, m:]], [np.zeros((n, 2 * n)), np.eye(n)]])
        full = np.abs(np.linalg.solve(model.stiffness, model.inputs)).sum(axis=1).max()
        noise = _NOISE / robot.length
        walk = (_WALK * full) ** 2 * control_period
        process = np.diag(np.repeat([(_PROCESS * noise) ** 2, 0.0, walk], n))
        seen = np.eye(n, 3 * n)
        covariance = solve_discrete_are(self._ahead.T, seen.T, process, noise**2 * np.eye(n))
        expected = seen @ covariance @ seen.T + noise**2 * np.eye(n)
        self._gain = covariance @ seen.T @ np.linalg.inv(expected)
        self._limit = max(
            _OUTLIER * float(np.sqrt(np.diag(expected).max())), 0.01 * robot.curvature_limit
        )

    def start(self, curvature: np.ndarray) -> np.ndarray:
        """Estimate (4, n), at rest: curvature [1/m], rate [1/(m s)], shift [1/m], outliers."""
        estimate = np.zeros((4, len(self._middle[0])))
        estimate[0] = usable(curvature)
        return estimate

    def update(
        self, estimate: np.ndarray, applied: np.ndarray, curvature: np.ndarray
    ) -> np.ndarray:
        """Next estimate (4, n).

        Args:
            estimate: (4, n), the one before.
            applied: (m,), since then, as the observable `in_force` says it.
            curvature: (n,) [1/m], measured now; where it is not finite it is predicted only.
        """
        middle, rest = self._middle
        state = estimate[:3].copy()
        state[0] -= middle
        action = usable(applied) / self._scale - rest
        ahead = (self._ahead @ state.ravel() + self._by_action @ action).reshape(3, -1)
        error = curvature - middle - ahead[0]
        fine = np.abs(error) <= self._limit
        outliers = np.where(fine, 0.0, estimate[3] + 1)
        if outliers.max() > _PATIENCE and np.isfinite(curvature).all():
            return self.start(curvature)
        ahead += (self._gain @ np.where(fine, error, 0.0)).reshape(3, -1)
        ahead[0] += middle
        return np.vstack([ahead, outliers])
