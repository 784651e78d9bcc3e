"""LQ tracking with reference preview, offset-free and, if wanted, adaptive in the stiffness.

The law of any robot: where `control.arm.lq_preview` solves the statics of the planar arm in closed
form, this one looks its equilibria up; in place of the arm's operating points, thirds of the
backbone, its gains belong to places of the tip.
"""

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from softrobot_env.beams.numerics.compilation import kernel
from softrobot_env.control.base import usable
from softrobot_env.control.linear_quadratic import discretized, preview_gains
from softrobot_env.control.reference_smoothing import begin_smoothing, memory_size, smoothed
from softrobot_env.control.scheduled.law import Law, ScheduledLaw, in_space, is_planar, tighten
from softrobot_env.control.scheduled.operating_points import Equilibrium
from softrobot_env.control.scheduled.table import Row, inverse_of, look_up
from softrobot_env.control.scheduled.timing import Timing
from softrobot_env.control.status import (
    FINE,
    NOT_FINITE,
    SATURATED,
    UNREACHABLE,
    Memory,
    finite,
    kept,
)
from softrobot_env.interfaces import Observation
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

#: Weights of the cost sum_k (|e|^2 + (s T)^2 |e.|^2 + i g^2 |a|^2 + r g^2 T^2 |a.|^2), with e the
#: tip's distance [m] from the reference, T the period of the first mode, a the actions' distance
#: from those that hold it, and g [m] how far an action of one moves the tip at rest.
_VELOCITY_WEIGHT, _INPUT_WEIGHT = 7e-4, 5e-3  # s^2 and i

#: r: where tensions follow at once, and that times the square of (reach / T) over the speed at
#: which the drives move the tip.
_RATE_WEIGHT, _SLOW_WEIGHT = 1e-7, 5e-4

#: Damping of the inverse of the tip's derivative by actions.
_DAMPING = 1e-2

#: [1], memory of the stiffness estimate, times the period of the first mode; how much it trusts the
#: nominal stiffness, as curvature times length; and the factors it is kept in.
_FORGETTING, _TRUST, _RANGE = 2.0, 0.02, (0.3, 3.0)

#: Jumps [1] over the reach, and accelerations that replace them, over the reach and T^2.
_JUMP, _ACCELERATION = 1e-2, 29.0

#: Distance from the reference, over the reach, that the equilibria of the table leave at most.
_FAR = 0.02


class LQPreview(ScheduledLaw):
    """a = a_OP + da_OP - K (x - x_OP, a- - a_OP) + sum_i G_i (r_i - r_0 - t_i r.).

    x_OP and a_OP hold the tip at the present reference r_0 and move with it at its velocity r.;
    a- is the action in force, r_i the reference at the time t_i ahead. What the model leaves
    unexplained is estimated from the actions really in force, and compensated: a shift of the
    curvatures, an offset of the tip, and, if `adaptive`, the stiffness.
    """

    def __init__(
        self, robot: RobotParams, control_period: float, table: Any, adaptive: bool = False
    ) -> None:
        """Prepare for a robot.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            table: Reference to its `Table` with the gains of `Preview`.
            adaptive: Whether to estimate the stiffness.

        Raises:
            ValueError: The control period is no part of the robot's.
        """
        seen = ("curvature", "curvature_rate", "tip_position", "reference", "reference_preview")
        super().__init__(robot, control_period, "lq_preview", table, seen)
        self._adaptive = adaptive

    def start(self, observation: Observation) -> Memory:
        """Begin from the actions in force, with the nominal model.

        Raises:
            ValueError: The reference has too few coordinates, or the preview is at another number
                of times than this policy needs.
        """
        law = self._law
        self._check_reference(observation, len(law.times) - 1)
        n, m = law.table.n, law.table.m
        values = np.zeros(2 * n + m + 5 + memory_size(3))
        values[2 * n : 2 * n + m] = self._begun(observation)
        tip, here = observation["tip_position"], np.empty(3)
        here_seen = usable(tip if np.isfinite(tip).all() else observation["reference"])
        in_space(here_seen, is_planar(law.table), here)
        begin_smoothing(here, values[2 * n + m + 5 :])
        return Memory(values, FINE)

    def act(self, observation: Observation, state: Memory) -> tuple[np.ndarray, Memory]:
        """The control law."""
        seen = self._seen(observation)
        action, values, code = _act(self._law, self._adaptive, state.values, *seen)
        return action, Memory(values, code)


@kernel
def _split(memory: np.ndarray, n: int, m: int) -> tuple:
    """Views: rate before, shift, actions held, tip's offset, stiffness (1,), begun, smoothing."""
    k = 2 * n + m
    return (
        memory[:n],
        memory[n : 2 * n],
        memory[2 * n : k],
        memory[k : k + 3],
        memory[k + 3 : k + 4],
        memory[k + 4 : k + 5],
        memory[k + 5 :],
    )


