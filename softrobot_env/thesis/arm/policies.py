"""The closed forms that take the place of laws on tables for the arm, and for planar arms.

They stay because they are better on their robot, as measured on its MuJoCo plant beside the laws of
any robot (`control.scheduled`) on a table of 219 operating points. Mean errors [mm] of the
episodes that `softrobot evaluate --tasks swing lshape` runs, with each of the two in turn:

    law           closed form       table
    lqi           0.33    0.13      0.50   0.29
    lq_preview    0.031   0.013     0.30   0.13
    mpc           6.1     1.5       8.3    2.3
    mpc_preview   0.010   0.007     0.26   0.12

So does the observer of the arm (`control.observers.arm_observer`): with rates of the linearised
chain, LQ laws err as much within 3 %, but `imitation` by up to half more on an arm half as heavy.
"""

from pathlib import Path
from typing import Any

from softrobot_env.control.base import state_sizes
from softrobot_env.control.scheduled.law import ScheduledLaw
from softrobot_env.control.scheduled.lq_preview import LQPreview
from softrobot_env.control.scheduled.lqi import LQI
from softrobot_env.core.interfaces import Policy
from softrobot_env.robots import RobotParams

from .mpc import MPC
from .mpc_settings import PREVIEW, THESIS
from .operating_points import read_grid
from .timing import TIMING

#: A file, or None where it is looked for.
_Path = str | Path | None


def make_lq_preview(
    robot: RobotParams, control_period: float, adaptive: bool = False, gains: _Path = None
) -> Policy:
    """LQ with preview, see `control.scheduled`."""
    columns = 2 * robot.pieces, 2 * len(TIMING.knots)
    table = _grid(robot, "lq_preview", columns, gains)
    return _of_arm(LQPreview(robot, control_period, table, TIMING, adaptive), robot)


def make_lqi(robot: RobotParams, control_period: float, gains: _Path = None) -> Policy:
    """LQI with gain scheduling, see `control.scheduled`."""
    table = _grid(robot, "lqi", (2 * robot.pieces + 2,), gains)
    return _of_arm(LQI(robot, control_period, table, TIMING), robot)


def make_mpc(
    robot: RobotParams, control_period: float, preview: bool = False, gains: _Path = None
) -> Policy:
    """Model predictive control of a planar arm; see `control.scheduled`.

    There is no table: `gains` is not read.
    """
    return MPC(robot, control_period, PREVIEW if preview else THESIS)


def _grid(robot: RobotParams, name: str, columns: tuple[int, ...], gains: _Path) -> Any:
    return read_grid(robot, name, columns, None if gains is None else Path(gains))


def _of_arm(law: ScheduledLaw, robot: RobotParams) -> ScheduledLaw:
    """A law of the arm, which knows the sizes of all that it reads."""
    sizes = state_sizes(robot) | {"reference_preview": 2 * len(TIMING.knots)}
    law.sizes = {name: sizes[name] for name in law.requires}
    law.preview = TIMING.knots if "reference_preview" in law.requires else None
    return law
