"""What measurements of the tip say about its motion and its error."""

from math import dist

import numpy as np
from gymnasium import spaces

from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.tip import Sight


class StaleError(RobotError):
    """Measurements are too old, or out of reach."""


class Sights:
    """Measurements of the tip as control instants find them.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s], by difference to what the last instant with another picture found.
        time: [s], when the newest was taken.
    """

    def __init__(self, first: Sight, reach: spaces.Box) -> None:
        """Begin with a tip at rest.

        Args:
            first: The first measurement.
            reach: Positions (2,) [m] that the tip can have.

        Raises:
            StaleError: The tip is out of reach.
        """
        self._reach = reach
        self._check(first)
        self.position, self.time = first.position, first.time
        self.velocity = np.zeros(2)

    def add(self, sight: Sight) -> None:
        """The newest measurement at the next instant; the same one again changes nothing.

        Raises:
            StaleError: The tip is out of reach.
        """
        self._check(sight)
        passed = sight.time - self.time
        if passed > 0:
            self.velocity = (sight.position - self.position) / passed
            self.position, self.time = sight.position, sight.time

    def error(self, points: np.ndarray, step: float) -> float:
        """Distance [m] to a reference, see `reference_at`."""
        return dist(self.position, reference_at(points, step))

    def _check(self, sight: Sight) -> None:
        if not self._reach.contains(sight.position):
            x, y = 1e3 * sight.position
            raise StaleError(f"the tip source says ({x:.0f}, {y:.0f}) mm, which is out of reach")


def reference_at(points: np.ndarray, step: float) -> np.ndarray:
    """Reference (2,) [m] at a fractional step, from its points (n + 1, 2) [m] at whole ones."""
    steps = np.arange(len(points))
    return np.array([np.interp(step, steps, column) for column in points.T])


def check_ages(ages: dict[str, float], oldest: float) -> None:
    """Refuse measurements older than allowed.

    Args:
        ages: Age [s] of the last measurement, by whose it is.
        oldest: [s].

    Raises:
        StaleError: One is older; names it.
    """
    for whose, age in ages.items():
        if age > oldest:
            raise StaleError(
                f"the last measurement of {whose} is {1e3 * age:.0f} ms old, allowed are "
                f"{1e3 * oldest:.0f} ms"
            )
