"""Paths of the study of laws, what they ask for, and which laws serve a robot."""

from dataclasses import dataclass, replace
from pathlib import Path

from softrobot_env.benchmarks.laps import RefusedRow, refusal
from softrobot_env.benchmarks.laws.demand import feasible_task
from softrobot_env.benchmarks.records import Record
from softrobot_env.control.registry import fitting_policies
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG, RobotParams, find_robot
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.tasks import Task
from softrobot_env.tasks.generic import site_of
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import TrainingRequest, file_of

#: Generic tasks, and laps per second over the first frequency.
TASKS = ("circle", "figure_eight", "random")
FREQUENCIES = (0.1, 0.3, 0.5)


@dataclass(frozen=True)
class PathRow(Record):
    """A path of a robot.

    Attributes:
        robot, task: Names.
        frequency: Laps per second over the first frequency [1].
        first_frequency: [Hz].
        radius: [m].
        inputs, speed: Largest shares of the drives' limits that a lap asks for [1], see `demand`.
    """

    robot: str
    task: str
    frequency: float
    first_frequency: float
    radius: float
    inputs: float
    speed: float


@dataclass(frozen=True)
class Prepared:
    """What is known of a robot before any episode.

    Attributes:
        tasks: Its tasks.
        policies: Names of those that can drive it.
        rows: Its paths, and what is refused and why.
    """

    tasks: list[Task]
    policies: list[str]
    rows: list[PathRow | RefusedRow]


#: What is trained for robots that no artifacts are shipped of.
TRAINED = ("qs_nn", "lqi", "lq_preview", "mpc", "mpc_preview")


def trained_robot(name: str, folder: Path, seed: int = 0) -> RobotParams:
    """A robot of a file in a folder, with what its policies learn of it beside."""
    robot = find_robot(name)
    if robot in (ARM, RIG):
        return robot
    file = folder / f"{name}.toml"
    write_robot(robot, file)
    robot = read_robot(file)
    for policy in TRAINED:
        order = TrainingRequest(robot, file_of(robot, policy), seed)
        TRAININGS[policy].run(order, lambda description, done, total: None)
    return robot


def prepare(
    name: str, tasks: tuple[str, ...], frequencies: tuple[float, ...], folder: Path
) -> Prepared:
    """Train for a robot, lay out its paths, and ask all policies whether they can drive it."""
    robot, made, rows = trained_robot(name, folder), [], []
    for task in tasks:
        for frequency in frequencies:
            try:
                path, asked = feasible_task(robot, task, frequency)
            except ValueError as error:
                rows.append(refusal(name, "", f"{task}, {frequency:g} f1", str(error)))
                continue
            # The rig's camera, and with it the rig's policies, know x and y alone.
            made.append(replace(path, axes="xy") if robot in (RIG, EQUIVALENT_RIG) else path)
            first, radius = site_of(robot).frequency, path.option("radius")
            rows.append(PathRow(name, task, frequency, first, radius, *asked))
    fits = fitting_policies(robot)
    rows += [refusal(name, policy, "", why) for policy, why in fits.items() if why]
    return Prepared(made, [policy for policy, why in fits.items() if not why], rows)
