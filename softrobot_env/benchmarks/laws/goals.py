"""Goals of the study of laws: what the best law of each robot reaches."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf

from softrobot_env.benchmarks.laps import HOLD, OBSERVER, LapsRow
from softrobot_env.benchmarks.records import Record, groups, select

#: Frequency over the first one -> largest mean error over the length [1], on the worst path.
LIMITS = {0.1: 0.003, 0.3: 0.01, 0.5: 0.02}

#: What differs from the nominal robot -> so many times these limits are allowed.
ROOM = {"": 1.0, "E x 0.75": 2.0, "E x 1.25": 2.0, OBSERVER: 1.5}


@dataclass(frozen=True)
class GoalRow(Record):
    """A goal, and what the best law of a robot reached.

    Attributes:
        robot, policy: Names.
        what: One of `ROOM`.
        frequency: As of `LapsRow`.
        share: Mean error over the length on the worst path [1]; None if an episode failed or was
            refused.
        ratio: The same over that of the nominal robot [1]; None where there is none.
        limit: The largest share allowed.
        met: Whether it was met.
    """

    robot: str
    policy: str
    what: str
    frequency: float
    share: float | None
    ratio: float | None
    limit: float
    met: bool


def ranked_laws(rows: Iterable[LapsRow]) -> dict[str, list[str]]:
    """Robot -> its laws, first that which is farthest below the limits where it is least so.

    Laws that failed somewhere, or were not run in all that others were, come later.
    """
    known = [row for row in rows if row.what in ROOM and row.policy != HOLD]
    found: dict[str, list[str]] = {}
    for (robot,), mine in groups(known, "robot").items():
        laws = groups(mine, "policy")
        most = max(map(len, laws.values()))
        order = sorted(laws, key=lambda law: (most - len(laws[law]), _worst(laws[law])))
        found[robot] = [law for (law,) in order]
    return found


def _worst(rows: list[LapsRow]) -> tuple[int, float]:
    """Number of failures, and largest error over its limit."""
    shares = [
        row.share_mean / (ROOM[row.what] * LIMITS[row.frequency])
        for row in rows
        if row.failure is None
    ]
    return len(rows) - len(shares), max(shares, default=inf)


def goal_rows(rows: list[LapsRow]) -> Iterator[GoalRow]:
    """Goals of the best laws, for all that was run."""
    for robot, (law, *_) in ranked_laws(rows).items():
        mine = select(rows, robot=robot, policy=law)
        for (frequency,), nominal in groups(select(mine, what=""), "frequency").items():
            for what, room in ROOM.items():
                found = select(mine, what=what, frequency=frequency)
                pair = [_share(group, len(nominal)) for group in (found, nominal)]
                ratio = None if None in pair else pair[0] / pair[1]
                share, limit = pair[0], room * LIMITS[frequency]
                met = share is not None and share <= limit
                yield GoalRow(robot, law, what, frequency, share, ratio, limit, met)


def _share(rows: list[LapsRow], wanted: int) -> float | None:
    """The largest; None unless there are as many as wanted."""
    shares = [row.share_mean for row in rows if row.share_mean is not None]
    return max(shares) if len(shares) == wanted else None
