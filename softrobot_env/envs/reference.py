"""The reference of a task, sampled at an environment's control instants."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams
from softrobot_env.tasks import Task

from .observations.table import REFERENCE_ACCELERATION, REFERENCE_SPEED

#: Index of x and z, the coordinates of a planar robot; of x and y, where the height of a spatial
#: one follows; and of all three.
PLANE, TOP, SPACE = slice(0, 3, 2), slice(0, 2), slice(0, 3)

#: The same by the axes of a task.
AXES = {"xz": PLANE, "xy": TOP, "xyz": SPACE}

#: Share of the reach by which a smooth path through solved points may exceed the straight robot.
_ROUNDING = 1e-6


def own_axes(robot: RobotParams) -> slice:
    """The coordinates of a robot's tip: x and z for a planar one, else all three."""
    return PLANE if robot.moves_in_xz else SPACE


@dataclass(frozen=True)
class ReferenceTable:
    """Reference of an episode with n steps.

    Attributes:
        points: The d coordinates [m] that the task names, at the n + 1 control instants, as plain
            numbers.
        position: (n + 1, d) [m], the same.
        velocity, acceleration: (n + 1, d) [m/s, m/s2], a lead later.
        preview: (n + 1, d k) [m], positions after each of the k preview times.
    """

    points: list[list[float]]
    position: ndarray
    velocity: ndarray
    acceleration: ndarray
    preview: ndarray

    @property
    def last_index(self) -> int:
        """Index of the last control instant."""
        return len(self.points) - 1

    def rows(self) -> dict[str, ndarray]:
        """Copies of the columns by name, whose rows an episode may pass on."""
        names = ("position", "velocity", "acceleration", "preview")
        return {name: getattr(self, name).copy() for name in names}


def instants(duration: float, control_period: float) -> int:
    """Number of control periods that cover a duration [s], at least one."""
    return max(1, ceil(duration / control_period - 1e-9))


def sample_reference(
    task: Task, control_period: float, preview: ndarray, lead: float = 0.0
) -> ReferenceTable:
    """Sample a task's reference at its control instants, and `preview` (k,) [s] after them.

    Its velocity and acceleration are sampled a time `lead` [s] later.

    Raises:
        ValueError: The reference is not finite, leaves the robot's reach, or is faster than
            `REFERENCE_SPEED` or `REFERENCE_ACCELERATION`.
    """
    axes, length = AXES[task.axes], task.robot.reach
    steps = instants(task.duration, control_period)
    now = np.arange(steps + 1) * control_period
    # Rounding merges equal times, and moves those at a kink behind it.
    times = np.round(np.add.outer(now, np.concatenate(([0.0], preview))), 9)
    unique, where = np.unique(times, return_inverse=True)
    points = task.trajectory.position(unique)[:, axes]
    position = points[where].reshape(steps + 1, -1)
    base = np.zeros(3) if task.robot.base is None else np.array(task.robot.base.position)
    then = np.round(now + lead, 9)
    velocity = task.trajectory.velocity(then)[:, axes]
    acceleration = task.trajectory.acceleration(then)[:, axes]
    fastest = REFERENCE_SPEED * length
    away = np.abs(points - base[axes]).max()
    if not (away <= length * (1 + _ROUNDING) and np.abs(velocity).max() <= fastest):
        raise ValueError(
            f"the reference of task {task.name!r} must be finite, stay within {length} m of the "
            f"base in {' and '.join(task.axes)}, and below {fastest} m/s"
        )
    sharpest = REFERENCE_ACCELERATION * length
    if not np.abs(acceleration).max() <= sharpest:
        raise ValueError(
            f"the acceleration of task {task.label!r} must be finite and below {sharpest} m/s2"
        )
    here, ahead = np.split(position, [len(task.axes)], axis=1)
    return ReferenceTable(here.tolist(), here, velocity, acceleration, ahead)
