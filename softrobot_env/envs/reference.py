"""The reference of a task, sampled where an environment needs it."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from softrobot_env.envs.observables import REFERENCE_SPEED
from softrobot_env.tasks import Task

#: Index of x and z, the coordinates of a planar robot.
PLANE = slice(0, 3, 2)


@dataclass(frozen=True)
class ReferenceTable:
    """Reference of an episode with n steps.

    Attributes:
        points: (x, z) [m] at the n + 1 control instants, as plain numbers.
        position: (n + 1, 2) [m], the same.
        velocity: (n + 1, 2) [m/s].
        preview: (n + 1, 2 k) [m], positions after each of the k preview times.
    """

    points: list[list[float]]
    position: np.ndarray
    velocity: np.ndarray
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
            "reference_preview": self.preview.copy(),
        }


def sample_reference(task: Task, control_period: float, preview: np.ndarray) -> ReferenceTable:
    """Sample a task's reference at its control instants, and `preview` (k,) [s] after them.

    Raises:
        ValueError: The reference leaves the robot's reach or is faster than `REFERENCE_SPEED`.
    """
    steps = max(1, ceil(task.duration / control_period - 1e-9))
    now = np.arange(steps + 1) * control_period
    # Rounding merges equal times, and puts those at a kink behind it.
    times = np.round(np.add.outer(now, np.concatenate(([0.0], preview))), 9)
    unique, where = np.unique(times, return_inverse=True)
    position = task.trajectory.position(unique)[:, PLANE][where].reshape(steps + 1, -1)
    velocity = task.trajectory.velocity(times[:, 0])[:, PLANE]
    length = task.robot.length
    if np.abs(position).max() > length or np.abs(velocity).max() > REFERENCE_SPEED * length:
        raise ValueError(
            f"the reference of task {task.name!r} must stay within {length} m of the base in x "
            f"and z, and below {REFERENCE_SPEED * length} m/s"
        )
    here = position[:, :2]
    return ReferenceTable(here.tolist(), here, velocity, position[:, 2:])
