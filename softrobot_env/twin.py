"""`softrobot_env.robots.twin` under its public name."""

from softrobot_env.core.registry import served
from softrobot_env.robots.registry import CAMERA_PERIOD as FRAME  # noqa: F401
from softrobot_env.robots.registry import SERVO_SPEED  # noqa: F401
from softrobot_env.robots.twin import *  # noqa: F403

__getattr__ = served("softrobot_env.robots.twin")
