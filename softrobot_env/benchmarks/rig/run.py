"""What sec. 5.4 of the thesis reports about its controllers, run anew on twins of the rig."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from softrobot_env.benchmarks.records import of_kind
from softrobot_env.benchmarks.rig import goals
from softrobot_env.benchmarks.rig.cases import LapsRow, cases, rig_name, run_case
from softrobot_env.benchmarks.rig.forces import force_rows
from softrobot_env.control.rig.identified import IdentifiedParameters
from softrobot_env.core.jobs import Job, Progress, run_jobs
from softrobot_env.evaluation.runner import Case
from softrobot_env.identification.parameters import identified, parameters_of, record
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import twin_or_ideal
from studies.thesis import Row as ForceRow

#: Twins of the tables; their medians are judged.
TWINS = (0, 1, 2, 3, 4)

#: The twin of the figures, whose networks come with the package.
SHOWN = 0

_POINTS, _QUICK_POINTS = 61, 16  # of Fig. 5.14


Row = LapsRow | ForceRow | goals.GoalRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Let all policies drive the triangles, on the rig without errors and on twins.

    Each twin is visited first, and its networks are trained with its own seed; the rig without
    errors as well.

    Args:
        quick: Twin 0 alone, with what comes with the package.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of the episodes, of Fig. 5.14, and goals.
    """
    twins = (SHOWN,) if quick else (None, *TWINS)
    jobs = [job for twin in twins for job in _jobs(twin, shipped=quick)]
    jobs.append(("Fig. 5.14", lambda: force_rows(count=_QUICK_POINTS if quick else _POINTS)))
    found = run_jobs(jobs, progress)
    return [*found, *goals.rows(of_kind(found, LapsRow))]


def _jobs(twin: int | None, shipped: bool) -> list[Job]:
    """The visit of a rig, and its episodes."""

    @cache
    def known() -> IdentifiedParameters:
        if shipped:
            return IdentifiedParameters.load(RIG)
        # Another seed for each, so that what differs between twins includes the training.
        return parameters_of(identified(record(twin_or_ideal(twin)), seed=twin or 0), twin)

    def visited() -> list[Row]:
        known()
        return []

    visit_ = (f"visiting the points of the rig {rig_name(twin)}", visited)
    return [visit_, *((case.label, _episode(case, known)) for case in cases(twin))]


def _episode(case: Case, known: Callable[[], IdentifiedParameters]) -> Callable[[], list[Row]]:
    traced = case.twin == SHOWN
    return lambda: [run_case(replace(case, identified=known()), traced)]
