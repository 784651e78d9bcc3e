"""LQI control with gain scheduling (thesis sec. 6.4, with the audit's corrections)."""

from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_are

from softrobot_env.beams.closed_forms.planar_arm import PlanarArm
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.control.arm.operating_points import (
    Law,
    ScheduledController,
    conclude,
    interpolate,
    linear_model,
)
from softrobot_env.control.arm.statics import REACH, follow
from softrobot_env.control.arm.timing import PERIOD
from softrobot_env.control.base import usable
from softrobot_env.control.limits import excess, finite, kept
from softrobot_env.control.status import FINE, NOT_FINITE, Memory
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams

#: Weights on the integrated tip error and on the inputs. The thesis gives none; this ratio comes
#: closest to its rise times (audit of sec. 6.4).
ERROR_WEIGHT = 10.0  # 1/(m s)2
INPUT_WEIGHT = 1e-6  # 1/N2


class LQI(ScheduledController):
    """u = -K(sigma) (x - x_OP) - K_i(sigma) int (z - z_ref) dt + u_OP, corrected (6.28).

    x holds curvatures and their rates; x_OP and u_OP are the equilibrium with the tip at the
    reference, followed continuously (the printed law takes it at the measured sigma, which
    cancels the position feedback: audit). The gains are interpolated at the measured sigma; outside
    the grid its boundary's are kept. The error is not integrated where that would drive an input
    (further) beyond its limit, nor while the reference is out of reach: nothing winds up.
    """

    requires = ("curvature", "curvature_rate", "tip_position", "reference", "previous_action")

    def __init__(
        self, robot: RobotParams, control_period: float, gains: Path | None = None
    ) -> None:
        """Load the gain table; arguments and errors as `ScheduledController`."""
        super().__init__(robot, control_period, "lqi", gains, count=2)

    def start(self, observation: Observation) -> Memory:
        """Begin from the inputs in force, without integrated error."""
        inputs = usable(observation["previous_action"]) * self._law.limit
        return Memory(np.concatenate([inputs, np.zeros(2)]), FINE)

    def act(self, observation: Observation, state: Memory) -> tuple[np.ndarray, Memory]:
        """The control law."""
        action, values, code = _act(self._law, state.values, *self._seen(observation))
        return action, Memory(values, code)


@kernel
def _act(
    law: Law,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip: np.ndarray,
    target: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (n_inputs,), next memory (inputs of the equilibrium, integral) and code."""
    arm, limit = law.arm, law.limit
    n, m = arm.inputs.shape
    memory = memory.copy()
    sound = finite(curvature) and finite(rate) and finite(previous)
    if not (sound and finite(tip) and finite(target)):
        return kept(previous), memory, NOT_FINITE
    inputs, integral = memory[:m], memory[m:]
    rest, inverse = np.empty(n), np.empty((m, 2))
    gap = follow(arm, target, np.zeros(n), 1.0, limit, inputs, rest, inverse)
    gains = np.empty(m * (2 * n + 2))
    inside = interpolate(law.gains, curvature, gains)
    gain = gains.reshape(m, 2 * n + 2)
    wanted = inputs.copy()
    for j in range(m):
        for i in range(n):
            wanted[j] -= gain[j, i] * (curvature[i] - rest[i]) + gain[j, n + i] * rate[i]
        wanted[j] -= gain[j, 2 * n] * integral[0] + gain[j, 2 * n + 1] * integral[1]
    step = PERIOD * (tip - target)
    integrated = wanted - gain[:, 2 * n] * step[0] - gain[:, 2 * n + 1] * step[1]
    beyond = excess(integrated, limit)
    if gap <= REACH and (beyond == 0 or beyond < excess(wanted, limit)):
        integral += step
        wanted = integrated
    return conclude(wanted, law, gap, inside, memory)


def design(arm: PlanarArm, curvature: np.ndarray) -> np.ndarray:
    """Gains [K, K_i] (n_inputs, 2 n + 2) at an operating point, flattened.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point, which is at rest.
    """
    a, b, c = linear_model(arm, curvature)
    states, (_, m) = len(a), b.shape
    # x. = A x + B u, e. = C x: the integrated error is a state.
    a = np.block([[a, np.zeros((states, 2))], [c, np.zeros((2, 2))]])
    b = np.vstack([b, np.zeros((2, m))])
    weights = np.diag([0.0] * states + [ERROR_WEIGHT] * 2)
    riccati = solve_continuous_are(a, b, weights, INPUT_WEIGHT * np.eye(m))
    return (b.T @ riccati / INPUT_WEIGHT).ravel()
