"""What sec. 5.4 of the thesis reports about its controllers, run anew on twins of the rig."""

from collections.abc import Callable
from functools import cache

from softrobot_env.benchmarks.jobs import Job, Progress, Row, run_jobs
from softrobot_env.benchmarks.rig import goals as rig_goals
from softrobot_env.benchmarks.rig.cases import FAST, SLOW, Case, rig_name, run_case
from softrobot_env.benchmarks.rig.forces import force_rows
from softrobot_env.control.registry import RIG_POLICIES
from softrobot_env.control.rig.identified import IdentifiedParameters
from softrobot_env.identification.parameters import identify, record
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import twin_or_ideal

#: Twins of the tables; their medians are judged.
TWINS = (0, 1, 2, 3, 4)

#: The twin of the figures, whose networks are shipped.
SHOWN = 0

_POINTS, _QUICK_POINTS = 61, 16  # of Fig. 5.14


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Let all policies drive the triangles, on the rig without errors and on twins.

    Each twin is visited first, and its networks are trained with its own seed; the rig without
    errors as well.

    Args:
        quick: Twin 0 alone, with what is shipped.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows with twin (None: the rig without errors), period [s] of a lap, policy, e_mean and
        e_max [m] after the approach, failure, limited (share of decisions that could not be the
        ones wanted), policy_time_median, policy_time_p99, policy_time_max [s], computing_factor
        (time of the motion over that of computing its inputs), realtime_factor (over that of the
        whole simulation), and of one twin a trace for the figures. Then rows of
        `rig_forces.force_rows`, then goals, see `rig_goals.rows`.
    """
    twins = (SHOWN,) if quick else (None, *TWINS)
    jobs = [job for twin in twins for job in _jobs(twin, shipped=quick)]
    jobs.append(("Fig. 5.14", lambda: force_rows(count=_QUICK_POINTS if quick else _POINTS)))
    found = run_jobs(jobs, progress)
    return [*found, *rig_goals.rows(found)]


def _jobs(twin: int | None, shipped: bool) -> list[Job]:
    """The visit of a rig, and its episodes."""

    @cache
    def learnt() -> IdentifiedParameters:
        if shipped:
            return IdentifiedParameters.load(RIG)
        # Another seed for each, so that what differs between twins includes the training.
        return identify(record(twin_or_ideal(twin)), seed=twin or 0).parameters

    def taught() -> list[Row]:
        learnt()
        return []

    cases = [Case(twin, period, name) for period in (SLOW, FAST) for name in RIG_POLICIES]
    visited = (f"visiting the points of the rig {rig_name(twin)}", taught)
    return [visited, *((case.label, _episode(case, learnt)) for case in cases)]


def _episode(case: Case, learnt: Callable[[], IdentifiedParameters]) -> Callable[[], list[Row]]:
    return lambda: [run_case(case, learnt(), traced=case.twin == SHOWN)]
