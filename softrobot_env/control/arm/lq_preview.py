"""LQ tracking with reference preview, offset-free and, if wanted, adaptive in the stiffness.

What it adds to the thesis' LQI: the coming reference enters the law; the equilibrium it deviates
from moves with the reference; unannounced jumps are smoothed; and in place of the integral of the
error, which overshoots, what the model leaves unexplained is estimated and compensated.
"""

from pathlib import Path

import numpy as np
from scipy.linalg import solve_discrete_are

from softrobot_env.beams.closed_forms import planar_arm
from softrobot_env.beams.closed_forms.planar_arm import PlanarArm
from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.control.arm.estimation import PRIOR, stiffness_factor, update_estimate
from softrobot_env.control.arm.operating_points import (
    Law,
    ScheduledController,
    conclude,
    interpolate,
    linear_model,
)
from softrobot_env.control.arm.statics import follow
from softrobot_env.control.arm.timing import KNOTS, PERIOD
from softrobot_env.control.base import usable
from softrobot_env.control.limits import finite, kept
from softrobot_env.control.linear_quadratic import discretized, preview_gains
from softrobot_env.control.reference_smoothing import (
    ACCELERATION,
    JUMP,
    begin_smoothing,
    memory_size,
    smoothed,
)
from softrobot_env.control.status import FINE, NOT_FINITE, Memory
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams

_TIMES = np.array((0.0, *KNOTS))

#: Weights of the cost sum_k (|e|^2 + VELOCITY_WEIGHT |e.|^2 + INPUT_WEIGHT |u|^2), with e the tip's
#: distance [m] from the reference and u the inputs' [N] from those that hold it.
VELOCITY_WEIGHT = 1e-3  # s2
INPUT_WEIGHT = 3e-7  # m2/N2

_OFFSET_BANDWIDTH = 100.0  # 1/s, of the difference between measured and modelled tip


class LQPreview(ScheduledController):
    """u = u_OP + mu u._OP - K(sigma) (x - x_OP) + sum_i G_i(sigma) (r_i - r_0 - t_i r.).

    x_OP and u_OP hold the tip at the present reference r_0 and move with it at its velocity r.;
    r_i is the reference at the time t_i ahead. The equilibrium takes into account the force d on
    the curvatures and the offset of the tip that the nominal model leaves unexplained, and, if
    `adaptive`, the stiffness; all three are estimated from the inputs really applied, so nothing
    winds up at the tension limit.
    """

    requires = (
        "curvature",
        "curvature_rate",
        "tip_position",
        "reference",
        "reference_preview",
        "previous_action",
    )
    preview = KNOTS

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        adaptive: bool = False,
        gains: Path | None = None,
    ) -> None:
        """Load the gain table.

        Args:
            robot, control_period, gains: As in `ScheduledController`.
            adaptive: Whether to estimate the stiffness.

        Raises:
            ValueError: As `ScheduledController`.
        """
        super().__init__(robot, control_period, "lq_preview", gains, count=2 * len(KNOTS))
        self.sizes["reference_preview"] = 2 * len(KNOTS)
        self._adaptive = adaptive

    def start(self, observation: Observation) -> Memory:
        """Begin from the inputs in force, with the nominal model."""
        n, m = self._law.arm.inputs.shape
        values = np.zeros(3 * n + m + 5 + memory_size(2))
        _, _, _, inputs, _, information, smoothing, _ = _split(values, n, m)
        inputs[:] = usable(observation["previous_action"]) * self._law.limit
        information[:] = PRIOR
        tip = observation["tip_position"]
        here = tip if np.isfinite(tip).all() else observation["reference"]
        begin_smoothing(usable(here), smoothing)
        return Memory(values, FINE)

    def act(self, observation: Observation, state: Memory) -> tuple[np.ndarray, Memory]:
        """The control law."""
        seen = self._seen(observation)
        action, values, code = _act(self._law, self._adaptive, state.values, *seen)
        return action, Memory(values, code)


@kernel
def _split(memory: np.ndarray, n: int, m: int) -> tuple:
    """Views: curvature, rate, force, inputs, tip offset, information, smoothing, begun (1,)."""
    k = 3 * n + m
    return (
        memory[:n],
        memory[n : 2 * n],
        memory[2 * n : 3 * n],
        memory[3 * n : k],
        memory[k : k + 2],
        memory[k + 2 : k + 4],
        memory[k + 5 :],
        memory[k + 4 : k + 5],
    )


