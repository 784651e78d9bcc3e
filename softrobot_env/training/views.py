"""What networks of a robot see: the sizes of what its environments show."""

from functools import lru_cache

from softrobot_env.control.arm.neural import View, arm_view, view_of
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.tasks import make_task


@lru_cache(maxsize=16)
def view_for(robot: RobotParams, period: float | None = None) -> View:
    """The view of a robot whose network decides every `period` [s], see `neural.view_of`.

    Raises:
        ValueError, EquilibriumError: It has no tendons, or does not rest.
    """
    if robot == ARM and period is None:
        return arm_view()
    env = TrackingEnv(make_task("reach", robot=robot), observe="all")
    sizes = {name: box.shape[0] for name, box in env.observation_space.items()}
    return view_of(robot, sizes, period)
