"""What measurements of the tip say about its motion and its error."""

import numpy as np

from softrobot_env.hardware.tip import Sight


class Sights:
    """Measurements of the tip as control instants find them.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s], by difference to what the last instant with another picture found.
        time: [s], when the newest was taken.
    """

    def __init__(self, first: Sight) -> None:
        """Begin with a tip at rest."""
        self.position, self.time = first.position, first.time
        self.velocity = np.zeros(2)

    def add(self, sight: Sight) -> None:
        """The newest measurement at the next instant; the same one again changes nothing."""
        passed = sight.time - self.time
        if passed > 0:
            self.velocity = (sight.position - self.position) / passed
            self.position, self.time = sight.position, sight.time


def reference_at(points: np.ndarray, step: float) -> np.ndarray:
    """Reference (2,) [m] at a fractional step, from its points (n + 1, 2) [m] at whole ones."""
    steps = np.arange(len(points))
    return np.array([np.interp(step, steps, column) for column in points.T])
