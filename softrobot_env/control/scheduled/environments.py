"""What laws need of an environment, by robot; for the arm without loading the laws themselves."""

from typing import Any

from softrobot_env.control.arm.timing import TIMING, is_arm
from softrobot_env.control.mpc.settings import PREVIEW_ENVIRONMENT
from softrobot_env.control.scheduled.timing import Timing, timing_of
from softrobot_env.robots import RobotParams


def lqi_environment(robot: RobotParams) -> dict[str, Any]:
    """What `lqi` needs of an environment: its control period."""
    return {"control_period": _timing(robot).period}


def lq_environment(robot: RobotParams) -> dict[str, Any]:
    """What `lq_preview` needs of an environment: its control period, and preview."""
    timing = _timing(robot)
    return {"control_period": timing.period, "preview": timing.knots}


def _timing(robot: RobotParams) -> Timing:
    return TIMING if is_arm(robot) else timing_of(robot)


def mpc_environment(robot: RobotParams) -> dict[str, Any]:
    """What `mpc` needs of an environment: its control period."""
    if is_arm(robot) or _is_planar_arm(robot):
        return {"control_period": 0.01}
    return {"control_period": timing_of(robot).period}


def mpc_preview_environment(robot: RobotParams) -> dict[str, Any]:
    """What `mpc_preview` needs of an environment: its control period, and preview."""
    if is_arm(robot) or _is_planar_arm(robot):
        return PREVIEW_ENVIRONMENT
    from softrobot_env.control.scheduled.mpc import PREVIEW

    timing = PREVIEW.timing(robot)
    return {"control_period": timing.period, "preview": timing.knots}


def _is_planar_arm(robot: RobotParams) -> bool:
    from softrobot_env.control.scheduled.policies import is_planar_arm

    return is_planar_arm(robot)
