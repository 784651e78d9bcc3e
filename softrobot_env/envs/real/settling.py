"""Waiting until the tip of the real rig stands still."""

from collections.abc import Callable
from math import dist
from time import monotonic, sleep

from softrobot_env.hardware.errors import LinkError, RobotError
from softrobot_env.hardware.tip import Sight

#: The tip stands still where it moves by less than this [m] in this time [s].
STILL, STILL_TIME = 1.5e-3, 0.4

_LONGEST_REST = 10.0  # s, that a rig may swing
_FIRST_SIGHT = 2.0  # s
_POLL = 0.005  # s


class NotStillError(RobotError):
    """The tip does not come to rest."""


def wait_for_rest(look: Callable[[], Sight | None], source: str) -> None:
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


def _first_sight(look: Callable[[], Sight | None], source: str) -> Sight:
    end = monotonic() + _FIRST_SIGHT
    while monotonic() < end:
        sight = look()
        if sight is not None and monotonic() - sight.time < STILL_TIME:
            return sight
        sleep(_POLL)
    raise LinkError(
        f"no measurement of the tip in {_FIRST_SIGHT:g} s; the robot file's source is {source}"
    )
