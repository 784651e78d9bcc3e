"""Laws on tables behind the names that the thesis has for its arm alone."""

from pathlib import Path
from typing import Any

from softrobot_env.beams.closed_forms.planar_arm import make_planar_arm
from softrobot_env.control.arm.operating_points import read_grid
from softrobot_env.control.arm.timing import TIMING, is_arm
from softrobot_env.control.base import state_sizes
from softrobot_env.control.mpc import controller as closed_mpc
from softrobot_env.control.scheduled.law import ScheduledLaw, read_table, table_arrays
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.lqi import LQI, Integral
from softrobot_env.control.scheduled.mpc import PREVIEW, THESIS, Constrained, ScheduledMPC
from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.core.interfaces import Policy
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import check_robot, find_artifact, fingerprint


def make_lq_preview(
    robot: RobotParams,
    control_period: float,
    adaptive: bool = False,
    gains: str | Path | None = None,
) -> Policy:
    """LQ with preview: of the arm in closed form, of other robots by a table of their chain.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        adaptive: Whether to estimate the stiffness.
        gains: File of the table; found unless given, see `artifacts.find_artifact`.

    Raises:
        ValueError: No table of this robot, or a control period that is no part of its own.
        FileNotFoundError: No such file.
    """
    if is_arm(robot):
        columns = 2 * robot.pieces, 2 * len(TIMING.knots)
        table = read_grid(robot, "lq_preview", columns, None if gains is None else Path(gains))
        return _of_arm(LQPreview(robot, control_period, table, adaptive, TIMING), robot)
    return LQPreview(
        robot, control_period, _table(robot, "lq_preview", Preview(robot), gains), adaptive
    )


def make_lqi(robot: RobotParams, control_period: float, gains: str | Path | None = None) -> Policy:
    """LQI with gain scheduling: as `make_lq_preview`."""
    if is_arm(robot):
        columns = (2 * robot.pieces + 2,)
        table = read_grid(robot, "lqi", columns, None if gains is None else Path(gains))
        return _of_arm(LQI(robot, control_period, table, TIMING), robot)
    return LQI(robot, control_period, _table(robot, "lqi", Integral(robot), gains))


def _of_arm(law: ScheduledLaw, robot: RobotParams) -> ScheduledLaw:
    """A law of the arm, which knows the sizes of all that it reads."""
    sizes = state_sizes(robot) | {"reference_preview": 2 * len(TIMING.knots)}
    law.sizes = {name: sizes[name] for name in law.requires}
    law.preview = TIMING.knots if "reference_preview" in law.requires else None
    return law


def make_mpc(
    robot: RobotParams,
    control_period: float,
    preview: bool = False,
    gains: str | Path | None = None,
) -> Policy:
    """Model predictive control: of planar arms in closed form, of others as `make_lq_preview`.

    Args:
        robot, control_period, gains: As there.
        preview: Whether the reference is seen ahead, and what the model leaves unexplained is
            estimated.

    Raises:
        ValueError: As there.
        ImportError: The solver of the quadratic programs is not installed.
    """
    if is_planar_arm(robot):
        return (closed_mpc.make_preview if preview else closed_mpc.MPC)(robot, control_period)
    name, design = ("mpc_preview", Constrained) if preview else ("mpc", WithoutPreview)
    table = _table(robot, name, design(robot), gains)
    return ScheduledMPC(robot, control_period, table, PREVIEW if preview else THESIS)


def is_planar_arm(robot: RobotParams) -> bool:
    """Whether the closed form of planar arms knows a robot."""
    try:
        make_planar_arm(robot)
    except ValueError:
        return False
    return True


def _table(robot: RobotParams, name: str, design: Any, gains: str | Path | None) -> Any:
    """Reference to the table of a robot for a policy, with the gains of a design."""
    path = find_artifact(robot, name) if gains is None else Path(gains)
    data = read_arrays(path)
    check_robot(data, robot, name)
    with data.fitting():
        return read_table(data, design.count)


class WithoutPreview(Constrained):
    """The gains of `mpc`, as the thesis' horizon has them."""

    def __init__(self, robot: RobotParams) -> None:
        """Of any robot."""
        super().__init__(robot, THESIS)


def save_table(path: Path, table: Any, robot: RobotParams, errors: Any) -> None:
    """Write the table of a robot with its operating points' errors (points,) [m]."""
    write_arrays(path, {**table_arrays(table), **fingerprint(robot), "errors": errors})
