"""Model predictive control of any robot: an LQ plan, corrected for what its drives can do.

The plan that `LQPreview` would follow is the optimum for a linear model and a quadratic cost over
an infinite horizon. Actions a at some nodes ahead that differ from the plan a* cost (a - a*)' H (a
- a*) more; the cheapest ones are taken that respect the limits of actions, of the servos' speed and
force, and of the tension of tendons that must stay taut. Where no limit is active, the law is LQ's.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots import RobotParams

from ..base import NOT_COMPUTED, NOT_FINITE, SATURATED, Memory
from ..limits import kept
from ..linear_quadratic import BoundedSolver
from . import aiming
from .law import Law, ScheduledLaw, strongest, tighten
from .lq_preview import Preview
from .plan_gains import Regulator, deviation_cost
from .timing import Timing, knots_until, timing_of

#: Share of the first mode's period beyond which actions at rest are looked up.
_CURVED = 0.05

#: [1], distance from a bound within which an action counts as being at it.
_AT_BOUND = 1e-9


@dataclass(frozen=True)
class PlanSettings:
    """Horizon of a model predictive controller, in units of the period of the robot's first mode.

    Attributes:
        period: [1] between decisions; None: the control period of `timing_of`.
        nodes: (c,) [1], times of the planned actions after the first, which is one period ahead.
        preview: [1], how far ahead the reference is seen; None: no preview.
        estimate: Whether to estimate model errors.
    """

    period: float | None
    nodes: tuple[float, ...]
    preview: float | None
    estimate: bool

    def timing(self, robot: RobotParams) -> Timing:
        """The times at which a robot's controller decides, sees the reference and plans actions."""
        own = timing_of(robot)
        first, period = own.first, own.period
        if self.period is not None:
            period = round(max(round(self.period * first / period), 1) * period, 9)
        counts = sorted({1, *(max(round(node * first / period), 2) for node in self.nodes)})
        nodes = tuple(round(count * period, 9) for count in counts)
        knots = () if self.preview is None else knots_until(self.preview, first, period)
        return Timing(first, period, knots, nodes)


#: As in the thesis (sec. 6.5): twelve decisions in the first mode's period, three actions over five
#: of them, no preview and no estimates.
THESIS = PlanSettings(1 / 12, (2 / 12, 5 / 12), None, False)

#: With preview and estimates. More than two nodes do not track better, and need larger tables.
PREVIEW = PlanSettings(None, (0.15,), 1.0, True)


def preview_environment(robot: RobotParams) -> dict[str, Any]:
    """What `mpc_preview` needs of an environment: the control period, and preview."""
    return PREVIEW.timing(robot).environment


class Constrained(Preview):
    """The gains of `ScheduledMPC`: those of a plan, then the lower triangle of H."""

    def __init__(self, robot: RobotParams, settings: PlanSettings = PREVIEW) -> None:
        """Set up for any robot, whose drive speed is used."""
        super().__init__(robot, settings.timing(robot))

    def count(self, n: int, m: int, directions: int) -> int:
        """See `Preview`."""
        size = len(self._timing.nodes) * m
        return super().count(n, m, directions) + size * (size + 1) // 2

    def _gains(self, regulator: Regulator, directions: ndarray) -> ndarray:
        cost = deviation_cost(regulator, self._timing)
        triangle = cost[np.tril_indices(len(cost))]
        return np.concatenate([super()._gains(regulator, directions), triangle])


class Program(NamedTuple):
    """A quadratic program for the actions (c, m) at the nodes.

    Attributes:
        wanted: (c m,) [1], the plan.
        hessian: H (c m, c m).
        lower, upper: (c m,) [1].
        fine: Whether the plan respects all limits.
        status_code: See `TrackingTarget`.
    """

    wanted: ndarray
    hessian: ndarray
    lower: ndarray
    upper: ndarray
    fine: bool
    status_code: int


