"""Robots as data: parameters, tendons, loads, how tendons are driven, and the named robots.

The names here are what other parts import; `robots.twin` and `robots.actuation` hold the rest.
Further robots, such as `ARM` and `RIG` of the thesis, are names that plug-ins hold.
"""

from collections.abc import Callable
from typing import Any
from warnings import warn

from softrobot_env.core.registry import served

from .file import read_gripper, read_robot, write_gripper, write_robot
from .loads import Load
from .parameters import Base, Disc, Drive, Finger, Gripper, Head, RobotParams, centerline
from .registry import (
    CAMERA_PERIOD,
    ENTRIES,
    EXAMPLES,
    GRIPPERS,
    LENGTH_SCALE,
    ROBOTS,
    SERVO_SPEED,
    RobotEntry,
    default_robot,
    entry_of,
    find_gripper,
    find_robot,
    register_entry,
    register_robot,
    usual_task,
)
from .sections import Backbone, Section
from .sensors import Sensor
from .tendons import Tendon
from .variations import VARIATIONS, Variation, as_number, neutral, register_variation

_served = served(__name__)

#: Earlier names that `VARIATIONS` stands for.
_OLD: dict[str, Callable[[], Any]] = {
    "NEUTRAL": lambda: neutral(robots_only=True),
    "VARIABLE": lambda: tuple(neutral(robots_only=True)),
}


def __getattr__(name: str) -> Any:
    if name not in _OLD:
        return _served(name)
    warn(f"robots.{name} is in robots.VARIATIONS now", DeprecationWarning, stacklevel=2)
    return _OLD[name]()


__all__ = [
    "CAMERA_PERIOD",
    "ENTRIES",
    "EXAMPLES",
    "GRIPPERS",
    "LENGTH_SCALE",
    "ROBOTS",
    "SERVO_SPEED",
    "VARIATIONS",
    "Backbone",
    "Base",
    "Disc",
    "Drive",
    "Finger",
    "Gripper",
    "Head",
    "Load",
    "RobotEntry",
    "RobotParams",
    "Section",
    "Sensor",
    "Tendon",
    "Variation",
    "as_number",
    "centerline",
    "default_robot",
    "entry_of",
    "find_gripper",
    "find_robot",
    "read_gripper",
    "read_robot",
    "register_entry",
    "register_robot",
    "register_variation",
    "usual_task",
    "write_gripper",
    "write_robot",
]
