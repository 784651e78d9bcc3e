"""Robots by name."""

from softrobot_env.robots.arm import ARM
from softrobot_env.robots.cantilevers import CANTILEVER_STIFF, CANTILEVER_WEAK
from softrobot_env.robots.rig import EQUIVALENT_RIG, RIG

ROBOTS = {
    robot.name: robot for robot in (ARM, CANTILEVER_WEAK, CANTILEVER_STIFF, RIG, EQUIVALENT_RIG)
}