class ScheduledMPC(aiming.AimingLaw):
    """Plans actions over a horizon, within the limits of the drives, and applies the first."""

    name, curved, settings = "mpc_preview", _CURVED, PREVIEW

    def __init__(self, robot: RobotParams, control_period: float, gains: Any = None) -> None:
        """Prepare for a robot, and decide once so that everything is compiled.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            gains: See `ScheduledLaw`.

        Raises:
            ValueError, FileNotFoundError: As there.
            ImportError: The solver of the quadratic programs is not installed.
        """
        timing, estimate = self.settings.timing(robot), self.settings.estimate
        super().__init__(robot, control_period, gains, timing, estimate=estimate)
        self._solve = BoundedSolver()
        self._rows, self._most = _speed_rows(self._law)
        self._warm_up()

    @classmethod
    def design(cls, robot: RobotParams) -> Constrained:
        """See `ScheduledLaw`."""
        return Constrained(robot, cls.settings)

    def _warm_up(self) -> None:
        """Decide for a reference far enough away to activate the limits."""
        table = self._law.table
        far = np.full(3, 10 * self._law.reach)
        observation = {name: np.zeros(size) for name, size in self.sizes.items()}
        observation |= {"tip_position": table.tips[0], "previous_action": np.zeros(table.m)}
        observation |= {"reference": table.tips[0] + far}
        observation["reference_preview"] = np.tile(far, len(self._law.times) - 1)
        self.act(observation, self.start(observation))

    def act(self, observation: Observation, state: Memory) -> tuple[ndarray, Memory]:
        """The first of the optimal actions; the last action is kept if none were found."""
        *shown, previous = self._seen(observation)
        none = [shown[0][:0]] if len(self._law.times) == 1 else []  # no preview
        seen = aiming.Seen(*shown, *none, previous)
        memory = state.values.copy()
        if not aiming.seen_well(seen):
            aiming.forget_balance(self._law, memory)
            return kept(previous), Memory(memory, NOT_FINITE)
        program = _program(self._law, memory, seen)
        best = program.wanted if program.fine else self._optimum(program)
        if best is None:
            return kept(previous), Memory(state.values, NOT_COMPUTED)
        m = self._law.table.m
        action, memory, code = aiming.conclude(
            self._law, best[:m], previous, seen.curvature, program.status_code, memory
        )
        missed = np.abs(best[:m] - program.wanted[:m]).max() > _AT_BOUND
        return action, Memory(memory, SATURATED if missed else code)

    def _optimum(self, program: Program) -> ndarray | None:
        lower = np.concatenate([program.lower, -self._most])
        upper = np.concatenate([program.upper, self._most])
        gradient = -program.hessian @ program.wanted
        return self._solve(program.hessian, gradient, lower, upper, self._rows)


class WithoutPreview(ScheduledMPC):
    """`ScheduledMPC` with the thesis' horizon, without preview and estimates of model errors."""

    name, settings = "mpc", THESIS
    observables = ScheduledLaw.observables


def _speed_rows(law: Law) -> tuple[ndarray, ndarray]:
    """Rows (r, c m) that give changes of actions between nodes, and the largest changes (r,) [1].

    No rows for drives that follow at once. The first change is limited by the bounds of the first
    action.
    """
    m, count = law.table.m, len(law.nodes)
    if not np.isfinite(law.speed).all():
        return np.empty((0, count * m)), np.empty(0)
    periods = np.diff(law.nodes) / law.period
    rows = np.kron(np.diff(np.eye(count), axis=0), np.eye(m))
    return rows, np.outer(periods, law.speed).ravel()


@kernel
def _program(law: Law, memory: ndarray, seen: aiming.Seen) -> Program:
    """The program to solve; the memory is updated."""
    aim = aiming.aimed(law.table, law, memory, seen)
    plan = aiming.planned(law, aim)
    count, m = plan.shape
    size = count * m
    lower, upper = -np.ones(size), np.ones(size)
    for c in range(count):
        bent = seen.curvature + _bent_by(law, aim, law.nodes[c] - law.period)
        tighten(law, bent, plan[c])
        upper[c * m : (c + 1) * m] = np.minimum(np.maximum(strongest(law, bent), -1.0), 1.0)
    _bound_first(law, seen.curvature, seen.previous, lower, upper)
    fine, hessian = True, np.empty((size, size))
    triangle = aim.gains[len(aim.gains) - size * (size + 1) // 2 :]
    k = 0
    for i in range(size):
        fine &= lower[i] <= plan[i // m, i % m] <= upper[i]
        for j in range(i + 1):
            hessian[i, j] = hessian[j, i] = triangle[k]
            k += 1
    for c in range(1, count):
        periods = (law.nodes[c] - law.nodes[c - 1]) / law.period
        for j in range(m):
            fine &= abs(plan[c, j] - plan[c - 1, j]) <= periods * law.speed[j]
    return Program(plan.ravel(), hessian, lower, upper, fine, aim.status_code)


@kernel
def _bound_first(
    law: Law, curvature: ndarray, previous: ndarray, lower: ndarray, upper: ndarray
) -> None:
    """Set the bounds of the first actions: within reach of the drives, and tendons taut."""
    loose = law.table.moment_arms @ curvature
    for j in range(len(previous)):
        here = min(max(previous[j], -1.0), 1.0)
        lower[j] = max(here - law.speed[j], -1.0)
        upper[j] = max(min(here + law.speed[j], upper[j]), lower[j])  # speed before force
        if law.stiffness[j] > 0:
            taut = loose[j] / law.stiffness[j]
            lower[j] = min(max(lower[j], taut), upper[j])


@kernel
def _bent_by(law: Law, aim: aiming.TrackingTarget, time: float) -> ndarray:
    """(n,) [1/m], change of the curvatures with the reference until a time [s]."""
    way = time * aim.velocity
    for k in range(1, len(law.times)):
        before, after = law.times[k - 1], law.times[k]
        share = min(max((time - before) / (after - before), 0.0), 1.0)
        for x in range(3):
            last = aim.ways[3 * k - 6 + x] if k > 1 else 0.0
            way[x] += share * (aim.ways[3 * k - 3 + x] - last)
    return aim.bending @ way
