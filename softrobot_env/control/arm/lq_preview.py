"""LQ tracking with reference preview, offset-free and, if wanted, adaptive in the stiffness.

What it adds to the thesis' LQI: the coming reference enters the law; the equilibrium it deviates
from moves with the reference; unannounced jumps are smoothed; and in place of the integral of the
error, which overshoots, what the model leaves unexplained is estimated and compensated.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softrobot_env.beams.closed_forms import planar_arm
from softrobot_env.beams.closed_forms.planar_arm import PlanarArm, make_planar_arm
from softrobot_env.beams.numerics.compilation import kernel, reference, structure
from softrobot_env.control import reference_smoothing as jumps
from softrobot_env.control.arm.estimation import PRIOR, stiffness_factor, update_estimate
from softrobot_env.control.arm.operating_points import GainTable, interpolate, load_gains
from softrobot_env.control.arm.preview_gains import KNOTS
from softrobot_env.control.arm.statics import REACH, RELAXATION, follow
from softrobot_env.control.base import Controller, hold_for, state_sizes, usable
from softrobot_env.control.status import (
    FINE,
    NOT_FINITE,
    OUTSIDE,
    SATURATED,
    UNREACHABLE,
    Memory,
    finite,
    kept,
    limited,
    unsound,
)
from softrobot_env.interfaces import Observation
from softrobot_env.paths import models_dir
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

#: [s] between decisions.
PERIOD = 1e-3

_OFFSET_BANDWIDTH = 100.0  # 1/s, of the difference between measured and modelled tip


@structure
class _Law(NamedTuple):
    """What the kernel needs of a robot; one argument is faster to pass than five."""

    arm: PlanarArm
    table: GainTable
    limit: np.ndarray
    times: np.ndarray
    adaptive: bool


class LQPreview(Controller):
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

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        adaptive: bool = False,
        gains: Path | None = None,
    ) -> None:
        """Load the gain table.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls, a part of 1 ms or 1 ms.
            adaptive: Whether to estimate the stiffness.
            gains: Gain table; the shipped one unless given.

        Raises:
            ValueError: Another control period, or a table of another robot.
        """
        self.hold = hold_for(PERIOD, control_period, "lq_preview")
        self.sizes = {**state_sizes(robot), "curvature_rate": robot.pieces}
        arm = make_planar_arm(robot)
        path = models_dir() / "lq_preview.npz" if gains is None else gains
        n, m = arm.inputs.shape
        count = 2 * m * (n + len(KNOTS))
        table = load_gains(path, robot, "softrobot train lq_preview", count)
        limit, times = TendonMap(robot).input_scale, np.array((0.0, *KNOTS))
        self._law = reference(_Law(arm, table, limit, times, adaptive))

    def start(self, observation: Observation) -> Memory:
        """Begin from the inputs in force, with the nominal model.

        Raises:
            ValueError: The preview is at another number of times than this policy needs.
        """
        if observation["reference_preview"].size != 2 * len(KNOTS):
            raise ValueError(f"lq_preview needs an environment with preview={KNOTS}")
        n, m = self._law.arm.inputs.shape
        values = np.zeros(3 * n + m + 5 + jumps.SIZE)
        _, _, _, inputs, _, information, jump, _ = _split(values, n, m)
        inputs[:] = usable(observation["previous_action"]) * self._law.limit
        information[:] = PRIOR
        tip = observation["tip_position"]
        here = tip if np.isfinite(tip).all() else observation["reference"]
        jumps.begin_smoothing(usable(here), jump)
        return Memory(values, FINE)

    def act(self, observation: Observation, state: Memory) -> tuple[np.ndarray, Memory]:
        """The control law."""
        action, values, code = _act(
            self._law,
            state.values,
            observation["curvature"],
            observation["curvature_rate"],
            observation["tip_position"],
            observation["reference"],
            observation["reference_preview"],
            observation["previous_action"],
        )
        return action, Memory(values, code)


@kernel
def _split(memory: np.ndarray, n: int, m: int) -> tuple:
    """Views: curvature, rate, force, inputs, tip offset, information, jump and begun (1,)."""
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
def _learn(
    law: _Law,
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
    scale = stiffness_factor(law.adaptive, information)
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
            law.adaptive,
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
    law: _Law,
    memory: np.ndarray,
    curvature: np.ndarray,
    rate: np.ndarray,
    tip: np.ndarray,
    target: np.ndarray,
    preview: np.ndarray,
    previous: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (n_inputs,), next memory and code."""
    arm, table, limit, times = law.arm, law.table, law.limit, law.times
    n, m = arm.inputs.shape
    original, memory = memory, memory.copy()
    sound = finite(curvature) and finite(rate) and finite(tip) and finite(previous)
    _, _, force, inputs, offset, _, jump, begun = _split(memory, n, m)
    if not (sound and finite(target) and finite(preview)):
        begun[0] = 0.0  # the next balance of forces would span more than a period
        return kept(previous), memory, NOT_FINITE
    scale = _learn(law, memory, curvature, rate, tip, previous)

    points = np.empty((len(times), 2))
    points[0] = target
    for k in range(1, len(times)):
        points[k, 0], points[k, 1] = preview[2 * k - 2], preview[2 * k - 1]
    jumps.smoothed(PERIOD, target, times, jump, points)
    rest, inverse = np.empty(n), np.empty((m, 2))
    gap = follow(arm, points[0] - offset, force, scale, RELAXATION, limit, inputs, rest, inverse)
    velocity = (points[1] - points[0]) / times[1]
    if np.hypot(velocity[0], velocity[1]) * PERIOD > jumps.JUMP:
        velocity[:] = 0.0  # a jump ahead is no motion
    inputs_rate = inverse @ velocity
    rest_rate = arm.inputs @ inputs_rate / (scale * arm.stiffness)

    knots = len(times) - 1
    gains = np.empty(m * 2 * (n + knots))
    inside = interpolate(table, curvature, gains)
    gain = gains.reshape(m, 2 * (n + knots))
    wanted = inputs + arm.damping_time * inputs_rate
    for j in range(m):
        for i in range(n):
            wanted[j] -= gain[j, i] * (curvature[i] - rest[i])
            wanted[j] -= gain[j, n + i] * (rate[i] - rest_rate[i])
        for k in range(knots):
            for i in range(2):
                ahead = points[k + 1, i] - points[0, i] - times[k + 1] * velocity[i]
                wanted[j] += gain[j, 2 * (n + k) + i] * ahead
    action = np.empty(m)
    saturated = limited(wanted, limit, action)
    if unsound(action, memory):
        return kept(previous), original, NOT_FINITE
    if saturated:
        return action, memory, SATURATED
    if gap > REACH:
        return action, memory, UNREACHABLE
    return action, memory, FINE if inside else OUTSIDE


def environment() -> dict[str, Any]:
    """Keyword arguments of the environment that the policy needs."""
    return {"control_period": PERIOD, "preview": KNOTS}
