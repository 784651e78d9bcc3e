"""Robots as data: parameters, tendons, loads, how tendons are driven, and the named robots.

The names here are what other parts import; `robots.twin`, `robots.actuation` and
`robots.three_tendons` hold the rest.
"""

from softrobot_env.robots.file import read_gripper, read_robot, write_gripper, write_robot
from softrobot_env.robots.gripper import Finger, Gripper
from softrobot_env.robots.loads import Load
from softrobot_env.robots.parameters import (
    MAY_VANISH,
    NEUTRAL,
    VARIABLE,
    Base,
    Disc,
    Drive,
    Head,
    RobotParams,
    as_number,
    centerline,
    check_number,
)
from softrobot_env.robots.registry import (
    ARM,
    CAMERA_PERIOD,
    CANTILEVER_STIFF,
    CANTILEVER_WEAK,
    EQUIVALENT,
    EQUIVALENT_RIG,
    EXAMPLES,
    GRIPPERS,
    LENGTH_SCALE,
    RIG,
    ROBOTS,
    SERVO_SPEED,
    WORKSPACE,
    find_gripper,
    find_robot,
    register_robot,
)
from softrobot_env.robots.sections import Backbone, Section
from softrobot_env.robots.sensors import Sensor
from softrobot_env.robots.tendons import Tendon

__all__ = [
    "ARM",
    "CAMERA_PERIOD",
    "CANTILEVER_STIFF",
    "CANTILEVER_WEAK",
    "EQUIVALENT",
    "EQUIVALENT_RIG",
    "EXAMPLES",
    "GRIPPERS",
    "LENGTH_SCALE",
    "MAY_VANISH",
    "NEUTRAL",
    "RIG",
    "ROBOTS",
    "SERVO_SPEED",
    "VARIABLE",
    "WORKSPACE",
    "Backbone",
    "Base",
    "Disc",
    "Drive",
    "Finger",
    "Gripper",
    "Head",
    "Load",
    "RobotParams",
    "Section",
    "Sensor",
    "Tendon",
    "as_number",
    "centerline",
    "check_number",
    "find_gripper",
    "find_robot",
    "read_gripper",
    "read_robot",
    "register_robot",
    "write_gripper",
    "write_robot",
]
