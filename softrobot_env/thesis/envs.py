"""Tip tracking with the spatial test rig, its servos and its camera."""

from typing import Any, ClassVar

import gymnasium
from numpy import ndarray

from softrobot_env.core.interfaces import Seen
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots import LENGTH_SCALE
from softrobot_env.tasks import Task

from .robots import RIG, RIG_PIECES


# Learning libraries know environments by their direct bases: `gymnasium.Env` is one of them.
class RigEnv(TrackingEnv, gymnasium.Env[Seen, ndarray]):
    """`TrackingEnv` with what the spatial test rig of the thesis has unless asked otherwise.

    Its camera sees x and y of the head's output point. Unless given, the `twin` is
    `robots.EQUIVALENT_RIG`, which stands as the thesis' model of one piece with the parameters of
    `RIG` does.

    Attributes:
        length_scale: [m], pulled in by a full-scale action.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array", "human"], "render_fps": 50}
    usual: ClassVar = {"control_period": 0.02, "pieces": RIG_PIECES}
    length_scale = LENGTH_SCALE

    def __init__(self, task: str | Task = "triangle", **options: Any) -> None:
        """Options as of `TrackingEnv`; the robot of a task by name is the rig unless given."""
        super().__init__(task, **_with_rig(task, options))


class VectorRigEnv(VectorTrackingEnv, gymnasium.vector.VectorEnv[Seen, ndarray, ndarray]):
    """`RigEnv` n times, see `VectorTrackingEnv`."""

    usual: ClassVar = RigEnv.usual
    length_scale = LENGTH_SCALE

    def __init__(self, num_envs: int = 1, task: str | Task = "triangle", **options: Any) -> None:
        """Options as of `RigEnv`, and of `VectorTrackingEnv`."""
        super().__init__(num_envs, task, **_with_rig(task, options))


def _with_rig(task: str | Task, options: dict[str, Any]) -> dict[str, Any]:
    """Options with the rig as the robot of a task by its name, unless another is given."""
    if isinstance(task, str) and options.get("robot") is None:
        return {**options, "robot": RIG}
    return options
