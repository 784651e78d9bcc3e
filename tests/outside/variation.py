"""A varied parameter from outside: gravity, times a factor."""

from dataclasses import replace

import softrobot_env
from softrobot_env.robots import RobotParams, Variation

NAME = "gravity"


def weighed(robot: RobotParams, factor: float) -> RobotParams:
    """The robot in `factor` times its gravity."""
    return replace(robot, gravity=tuple(factor * g for g in robot.gravity))


def register() -> None:
    """What a package names in the entry-point group."""
    softrobot_env.register_variation(
        Variation(NAME, weighed, range=(0.0, 10.0), label="g x {:g}".format)
    )
