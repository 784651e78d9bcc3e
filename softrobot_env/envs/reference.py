"""The reference of a task, sampled where an environment needs it."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from softrobot_env.envs.observations.arm import REFERENCE_SPEED
from softrobot_env.tasks import Task
from softrobot_env.tasks.rig import RigTask

#: Index of x and z, the coordinates of a planar robot, and of x and y, those of a spatial one.
PLANE = slice(0, 3, 2)
TOP = slice(0, 2)


@dataclass(frozen=True)
class ReferenceTable:
    """Reference of an episode with n steps.

    Attributes:
        points: (x, z) or (x, y) [m] at the n + 1 control instants, as plain numbers.
        position: (n + 1, 2) [m], the same.
        velocity, acceleration: (n + 1, 2) [m/s, m/s2].
        preview: (n + 1, 2 k) [m], positions after each of the k preview times.
    """

    points: list[list[float]]
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    preview: np.ndarray

    @property
    def last_index(self) -> int:
        """Index of the last control instant."""
        return len(self.points) - 1

    def rows(self) -> dict[str, np.ndarray]:
        """Copies of the tables by observable, whose rows an episode may give away."""
        return {
            "reference": self.position.copy(),
            "reference_velocity": self.velocity.copy(),
            "reference_acceleration": self.acceleration.copy(),
            "reference_preview": self.preview.copy(),
        }


def instants(duration: float, control_period: float) -> int:
    """Control periods that cover a duration [s]: at least one."""
    return max(1, ceil(duration / control_period - 1e-9))


def sample_reference(
    task: Task | RigTask, control_period: float, preview: np.ndarray, axes: slice = PLANE
) -> ReferenceTable:
    """Sample a task's reference at its control instants, and `preview` (k,) [s] after them.

    Args:
        task: The task.
        control_period: [s].
        preview: (k,) [s].
        axes: The two coordinates that are references, `PLANE` or `TOP`.

    Raises:
        ValueError: The reference is not finite, leaves the robot's reach or is faster than
            `REFERENCE_SPEED`.
    """
    steps = instants(task.duration, control_period)
    now = np.arange(steps + 1) * control_period
    # Rounding merges equal times, and puts those at a kink behind it.
    times = np.round(np.add.outer(now, np.concatenate(([0.0], preview))), 9)
    unique, where = np.unique(times, return_inverse=True)
    position = task.trajectory.position(unique)[:, axes][where].reshape(steps + 1, -1)
    velocity = task.trajectory.velocity(times[:, 0])[:, axes]
    acceleration = task.trajectory.acceleration(times[:, 0])[:, axes]
    length = task.robot.reach
    fastest = REFERENCE_SPEED * length
    if not (np.abs(position).max() <= length and np.abs(velocity).max() <= fastest):
        raise ValueError(
            f"the reference of task {task.name!r} must be finite, stay within {length} m of the "
            f"base in {' and '.join('xyz'[axes])}, and below {fastest} m/s"
        )
    here = position[:, :2]
    return ReferenceTable(here.tolist(), here, velocity, acceleration, position[:, 2:])