@kernel
def _estimate(
    law: Law,
    adaptive: bool,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip: np.ndarray,
    previous: np.ndarray,
) -> float:
    """Update what the nominal model leaves unexplained; the stiffness factor [1]."""
    arm, limit = law.arm, law.limit
    n, m = arm.inputs.shape
    before, rate_before, force, _, offset, information, _, begun = _split(memory, n, m)
    point, jacobian = np.empty(2), np.empty((2, n))
    planar_arm.tip(arm, curvature, point, jacobian)
    share = 1.0
    scale = stiffness_factor(adaptive, information)
    if begun[0]:
        share = 1 - np.exp(-_OFFSET_BANDWIDTH * PERIOD)
        scale = update_estimate(
            arm,
            PERIOD,
            before,
            rate_before,
            curvature,
            rate,
            previous * limit,
            limit,
            adaptive,
            information,
            force,
        )
    for i in range(2):
        offset[i] += share * (tip[i] - point[i] - offset[i])
    begun[0] = 1.0
    before[:], rate_before[:] = curvature, rate
    return scale


@kernel
def _act(
    law: Law,
    adaptive: bool,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip: np.ndarray,
    target: np.ndarray,
    preview: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (n_inputs,), next memory and code."""
    arm, limit = law.arm, law.limit
    n, m = arm.inputs.shape
    memory = memory.copy()
    sound = finite(curvature) and finite(rate) and finite(tip) and finite(previous)
    _, _, force, inputs, offset, _, smoothing, begun = _split(memory, n, m)
    if not (sound and finite(target) and finite(preview)):
        begun[0] = 0.0  # the next balance of forces would span more than a period
        return kept(previous), memory, NOT_FINITE
    scale = _estimate(law, adaptive, memory, curvature, rate, tip, previous)

    points = np.empty((len(_TIMES), 2))
    points[0] = target
    for k in range(1, len(_TIMES)):
        points[k, 0], points[k, 1] = preview[2 * k - 2], preview[2 * k - 1]
    smoothed(PERIOD, target, _TIMES, JUMP, ACCELERATION, smoothing, points)
    rest, inverse = np.empty(n), np.empty((m, 2))
    gap = follow(arm, points[0] - offset, force, scale, limit, inputs, rest, inverse)
    velocity = (points[1] - points[0]) / _TIMES[1]
    if np.hypot(velocity[0], velocity[1]) * PERIOD > JUMP:
        velocity[:] = 0.0  # a jump ahead is no motion
    inputs_rate = inverse @ velocity
    rest_rate = arm.inputs @ inputs_rate / (scale * arm.stiffness)

    knots = len(_TIMES) - 1
    gains = np.empty(m * 2 * (n + knots))
    inside = interpolate(law.gains, curvature, gains)
    gain = gains.reshape(m, 2 * (n + knots))
    wanted = inputs + arm.damping_time * inputs_rate
    for j in range(m):
        for i in range(n):
            wanted[j] -= gain[j, i] * (curvature[i] - rest[i])
            wanted[j] -= gain[j, n + i] * (rate[i] - rest_rate[i])
        for k in range(knots):
            for i in range(2):
                ahead = points[k + 1, i] - points[0, i] - _TIMES[k + 1] * velocity[i]
                wanted[j] += gain[j, 2 * (n + k) + i] * ahead
    return conclude(wanted, law, gap, inside, memory)


def preview_design(arm: PlanarArm, curvature: np.ndarray, period: float = PERIOD) -> np.ndarray:
    """Gains of u = -K x + sum_i G_i r_i, flattened to (n_inputs * (2 n + 2 * knots),).

    x = (curvatures, rates) and r_i, the reference at the i-th knot, are deviations from an
    operating point.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point.
        period: [s] between decisions.
    """
    continuous_a, continuous_b, position = linear_model(arm, curvature)
    a, b = discretized(continuous_a, continuous_b, period)
    speed = np.roll(position, arm.n, axis=1)
    state_weight = position.T @ position + VELOCITY_WEIGHT * speed.T @ speed
    # Riccati's equation needs every state in the cost; this is far below the rest.
    state_weight += 1e-12 * np.eye(len(a))
    m = b.shape[1]
    input_weight = INPUT_WEIGHT * np.eye(m)
    riccati = solve_discrete_are(a, b, state_weight, input_weight)
    gain = np.linalg.solve(input_weight + b.T @ riccati @ b, b.T)
    feedback = gain @ riccati @ a
    ahead = preview_gains(a - b @ feedback, gain, position, speed, VELOCITY_WEIGHT, KNOTS, period)
    return np.concatenate([feedback, ahead.reshape(m, -1)], axis=1).ravel()
