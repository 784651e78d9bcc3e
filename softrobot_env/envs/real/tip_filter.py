"""What measurements of the tip say: its motion and its error, and whether it has settled."""

from collections.abc import Callable
from math import dist, hypot, inf
from time import monotonic, sleep

import numpy as np
from gymnasium import spaces

from softrobot_env.hardware.errors import LinkError, RobotError
from softrobot_env.hardware.tip import TipMeasurement

#: The tip stands still where it moves by less than this [m] in this time [s].
STILL, STILL_TIME = 1.5e-3, 0.4

_LONGEST_REST = 10.0  # s, that a rig may swing
_FIRST_SIGHT = 2.0  # s
_POLL = 0.005  # s


class StaleError(RobotError):
    """Measurements are too old, or out of reach."""


class NotStillError(RobotError):
    """The tip does not come to rest."""


class TipFilter:
    """Position and velocity of the tip, from its measurements as control instants find them.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s], by difference to what the last instant with another picture found.
        time: [s], when the newest was taken.
    """

    def __init__(self, first: TipMeasurement, reach: spaces.Box, speed: float = inf) -> None:
        """Begin with a tip at rest.

        Args:
            first: The first measurement.
            reach: Positions (2,) [m] that the tip can have.
            speed: [m/s] that it can have.

        Raises:
            StaleError: The tip is out of reach.
        """
        self._reach, self._speed = reach, speed
        self._check(first)
        self.position, self.time = first.position, first.time
        self.velocity = np.zeros(2)

    def add(self, sight: TipMeasurement) -> None:
        """The newest measurement at the next instant; the same one again changes nothing.

        Raises:
            StaleError: The tip is out of reach, or too fast.
        """
        self._check(sight)
        passed = sight.time - self.time
        if passed > 0:
            velocity = (sight.position - self.position) / passed
            fast = hypot(*velocity)
            if not fast <= self._speed:
                raise StaleError(
                    f"the tip source says that the tip moves at {fast:.3g} m/s, allowed are "
                    f"{self._speed:.3g} m/s"
                )
            self.velocity = velocity
            self.position, self.time = sight.position, sight.time

    def _check(self, sight: TipMeasurement) -> None:
        if not self._reach.contains(sight.position):
            x, y = 1e3 * sight.position
            raise StaleError(f"the tip source says ({x:.0f}, {y:.0f}) mm, which is out of reach")


def reference_at(points: np.ndarray, step: float) -> np.ndarray:
    """Reference (2,) [m] at a fractional step, from its points (n + 1, 2) [m] at whole ones."""
    steps = np.arange(len(points))
    return np.array([np.interp(step, steps, column) for column in points.T])


def wait_for_rest(look: Callable[[], TipMeasurement | None], source: str) -> None:
    """Wait until the tip stands still.

    Args:
        look: The newest measurement of the tip, None before the first.
        source: What the robot file says of the tip source.

    Raises:
        LinkError: No measurement comes.
        NotStillError: The tip goes on moving.
    """
    begin = monotonic()
    since, place = begin, _first_sight(look, source).position
    while monotonic() - since < STILL_TIME:
        if monotonic() - begin > _LONGEST_REST:
            raise NotStillError(
                f"the tip still moves {_LONGEST_REST:g} s after a stop: more than "
                f"{1e3 * STILL:g} mm in {STILL_TIME:g} s"
            )
        sleep(_POLL)
        sight = look()
        if sight is not None and dist(sight.position, place) > STILL:
            since, place = monotonic(), sight.position


def _first_sight(look: Callable[[], TipMeasurement | None], source: str) -> TipMeasurement:
    end = monotonic() + _FIRST_SIGHT
    while monotonic() < end:
        sight = look()
        if sight is not None and monotonic() - sight.time < STILL_TIME:
            return sight
        sleep(_POLL)
    raise LinkError(
        f"no measurement of the tip in {_FIRST_SIGHT:g} s; the robot file's source is {source}"
    )
