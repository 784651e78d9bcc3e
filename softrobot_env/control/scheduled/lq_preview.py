"""LQ tracking with reference preview, offset-free and, if wanted, adaptive in the stiffness.

It extends the thesis' LQI: the future reference enters the law; the equilibrium about which it
regulates moves with the reference; unannounced jumps are smoothed; and instead of integrating the
error, which overshoots, model errors are estimated and compensated.

For the planar arm the statics are solved in closed form (`control.arm.operating_points`), and the
gains belong to thirds of the backbone; for other robots equilibria are looked up, and the gains
belong to positions of the tip.
"""

from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots import RobotParams

from ..base import NOT_FINITE, Memory
from ..limits import kept
from . import aiming
from .law import Law, tighten
from .operating_points import Equilibrium
from .plan_gains import Regulator, plan_gains, regulator_of
from .timing import Timing, timing_of


class LQPreview(aiming.AimingLaw):
    """a = a_OP + da_OP - K (x - x_OP, a- - a_OP) + sum_i G_i (r_i - r_0 - t_i r.).

    x_OP and a_OP hold the tip at the present reference r_0 and move with it at its velocity r.;
    a- is the current action, r_i the reference at the time t_i ahead. Model errors are estimated
    from the actions actually applied, and compensated: a shift of the curvatures, an offset of the
    tip, and, if `adaptive`, the stiffness.
    """

    name = "lq_preview"

    @classmethod
    def design(cls, robot: RobotParams) -> "Preview":
        """See `ScheduledLaw`."""
        return Preview(robot)

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
    tip: ndarray,
    target: ndarray,
    preview: ndarray,
    previous: ndarray,
) -> tuple[ndarray, ndarray, int]:
    """Action (m,), next memory and code; separate arrays make the call faster."""
    seen = aiming.Seen(curvature, rate, tip, target, preview, previous)
    memory = memory.copy()
    if not aiming.seen_well(seen):
        aiming.forget_balance(law, memory)
        return kept(seen.previous), memory, NOT_FINITE
    aim = aiming.aimed(law.table, law, memory, seen)
    wanted = aiming.planned(law, aim)[0]
    tighten(law, seen.curvature, wanted)
    return aiming.conclude(law, wanted, previous, curvature, aim.status_code, memory)


class Preview:
    """The gains of `LQPreview` for one robot, as `plan_gains` lays them out."""

    def __init__(self, robot: RobotParams, timing: Timing | None = None) -> None:
        """Set up for any robot, whose drive speed is used; by default at the times of the robot."""
        self._robot, self._timing = robot, timing or timing_of(robot)

    def count(self, n: int, m: int, directions: int) -> int:
        """Number of gains at a point, for n curvatures, m actions and so many directions."""
        return len(self._timing.nodes) * m * (2 * n + m + 3 * len(self._timing.knots))

    def __call__(self, point: Equilibrium, directions: ndarray) -> ndarray:
        """Gains (k,) at an operating point, for directions (k, 3) of its `Table`."""
        regulator = regulator_of(self._robot, point, directions, self._timing)
        return self._gains(regulator, directions)

    def _gains(self, regulator: Regulator, directions: ndarray) -> ndarray:
        return plan_gains(regulator, self._timing, directions)
