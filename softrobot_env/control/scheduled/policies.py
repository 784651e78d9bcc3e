"""Laws on tables behind the names that the thesis has for its arm alone."""

from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.artifacts import check_robot, find_artifact, fingerprint, read_arrays
from softrobot_env.control.arm import lq_preview as arm
from softrobot_env.control.arm import lqi as arm_lqi
from softrobot_env.control.arm.operating_points import PERIOD, is_arm
from softrobot_env.control.scheduled.law import read_table, table_arrays
from softrobot_env.control.scheduled.lq_preview import LQPreview, Preview
from softrobot_env.control.scheduled.lqi import LQI, Integral
from softrobot_env.control.scheduled.timing import timing_of
from softrobot_env.interfaces import Policy
from softrobot_env.robots import RobotParams


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
        return arm.LQPreview(
            robot, control_period, adaptive, None if gains is None else Path(gains)
        )
    return LQPreview(robot, control_period, _table(robot, "lq_preview", Preview, gains), adaptive)


def make_lqi(robot: RobotParams, control_period: float, gains: str | Path | None = None) -> Policy:
    """LQI with gain scheduling: as `make_lq_preview`."""
    if is_arm(robot):
        return arm_lqi.LQI(robot, control_period, None if gains is None else Path(gains))
    return LQI(robot, control_period, _table(robot, "lqi", Integral, gains))


def _table(robot: RobotParams, name: str, design: Any, gains: str | Path | None) -> Any:
    """Reference to the table of a robot for a policy, with the gains of a design."""
    path = find_artifact(robot, name) if gains is None else Path(gains)
    data = read_arrays(path)
    check_robot(data, robot, name)
    return read_table(data, robot, design.count)


def lqi_environment(robot: RobotParams) -> dict[str, Any]:
    """What `lqi` needs of an environment: its control period."""
    period = PERIOD if is_arm(robot) else timing_of(robot).period
    return {"control_period": period}


def lq_environment(robot: RobotParams) -> dict[str, Any]:
    """What `lq_preview` needs of an environment: its control period, and preview."""
    if is_arm(robot):
        return arm.ENVIRONMENT
    timing = timing_of(robot)
    return {"control_period": timing.period, "preview": timing.knots}


def save_table(path: Path, table: Any, robot: RobotParams, errors: Any) -> None:
    """Write the table of a robot with its operating points' errors (points,) [m]."""
    np.savez_compressed(path, **table_arrays(table), **fingerprint(robot), errors=errors)