@kernel
def _estimate(
    law: Law,
    now: Row,
    adaptive: bool,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip: np.ndarray,
    action: np.ndarray,
) -> np.ndarray:
    """Update what the model leaves unexplained; shift (n,) [1/m] of the curvatures at rest.

    The balance of forces, over the stiffness: K^-1 (M q.. + D q.) + q - q_OP - X (a - a_OP).
    """
    n, m = law.table.n, law.table.m
    before, shift, _, offset, stiffer, begun, _ = _split(memory, n, m)
    bend = curvature - now.curvature
    missing = tip - now.tip - now.jacobian @ bend
    if begun[0]:
        left = now.inertia @ ((rate - before) / law.period) + now.damping @ rate + bend
        left -= now.by_action @ (action - now.action)
        if adaptive:
            _adapt(law, now, left, stiffer)
        left += stiffer[0] * now.elastic
        shift += law.force * (left - shift)
        offset += law.offset * (missing - offset)
    else:
        offset[:] = missing
    begun[0] = 1.0
    before[:] = rate
    return shift - stiffer[0] * now.elastic


@kernel
def _adapt(law: Law, now: Row, left: np.ndarray, stiffer: np.ndarray) -> None:
    """Update how much stiffer (1,) the springs are: of those by a share s the shift is -s elastic.

    Least squares with forgetting, as one step down the gradient.
    """
    trust = _TRUST / law.reach
    size, error = trust * trust * len(left), 0.0
    for i in range(len(left)):
        size += now.elastic[i] ** 2
        error -= now.elastic[i] * (left[i] + stiffer[0] * now.elastic[i])
    error -= stiffer[0] * trust * trust * len(left)
    stiffer[0] += min(law.period / law.first * _FORGETTING, 1.0) * error / size
    stiffer[0] = min(max(stiffer[0], _RANGE[0] - 1), _RANGE[1] - 1)


