"""The workspace of a robot: where its tip rests under any of its inputs."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.inverse import InverseStatics, ReachableEllipse
from softrobot_env.scene.registry import model_scene

#: Actions of a sample unless said otherwise.
SAMPLE = 300

#: Largest action [1] in the middle of the ground of a planar robot: room is left to all sides.
_BENT = 0.6


@dataclass(frozen=True, eq=False)
class Workspace:
    """Where a robot's tip rests.

    Attributes:
        inverse: Its inverse statics.
        ground: Where the tip gets everywhere, in the plane of its tasks.
    """

    inverse: InverseStatics
    ground: ReachableEllipse

    @property
    def scene(self) -> Scene:
        """Of the robot."""
        return self.inverse.scene


@dataclass(frozen=True, eq=False)
class Sample:
    """Stable equilibria under inputs that fill the box of actions evenly.

    Attributes:
        inputs: (n, n_inputs) [N or m]; of the action 0 first.
        postures: (n, nq).
        tips: (n, 3) [m].
        left_out: Number of actions without a stable equilibrium, or beyond the drives' travel.
    """

    inputs: np.ndarray
    postures: np.ndarray
    tips: np.ndarray
    left_out: int


@lru_cache(maxsize=32)
def workspace_of(robot: RobotParams) -> Workspace:
    """The workspace of a robot under its own weight, found once in a process.

    Raises:
        ValueError: The robot has no tendons.
        EquilibriumError: It does not stand under the action 0.
    """
    inverse = InverseStatics(build_scene(model_scene(robot)))
    return Workspace(inverse, inverse.ground(_BENT))


@lru_cache(maxsize=8)
def sample_of(robot: RobotParams, count: int = SAMPLE) -> Sample:
    """A sample of a robot's workspace by `count` actions; errors as `workspace_of`."""
    inverse = workspace_of(robot).inverse
    held, left_out = inverse.sample(count)
    return Sample(held.inputs, held.postures, inverse.scene.tip(held.postures), left_out)
