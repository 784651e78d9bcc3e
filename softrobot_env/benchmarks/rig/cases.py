"""Episodes of the rig's controllers on the triangle, and their rows."""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.benchmarks.records import Record, for_pictures
from softrobot_env.control.registry import RIG_POLICIES
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.tasks import make_task

#: Periods [s] of a lap, Tabs. 5.2 and 5.3.
SLOW, FAST = 5.0, 1.0


@dataclass(frozen=True)
class LapsRow(Record):
    """Laps of the triangle.

    Attributes:
        twin: Seed of the twin; None for the rig without errors.
        period: [s] of a lap.
        policy: One of `RIG_POLICIES`.
        e_mean, e_max: [m], after the approach; None where the episode failed.
        failure: What went wrong, or None.
        limited: Share of the decisions that could not be the ones wanted [1].
        policy_time_median, policy_time_p99, policy_time_max: [s] per decision.
        computing_factor: Time of the motion over that of computing its inputs [1].
        realtime_factor: The same over that of the whole simulation.
        trace: The episode after its approach, which ends at time zero.
    """

    twin: int | None
    period: float
    policy: str
    e_mean: float | None
    e_max: float | None
    failure: str | None
    limited: float
    policy_time_median: float
    policy_time_p99: float
    policy_time_max: float
    computing_factor: float
    realtime_factor: float
    trace: Rollout | None = for_pictures()  # noqa: RUF009


def cases(twin: int | None) -> list[Case]:
    """All policies at both speeds, on a twin or the rig without errors."""
    return [
        Case(make_task("triangle", period=period), name, twin=twin)
        for period in (SLOW, FAST)
        for name in RIG_POLICIES
    ]


def rig_name(twin: int | None) -> str:
    """Name of a rig for people."""
    return "without errors" if twin is None else f"twin {twin}"


def run_case(case: Case, traced: bool) -> LapsRow:
    """Run an episode; `traced` says whether its row has a trace for the figures."""
    rollout = run(case).rollout
    errors = approached_metrics(rollout, case.task.trajectory)
    times, duration = rollout.policy_time, float(rollout.time[-1])
    return LapsRow(
        twin=case.twin,
        period=case.task.option("period"),
        policy=case.policy,
        e_mean=errors.e_mean_tracking,
        e_max=errors.e_max_tracking,
        failure=rollout.failure,
        limited=float(np.mean(rollout.policy_status != "")),
        policy_time_median=float(np.median(times)),
        policy_time_p99=float(np.percentile(times, 99)),
        policy_time_max=float(times.max()),
        computing_factor=duration / float(times.sum()),
        realtime_factor=duration / rollout.wall_time,
        trace=_laps(rollout, case.task.trajectory.approach) if traced else None,
    )


def _laps(rollout: Rollout, approach: float) -> Rollout:
    """The record after its approach [s], with times from its end on."""
    begin = int(np.searchsorted(rollout.time, approach, "right"))
    laps = rollout.slim("action").part(slice(begin, None))
    return replace(laps, time=laps.time - laps.time[:1])
