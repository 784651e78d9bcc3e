"""What becomes of runs as users make them: one judge for the studies that know the true motion."""

import warnings
from collections.abc import Callable
from enum import StrEnum
from typing import TypeVar

from softrobot_env.scene.timestep import TimestepWarning

#: Share of the length beyond which a run is wrong.
WRONG_SHARE = 0.05

Result = TypeVar("Result")


class Verdict(StrEnum):
    """What becomes of a run.

    Accurate: within the accuracy asked for. Reported: refused or failed, and said so. Warned: less
    accurate, with a `TimestepWarning`. Inaccurate: less accurate without a word, but within
    `WRONG_SHARE` of the length. Wrong: farther off without a word. Unjudged: refined runs do not
    agree, or cost too much.
    """

    ACCURATE = "accurate"
    REPORTED = "reported"
    WARNED = "warned"
    INACCURATE = "inaccurate"
    WRONG = "wrong"
    UNJUDGED = "unjudged"


def verdict_of(
    error: float | None,
    asked: float,
    length: float,
    *,
    failure: str | None,
    warning: str | None,
) -> Verdict:
    """What becomes of a run.

    Args:
        error: [m], largest distance from the truth; None if there is none that is known well.
        asked: [m], the accuracy asked for.
        length: [m] of the robot.
        failure: Why the run failed or was refused, or None.
        warning: What a `TimestepWarning` said, or None.
    """
    if failure is not None:
        return Verdict.REPORTED
    if error is None:
        return Verdict.UNJUDGED
    if error <= asked:
        return Verdict.ACCURATE
    if warning is not None:
        return Verdict.WARNED
    # Not: beyond it, as a tip that is not a number is wrong too.
    return Verdict.INACCURATE if error <= WRONG_SHARE * length else Verdict.WRONG


def with_warning(run: Callable[[], Result]) -> tuple[Result, str | None]:
    """What a function returns, and what the first `TimestepWarning` in it said, or None."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", TimestepWarning)
        result = run()
    said = [str(w.message) for w in caught if issubclass(w.category, TimestepWarning)]
    return result, said[0] if said else None
