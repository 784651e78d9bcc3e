"""The rig's curvature sensor in place of the camera: calibrated once, undisturbed, then alone."""

from dataclasses import replace
from functools import cache

from softrobot_env.benchmarks.feedback.rigs import LATE, disturbed
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import Sensed
from softrobot_env.envs.rig import RigEnv
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin
from softrobot_env.sensing.reconstruction import Reconstruction
from softrobot_env.tasks import Task
from softrobot_env.training.sensors import calibrated


def rig_with_sensor(task: Task, twin: Twin, late: float = LATE) -> RigEnv:
    """An environment whose sensor reads late [s]."""
    sensors = tuple(replace(sensor, delay=late) for sensor in twin.robot.sensors)
    built = replace(twin, robot=replace(twin.robot, sensors=sensors))
    return RigEnv(task, twin=built, observe=("all", "sensors"))


def sensed(policy: str, twin: int, period: float) -> Sensed:
    """A policy that reads the tip, by the calibrated sensor of a twin, every `period` [s]."""
    return Sensed(make_policy(policy, RIG, period, tip_delay=LATE), calibration(twin), period)


@cache
def calibration(seed: int) -> Reconstruction:
    """The sensor of an undisturbed twin."""
    return calibrated(RIG, seed, disturbed(seed, ""))
