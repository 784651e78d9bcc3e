"""What networks of a robot see: the sizes of what its environments show."""

from functools import lru_cache

from softrobot_env.control.learned.neural import View, arm_view, view_of
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.tasks import Task
from softrobot_env.tasks.rig_trajectories import SetPoints


@lru_cache(maxsize=16)
def view_for(robot: RobotParams, period: float | None = None) -> View:
    """The view of a robot whose network decides every `period` [s], see `neural.view_of`.

    Raises:
        ValueError, EquilibriumError: It has no tendons, or does not rest.
    """
    if robot == ARM and period is None:
        return arm_view()
    env = TrackingEnv(_at_rest(robot), observe="all")
    sizes = {name: box.shape[0] for name, box in env.observation_space.items()}
    return view_of(robot, sizes, period)


def _at_rest(robot: RobotParams) -> Task:
    """A task with the coordinates of those that any robot can be given."""
    axes, start = "xz" if robot.moves_in_xz else "xyz", robot_inputs(robot).input_centre
    place = (0.0, 0.0, 0.0) if robot.base is None else robot.base.position
    return Task("rest", robot, SetPoints((place,), 1.0), 1.0, tuple(start), axes=axes)
