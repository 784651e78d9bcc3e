"""What trainings need of a robot: random tasks in its workspace, those that networks are judged on,
and how its networks see it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from numpy.random import Generator

from softrobot_env.control.learned.neural import View, view_of
from softrobot_env.control.registry import find_policy, make_policy, policy_environment
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.registry import load
from softrobot_env.core.vector_reading import Reading
from softrobot_env.envs.observations.table import REFERENCE_SPEED
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.identification.excitation import resting_task
from softrobot_env.robots import RobotParams, default_robot, entry_of
from softrobot_env.robots.artifacts import artifact_name
from softrobot_env.tasks import Task, make_task
from softrobot_env.tasks.generic import generic_tasks, site_of

from .rl_config import ROBOT_TASKS, RLConfig, of_any_robot

#: Share of set points among the tasks, and how long they are held, in periods of the first mode;
#: sizes of random paths over the default, and laps in a period of the first mode. A random path
#: gets as far as its size at one point only; the largest ones are often that far out.
_REACHES, _HOLDS = 0.25, (1.0, 4.0)
_RADII, _PACES = (0.4, 0.7, 1.0, 1.4), (0.05, 0.5)

#: Share of circles among the paths: random ones are seldom far out for long.
_CIRCLES = 0.3

#: Largest speed of such a path, over that which environments take.
_SPEED = 0.99

#: Laps of the circle in a period of the first mode on which networks are judged.
_CHECKED = (0.1, 0.3)

#: Of the tasks of reinforcement learning: laps in a period of the first mode, and such periods at a
#: set point.
_LEARNED_PACES, _LEARNED_HOLD = (0.1, 0.2, 0.4), 4.0


def make_teacher(setup: "ImitationSetup") -> Policy:
    """The policy that is imitated, with a file of its own where there is one."""
    takes = find_policy(setup.teacher, setup.robot).takes("gains")
    own = {} if setup.file is None else {"gains" if takes else "weights": setup.file}
    return make_policy(setup.teacher, setup.robot, setup.period, **own)


@dataclass(frozen=True)
class ImitationSetup:
    """Who learns from whom.

    Attributes:
        robot: That is driven.
        teacher: Name of the policy that is imitated.
        file: What it has learned, where that lies elsewhere than policies look.
        view: Of the network, which decides as often as the teacher: laws with gains change the
            inputs by what suits their own period. Held for longer, the same changes would move
            servos, and integrate errors, too slowly.
        period, preview: [s], of the environment that the teacher needs.
        make: The teacher.
        is_tuned: Whether the settings are the robot's own.
    """

    robot: RobotParams
    teacher: str
    file: Path | None
    view: View
    period: float
    preview: tuple[float, ...]
    make: Callable[["ImitationSetup"], Policy] = make_teacher
    is_tuned: bool = False


class RobotTraining:
    """What trainings need of a robot.

    Attributes:
        robot: The robot.
        tasks: Names of the tasks of reinforcement learning.
    """

    tasks: tuple[str, ...] = ROBOT_TASKS

    def __init__(self, robot: RobotParams) -> None:
        """Of any robot."""
        self.robot = robot

    def sampled_task(self, rng: Generator, duration: float) -> Task:
        """A random task: a random path or a circle at a random size and pace, or set points."""
        robot, seed = self.robot, int(rng.integers(2**31))
        site = site_of(robot)
        if site.ground.radius == 0 or rng.uniform() < _REACHES:
            hold = rng.uniform(*_HOLDS) / site.frequency
            return generic_task("reach", robot, seed=seed, hold=hold)
        name = "circle" if rng.uniform() < _CIRCLES else "random"
        own = {"seed": seed} if name == "random" else {}
        size = float(rng.choice(_RADII))
        own["radius"] = size * _usual_radius(name, robot)
        pace = rng.uniform(*_PACES) / max(size, 1.0)
        task = generic_task(name, robot, frequency=pace, **own)
        most = _SPEED * REFERENCE_SPEED * robot.reach
        if task.trajectory.speed <= most:
            return task
        return generic_task(name, robot, frequency=pace * most / task.trajectory.speed, **own)

    def check_tasks(self) -> list[Task]:
        """The tasks on which networks are judged."""
        if site_of(self.robot).ground.radius == 0:
            return [generic_task("reach", self.robot)]
        paced = [generic_task("circle", self.robot, frequency=pace) for pace in _CHECKED]
        figure = generic_task("figure_eight", self.robot)
        return [*paced, figure, generic_task("random", self.robot, seed=0)]

    def learned_tasks(
        self, name: str, count: int, rng: Generator
    ) -> list[tuple[Task | str, dict[str, float]]]:
        """Tasks of a name to learn on by reinforcement, with options.

        Random paths are by name, so that every episode has one of its own.

        Args:
            name: One of `tasks`.
            count: Of sampled references, where these are tasks.
            rng: Source of what is random.
        """
        if name == "random":
            return [(name, {}), *((name, {"frequency": pace}) for pace in _LEARNED_PACES)]
        options = {"frequency": _LEARNED_PACES[1]}
        if name == "reach":
            hold = _LEARNED_HOLD / site_of(self.robot).frequency
            options = {"hold": hold, "seed": int(rng.integers(2**31))}
        return [(generic_task(name, self.robot, **options), {})]

    def settings(self, config: RLConfig) -> RLConfig:
        """Settings of a reinforcement learning of this robot."""
        return of_any_robot(config, self.robot)

    def view(self, period: float | None = None) -> View:
        """What networks see that decide every `period` [s], see `neural.view_of`.

        Raises:
            ValueError, EquilibriumError: The robot has no tendons, or does not rest.
        """
        env = TrackingEnv(resting_task(self.robot, 1.0), observe="all")
        sizes = {name: box.shape[0] for name, box in env.observation_space.items()}
        return view_of(self.robot, sizes, period)

    def imitation(self, teacher: str | None = None, folder: Path | None = None) -> ImitationSetup:
        """How a network imitates a teacher.

        Args:
            teacher: Name of a policy; the robot's usual teacher unless given.
            folder: Where what it has learned is looked for first.
        """
        teacher = teacher or entry_of(self.robot).teacher
        own = policy_environment(teacher, self.robot)
        view = view_for(self.robot, own.get("control_period"))
        file = None if folder is None else folder / artifact_name(self.robot, teacher)
        if file is not None and not file.is_file():
            file = None
        period, preview = own.get("control_period", view.period), tuple(own.get("preview", ()))
        return ImitationSetup(self.robot, teacher, file, view, period, preview)


def training_of(robot: RobotParams) -> RobotTraining:
    """What trainings need of a robot, its own where its entry names it."""
    return load(entry_of(robot).training)(robot)


@lru_cache(maxsize=16)
def view_for(robot: RobotParams, period: float | None = None) -> View:
    """See `RobotTraining.view`."""
    return training_of(robot).view(period)


def seen_in(
    robot: RobotParams | None, view: View | Reading | None
) -> tuple[RobotParams, View | Reading]:
    """A robot and the view of its networks: the default one, and its own, unless given."""
    robot = robot or default_robot()
    return robot, view_for(robot) if view is None else view


def generic_task(name: str, robot: RobotParams, **options: float) -> Task:
    """A task that any robot can be given, even where the robot has one of its own by this name."""
    return make_task(name, among=generic_tasks(robot), **options)


@lru_cache(maxsize=8)
def _usual_radius(name: str, robot: RobotParams) -> float:
    """Default radius [m] of a path."""
    return float(generic_task(name, robot).option("radius"))
