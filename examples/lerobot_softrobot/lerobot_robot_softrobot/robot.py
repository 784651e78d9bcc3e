"""Any environment of softrobot_env, simulated, virtual or real, as a robot of LeRobot."""

from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from lerobot.robots import Robot, RobotConfig

import softrobot_env  # noqa: F401  # registers the environments

from .names import action_names, flat, observation_names


@RobotConfig.register_subclass("softrobot")
@dataclass(kw_only=True)
class SoftRobotConfig(RobotConfig):
    """Which robot.

    Attributes:
        environment: Gymnasium's id.
        options: Of the environment, such as `{robot_file: rig.toml}` or `{robot: my.toml}`.
        pictures: Name of a picture among the observations; empty for none.
    """

    environment: str = "SoftRobot/ArmSwing-v0"
    options: dict[str, Any] = field(default_factory=dict)
    pictures: str = ""


class SoftRobot(Robot):
    """A robot whose action is a share of full scale for each of its inputs, in [-1, 1].

    `send_action` takes one control period of the environment: let LeRobot run at that rate, see
    `fps`. A real robot keeps the time itself. When its task is over, the robot returns to its rest
    before the next action; a fault ends the program.
    """

    config_class = SoftRobotConfig
    name = "softrobot"

    def __init__(self, config: SoftRobotConfig) -> None:
        super().__init__(config)
        shown = {"render_mode": "rgb_array"} if config.pictures else {}
        self._env = gymnasium.make(config.environment, **config.options, **shown)
        self._picture = config.pictures
        self.cameras = dict.fromkeys(filter(None, [config.pictures]))  # LeRobot counts them
        self._seen: dict[str, np.ndarray] | None = None
        self._over = False

    @property
    def fps(self) -> float:
        """Actions a second."""
        return 1 / self._env.unwrapped.control_period

    @property
    def observation_features(self) -> dict[str, Any]:
        """Names of numbers, and the size of the picture."""
        found: dict[str, Any] = dict.fromkeys(observation_names(self._env), float)
        if self._picture:
            env = self._env.unwrapped
            found[self._picture] = (env.height, env.width, 3)
        return found

    @property
    def action_features(self) -> dict[str, Any]:
        """Names of inputs."""
        return dict.fromkeys(action_names(self._env), float)

    @property
    def is_connected(self) -> bool:
        """Whether an episode runs."""
        return self._seen is not None

    def connect(self, calibrate: bool = True) -> None:
        """Bring the robot to rest and begin."""
        if self.is_connected:
            raise RuntimeError(f"{self} is connected already")
        self.reset()

    def reset(self) -> None:
        """Begin the environment's task anew, from rest."""
        self._seen, _ = self._env.reset()
        self._over = False

    @property
    def is_calibrated(self) -> bool:
        """A real robot's file has its calibration: `softrobot robot calibrate`."""
        return True

    def calibrate(self) -> None:
        """Nothing to do here."""

    def configure(self) -> None:
        """Nothing to do: the robot's file says it all."""

    def get_observation(self) -> dict[str, Any]:
        """What was seen at the end of the last control period."""
        self._check()
        found: dict[str, Any] = flat(self._seen)
        if self._picture:
            found[self._picture] = self._env.render()
        return found

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Act for a control period; returns the action within [-1, 1]."""
        self._check()
        if self._over:
            self.reset()
        names = action_names(self._env)
        missing = [name for name in names if name not in action]
        if missing:
            raise ValueError(f"an action needs {', '.join(names)}; {missing[0]} is missing")
        wanted = np.clip([float(action[name]) for name in names], -1, 1).astype(np.float32)
        self._seen, _, terminated, truncated, info = self._env.step(wanted)
        self._over = terminated or truncated
        if "failure" in info:
            raise RuntimeError(f"{self} has stopped: {info['failure']}")
        return dict(zip(names, wanted.tolist(), strict=True))

    def disconnect(self) -> None:
        """Bring a real robot to rest, and free everything."""
        self._seen = None
        self._env.close()

    def _check(self) -> None:
        if not self.is_connected:
            raise RuntimeError(f"{self} is not connected")
