"""Tip tracking with the spatial test rig, its servos and its camera."""

from typing import Any, ClassVar

import gymnasium
import numpy as np

from softrobot_env.core.interfaces import Seen
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots import LENGTH_SCALE, RobotParams
from softrobot_env.tasks import Task
from softrobot_env.thesis.robots import RIG, RIG_PIECES


# Learning libraries tell environments by their direct bases: `gymnasium.Env` is one of them.
class RigEnv(TrackingEnv, gymnasium.Env[Seen, np.ndarray]):
    """`TrackingEnv` with what the spatial test rig of the thesis has unless told otherwise.

    Its camera sees x and y of the head's output point. Unless given, the `twin` is
    `robots.EQUIVALENT_RIG`, which stands as the thesis' model of one piece with the parameters of
    `RIG` does.

    Attributes:
        length_scale: [m], pulled in by a full-scale action.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 50}
    length_scale = LENGTH_SCALE

    def __init__(
        self,
        task: str | Task = "triangle",
        *,
        robot: str | RobotParams | None = None,
        control_period: float = 0.02,
        pieces: int | tuple[int, ...] | None = RIG_PIECES,
        **options: Any,
    ) -> None:
        """Build the environment.

        Args:
            task: Task or its name.
            robot: As of `TrackingEnv`, the rig unless given.
            control_period: [s], between 1 ms and 200 ms.
            pieces: Of the MuJoCo chain, a multiple of the robot's.
            **options: As of `TrackingEnv`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            TypeError: An unknown argument.
        """
        options |= {"control_period": control_period, "pieces": pieces}
        super().__init__(task, robot=_rig_unless(robot, task), **options)


class VectorRigEnv(VectorTrackingEnv, gymnasium.vector.VectorEnv[Seen, np.ndarray, np.ndarray]):
    """`RigEnv` n times, see `VectorTrackingEnv`."""

    length_scale = LENGTH_SCALE

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Task = "triangle",
        *,
        robot: str | RobotParams | None = None,
        control_period: float = 0.02,
        pieces: int | tuple[int, ...] | None = RIG_PIECES,
        **options: Any,
    ) -> None:
        """Arguments as of `RigEnv`, and of `VectorTrackingEnv`."""
        options |= {"control_period": control_period, "pieces": pieces}
        super().__init__(num_envs, task, robot=_rig_unless(robot, task), **options)


def _rig_unless(robot: str | RobotParams | None, task: str | Task) -> str | RobotParams | None:
    """The rig for a task by its name, unless another robot is given."""
    return RIG if robot is None and isinstance(task, str) else robot