@kernel
def _references(
    law: Law, target: np.ndarray, preview: np.ndarray, smoothing: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (1 + k, 3) [m], now and ahead, without jumps, and the velocity (3,) [m/s] now."""
    times, size, planar = law.times, len(target), is_planar(law.table)
    points = np.empty((len(times), 3))
    in_space(target, planar, points[0])
    for k in range(1, len(times)):
        in_space(preview[(k - 1) * size : k * size], planar, points[k])
    far = _ACCELERATION * law.reach / law.first**2
    here = points[0].copy()
    smoothed(law.period, here, times, _JUMP * law.reach, far, smoothing, points)
    velocity = (points[1] - points[0]) / times[1]
    if np.sqrt(np.sum(velocity**2)) * law.period > _JUMP * law.reach:
        velocity[:] = 0.0  # a jump ahead is no motion
    return points, velocity


@kernel
def _act(
    law: Law,
    adaptive: bool,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip_seen: np.ndarray,
    target: np.ndarray,
    preview: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (m,), next memory and code."""
    table = law.table
    n, m = table.n, table.m
    memory = memory.copy()
    _, _, held, offset, _, begun, smoothing = _split(memory, n, m)
    sound = finite(curvature) and finite(rate) and finite(tip_seen) and finite(previous)
    if not (sound and finite(target) and finite(preview)):
        begun[0] = 0.0  # the next balance of forces would span more than a period
        return kept(previous), memory, NOT_FINITE
    tip = np.empty(3)
    in_space(tip_seen, is_planar(table), tip)
    points, velocity = _references(law, target, preview, smoothing)
    now = look_up(table, points[0], held)
    held[:] = now.action
    shift = _estimate(law, now, adaptive, memory, curvature, rate, tip, previous)

    to_action = inverse_of(now.jacobian @ now.by_action, table.directions, _DAMPING)
    gap = table.directions @ (now.tip - points[0])
    correction = -(to_action @ (now.jacobian @ shift + offset + now.tip - points[0]))
    rising = to_action @ velocity
    moving = now.by_action @ rising
    braking = now.damping @ moving
    correction += to_action @ (now.jacobian @ braking)
    rest = now.curvature + shift - braking + now.by_action @ correction
    action = now.action + correction

    knots, k = len(law.times) - 1, 2 * n + m
    feedback = now.gains[: m * k].reshape(m, k)
    ahead = now.gains[m * k :].reshape(m, knots * 3)
    behind = previous + law.period * rising - action
    wanted = action + behind
    for j in range(m):
        for i in range(n):
            wanted[j] -= feedback[j, i] * (curvature[i] - rest[i])
            wanted[j] -= feedback[j, n + i] * (rate[i] - moving[i])
        for i in range(m):
            wanted[j] -= feedback[j, 2 * n + i] * behind[i]
        for i in range(knots):
            for x in range(3):
                way = points[i + 1, x] - points[0, x] - law.times[i + 1] * velocity[x]
                wanted[j] += ahead[j, 3 * i + x] * way
    tighten(law, curvature, wanted)
    return conclude(law, wanted, previous, np.sqrt(np.sum(gap**2)), memory)


@kernel
def conclude(
    law: Law, wanted: np.ndarray, previous: np.ndarray, gap: float, memory: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (m,), next memory and code of a decision.

    Where drives are too slow for a change of the actions, all change by the same share of it. The
    action is NaN where it, or the memory, could not be computed; `Controller` then keeps both.

    Args:
        law: Whose speeds hold.
        wanted: (m,) [1].
        previous: (m,) [1], in force.
        gap: [m], from the operating point's tip to the reference.
        memory: Of this decision.
    """
    m, share, code = len(wanted), 1.0, FINE
    if not (finite(wanted) and finite(memory)):
        return np.full(m, np.nan), memory, FINE
    for j in range(m):
        share = min(share, law.speed[j] / max(abs(wanted[j] - previous[j]), 1e-300))
    action = np.empty(m)
    for j in range(m):
        asked = previous[j] + share * (wanted[j] - previous[j])
        action[j] = min(max(asked, -1.0), 1.0)
        if action[j] != asked or share < 1.0:
            code = SATURATED
    if code == FINE and gap > _FAR * law.reach:
        code = UNREACHABLE
    return action, memory, code


class Preview:
    """The gains of `LQPreview` for one robot."""

    def __init__(self, robot: RobotParams) -> None:
        """Of any robot: its drives' speed counts."""
        self._drive, self._reach, self._scale = (
            robot.drive,
            robot.reach,
            robot_inputs(robot).input_scale,
        )

    @staticmethod
    def count(n: int, m: int, timing: Timing, directions: int) -> int:
        """Number of gains at a point, for n curvatures and m actions."""
        return m * (2 * n + m) + m * len(timing.knots) * 3

    def __call__(self, point: Equilibrium, directions: np.ndarray, timing: Timing) -> np.ndarray:
        """Gains [K (m, 2 n + m), G (m, knots, 3)], flattened.

        The optimum for a known reference: with P from Riccati's equation, W = (R + B'PB)^-1 and
        A_c = A - BK, the reference j steps ahead enters through W B' A_c'^(j-1). Beyond the last
        knot it is taken to stay there. Inputs are the changes of the actions.

        Args:
            point: The operating point.
            directions: (k, 3), see `Table`.
            timing: Of the robot.
        """
        n, (period, first) = len(point.curvature), (timing.period, timing.first)
        continuous_a, continuous_b, tip = point.model.state_space()
        size = np.repeat([1.0, 1 / first], n)  # of states, so that they are of like order
        a, b = discretized(
            continuous_a * size / size[:, None], continuous_b / size[:, None], period
        )
        m = b.shape[1]
        a = np.block([[a, b], [np.zeros((m, 2 * n)), np.eye(m)]])
        b = np.vstack([b, np.eye(m)])
        place = directions @ tip
        position = np.hstack([place * size, np.zeros((len(place), m))])
        speed = np.hstack(
            [np.zeros((len(place), n)), place[:, :n] / first, np.zeros((len(place), m))]
        )
        gain = np.linalg.norm(place[:, :n] @ point.by_action) / np.sqrt(len(place))  # m
        weight = position.T @ position + _VELOCITY_WEIGHT * first**2 * speed.T @ speed
        weight[2 * n :, 2 * n :] += _INPUT_WEIGHT * gain**2 * np.eye(m)
        # Riccati's equation needs every state in the cost; this is far below the rest.
        weight += 1e-10 * np.trace(weight) / len(weight) * np.eye(len(weight))
        change = self._rate_weight(gain, first) * (gain * first / period) ** 2 * np.eye(m)
        riccati = solve_discrete_are(a, b, weight, change)
        inverse = np.linalg.solve(change + b.T @ riccati @ b, b.T)
        feedback = inverse @ riccati @ a
        velocity_weight = _VELOCITY_WEIGHT * first**2
        ahead = preview_gains(
            a - b @ feedback, inverse, position, speed, velocity_weight, timing.knots, period
        )
        scaled = feedback / np.concatenate([size, np.ones(m)])
        return np.concatenate([scaled.ravel(), (ahead @ directions).ravel()])

    def _rate_weight(self, gain: float, first: float) -> float:
        if self._drive.kind == "tension":
            return _RATE_WEIGHT
        speed = gain * self._drive.speed / self._scale.max()  # m/s, of the tip
        return _RATE_WEIGHT + _SLOW_WEIGHT * (self._reach / first / speed) ** 2
