"""LQI control with gain scheduling (thesis sec. 6.4, as the audit corrects it), for any robot."""

from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import implementation, kernel
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots import RobotParams

from ..base import FINE, NOT_FINITE, Memory
from ..limits import finite, kept
from ..linear_quadratic import integral_gains
from .aiming import conclude, status_code_of
from .law import Law, ScheduledLaw, in_space, tighten
from .operating_points import Equilibrium
from .table import Table, inverse_of, look_up
from .timing import timing_of

#: Weights of the cost int (|e|^2 + i (T g)^2 |a|^2) dt, with e the integral of the tip's error
#: [m s], T the period of the first mode, a the actions' distance from those at rest, and g [m] how
#: far an action of one moves the tip. Their ratio is about that of the arm's table (`thesis`).
_INPUT_WEIGHT = 5e-4

#: Decay of the integrals in the design, over T: without it there are no gains where a direction
#: cannot be controlled, such as the height of a straight robot.
_LEAK = 0.1

#: Damping of the inverse of the tip's derivative by actions.
_DAMPING = 1e-2


class LQI(ScheduledLaw):
    """a = a_OP - K (x - x_OP) - K_i int (z - z_ref) dt, corrected (6.28).

    x holds curvatures and their rates; x_OP and a_OP are the equilibrium with the tip at the
    reference, followed continuously (the printed law uses the equilibrium at the measured
    curvatures, which cancels the position feedback: see the audit). The error is not integrated
    where that would drive an action (further) beyond its limit, nor, in the arm's law, where the
    reference is out of reach.
    """

    name = "lqi"

    @classmethod
    def design(cls, robot: RobotParams) -> "Integral":
        """See `ScheduledLaw`."""
        return Integral(robot)

    def start(self, observation: Observation) -> Memory:
        """Begin from the current actions, without integrated error.

        Raises:
            ValueError: The reference has too few coordinates.
        """
        self._check_reference(observation)
        return Memory(np.concatenate([self._begun(observation), np.zeros(3)]), FINE)

    def act(self, observation: Observation, state: Memory) -> tuple[ndarray, Memory]:
        """The control law."""
        action, values, code = _act(self._law, state.values, *self._seen(observation))
        return action, Memory(values, code)


@kernel
def _act(
    law: Law,
    memory: ndarray,
    curvature: ndarray,
    rate: ndarray,
    tip_seen: ndarray,
    target_seen: ndarray,
    previous: ndarray,
) -> tuple[ndarray, ndarray, int]:
    """Action (m,), next memory (actions of the equilibrium, integral) and code."""
    table, directions = law.table, law.table.directions
    n, m, d = table.n, table.m, len(directions)
    memory = memory.copy()
    sound = finite(curvature) and finite(rate) and finite(previous)
    if not (sound and finite(tip_seen) and finite(target_seen)):
        return kept(previous), memory, NOT_FINITE
    held, integral = memory[:m], memory[m : m + d]
    tip, target = np.empty(3), np.empty(3)
    in_space(tip_seen, law.planar, tip)
    in_space(target_seen, law.planar, target)
    rest = resting(table, law, target, held, curvature)
    gain, still = rest.gains.reshape(m, 2 * n + d), rest.curvature
    wanted = rest.action.copy()
    for j in range(m):
        for i in range(n):
            wanted[j] -= gain[j, i] * (curvature[i] - still[i]) + gain[j, n + i] * rate[i]
        for i in range(d):
            wanted[j] -= gain[j, 2 * n + i] * integral[i]
    step, integrated = np.zeros(d), wanted.copy()
    for i in range(d):
        for x in range(3):
            step[i] += directions[i, x] * (tip[x] - target[x])
        step[i] *= law.period
        for j in range(m):
            integrated[j] -= gain[j, 2 * n + i] * step[i]
    if rest.integrates and _beyond(integrated) <= max(_beyond(wanted), 0.0):
        integral += step
        wanted = integrated
    tighten(law, curvature, wanted)
    return conclude(law, wanted, previous, curvature, rest.status_code, memory)


class Resting(NamedTuple):
    """The equilibrium that a law regulates to.

    Attributes:
        action: (m,) [1], which holds the tip at the reference, or near it.
        curvature: (n,) [1/m], at rest under that.
        gains: Of the law.
        status_code: Why the law may miss its target, a code of `status`.
        integrates: Whether the error may be integrated.
    """

    action: ndarray
    curvature: ndarray
    gains: ndarray
    status_code: int
    integrates: bool


@singledispatch
def resting(table: Any, law: Any, target: Any, held: Any, curvature: Any) -> Any:
    """`Resting` with the tip at a target (3,) [m].

    Args:
        table: The operating points.
        law: The law that they belong to.
        target: (3,) [m].
        held: (m,) [1], actions of the previous equilibrium, updated.
        curvature: (n,) [1/m], now.
    """
    raise NotImplementedError


@implementation(resting, Table)
@kernel
def _looked_up(
    table: Table, law: Law, target: ndarray, held: ndarray, curvature: ndarray
) -> Resting:
    now = look_up(table, target, held)
    held[:] = now.action
    to_action = inverse_of(now.jacobian @ now.by_action, table.directions, _DAMPING)
    correction = -(to_action @ (now.tip - target))
    rest = now.curvature + now.by_action @ correction
    status_code = status_code_of(law, table.directions @ (now.tip - target))
    return Resting(now.action + correction, rest, now.gains, status_code, True)


@kernel
def _beyond(action: ndarray) -> float:
    """Sum of how far actions (m,) lie beyond their limits."""
    total = 0.0
    for value in action:
        total += max(abs(value) - 1.0, 0.0)
    return total


class Integral:
    """The gains of `LQI` for one robot."""

    def __init__(self, robot: RobotParams) -> None:
        """Set up for any robot, with times scaled by its first mode."""
        self._first = timing_of(robot).first

    def count(self, n: int, m: int, directions: int) -> int:
        """Number of gains at a point, for n curvatures, m actions and so many directions."""
        return m * (2 * n + directions)

    def __call__(self, point: Equilibrium, directions: ndarray) -> ndarray:
        """Gains [K, K_i] (m, 2 n + k) at an operating point, for directions (k, 3), flattened."""
        n, first = len(point.curvature), self._first
        a, b, tip = point.model.state_space()
        size = np.repeat([1.0, 1 / first], n)  # of states, so that they are of similar size
        place = directions @ tip
        k = len(place)
        gain = np.linalg.norm(place[:, :n] @ point.by_action) / np.sqrt(k)  # m
        # With times scaled by the first mode.
        system = first * a * size / size[:, None], first * b / size[:, None]
        found = integral_gains(system, place * size, _INPUT_WEIGHT * gain**2, leak=_LEAK)
        return (found / np.concatenate([size, np.full(k, first)])).ravel()
