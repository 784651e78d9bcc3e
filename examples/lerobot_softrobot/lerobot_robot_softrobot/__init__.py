"""softrobot_env in LeRobot: `--robot.type=softrobot`, `--teleop.type=softrobot_keys`."""

from .keys import SoftRobotKeys, SoftRobotKeysConfig
from .robot import SoftRobot, SoftRobotConfig

__all__ = ["SoftRobot", "SoftRobotConfig", "SoftRobotKeys", "SoftRobotKeysConfig"]
