"""Robots by name."""

from softrobot_env.registries import Registry
from softrobot_env.robots.arm import ARM
from softrobot_env.robots.cantilevers import CANTILEVER_STIFF, CANTILEVER_WEAK
from softrobot_env.robots.rig import EQUIVALENT_RIG, RIG

_ENTRIES = (ARM, CANTILEVER_WEAK, CANTILEVER_STIFF, RIG, EQUIVALENT_RIG)

ROBOTS = Registry("robot", {robot.name: robot for robot in _ENTRIES})
