"""Laws of any robot on tables over its workspace, which `softrobot train` makes."""

from pathlib import Path
from typing import Any

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.core.interfaces import Policy
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import check_robot, find_artifact, fingerprint

from .law import read_table, table_arrays
from .lq_preview import LQPreview, Preview
from .lqi import LQI, Integral
from .mpc import PREVIEW, THESIS, Constrained, ScheduledMPC


def make_lq_preview(
    robot: RobotParams,
    control_period: float,
    adaptive: bool = False,
    gains: str | Path | None = None,
) -> Policy:
    """LQ with preview, by a table of the robot's chain.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        adaptive: Whether to estimate the stiffness.
        gains: File of the table; found unless given, see `artifacts.find_artifact`.

    Raises:
        ValueError: No table of this robot, or a control period that is no part of its own.
        FileNotFoundError: No such file.
    """
    return LQPreview(
        robot, control_period, _table(robot, "lq_preview", Preview(robot), gains), adaptive
    )


def make_lqi(robot: RobotParams, control_period: float, gains: str | Path | None = None) -> Policy:
    """LQI with gain scheduling: as `make_lq_preview`."""
    return LQI(robot, control_period, _table(robot, "lqi", Integral(robot), gains))


def make_mpc(
    robot: RobotParams,
    control_period: float,
    preview: bool = False,
    gains: str | Path | None = None,
) -> Policy:
    """Model predictive control: as `make_lq_preview`.

    Args:
        robot, control_period, gains: As there.
        preview: Whether the reference is seen ahead, and what the model leaves unexplained is
            estimated.

    Raises:
        ValueError: As there.
        ImportError: The solver of the quadratic programs is not installed.
    """
    name, design = ("mpc_preview", Constrained) if preview else ("mpc", WithoutPreview)
    table = _table(robot, name, design(robot), gains)
    return ScheduledMPC(robot, control_period, table, PREVIEW if preview else THESIS)


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
