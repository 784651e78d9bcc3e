"""The circle of sec. 6.1 with disturbances, laps of a second, and the largest stable gains."""

from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from softrobot_env.benchmarks.feedback.gains import GainRow, gain_rows
from softrobot_env.benchmarks.feedback.rigs import DISTURBANCES, disturbed
from softrobot_env.benchmarks.feedback.sensed import rig_with_sensor, sensed
from softrobot_env.benchmarks.records import Record, for_pictures
from softrobot_env.core.jobs import Job, Progress, run_in_processes
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Case
from softrobot_env.evaluation.runner import run as run_episode
from softrobot_env.tasks import Task, make_task
from softrobot_env.tasks.rig_trajectories import LapCircle

#: Policies of sec. 6.1, and ours.
THESIS, OURS = ("rig_nn", "rig_nn_p", "rig_nn_pi"), ("hybrid_calibrated", "hybrid_feedback")

#: Names of the paths.
SLOW, FAST = "a lap at 50 mm/s", "laps of 1 s"

#: What sees the tip.
CAMERA, SENSOR = "camera", "curvature sensor"

#: Policies that feed the tip back.
_FED_BACK = ("rig_nn_pi", "hybrid_feedback")

#: Seeds of the twins; networks and parameters that policies know are those of the first. How fast
#: feedback learns was chosen without the others.
TWINS, SHOWN = (0, 4, 5), 0

#: The thesis' RMS errors [m] by policy, of the first offset and of its weight.
PRINTED = {
    ("rig_nn", "offset 2 mm"): 31.3e-3,
    ("rig_nn_p", "offset 2 mm"): 26.9e-3,
    ("rig_nn_pi", "offset 2 mm"): 3.1e-3,
    ("rig_nn", "weight 26 g"): 39.2e-3,
    ("rig_nn_p", "weight 26 g"): 30.6e-3,
    ("rig_nn_pi", "weight 26 g"): 7.9e-3,
}

_SAMPLE = 0.02  # s, of a trace

#: Laps of a second: [m], laps, and [s] to speed up and to slow down.
_FAST = {"radius": 0.12, "speed": 2 * np.pi * 0.12, "laps": 6, "ramp": 2.0}


@dataclass(frozen=True)
class LapRow(Record):
    """A circle.

    Attributes:
        path: `SLOW`, the thesis', or `FAST`.
        seen_by: `CAMERA` or `SENSOR`, what tells the policy of the tip, late.
        policy: Its name.
        twin: Seed of the twin.
        disturbance: One of `rigs.DISTURBANCES`.
        rms, mean, largest: Error [m] of the tip over the lap, or the laps at full speed; None where
            the episode failed.
        last: RMS error [m] of the last lap at full speed, when policies that learn have learned.
        thesis: The RMS error [m] that the thesis prints, or None.
        failure: What went wrong, or None.
        trace: The episode, if a picture shows it.
    """

    path: str
    seen_by: str
    policy: str
    twin: int
    disturbance: str
    rms: float | None
    mean: float | None
    largest: float | None
    last: float | None
    thesis: float | None
    failure: str | None
    trace: Rollout | None = for_pictures()  # noqa: RUF009


Row = LapRow | GainRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Let the policies of sec. 6.1 and ours follow circles on disturbed twins.

    Args:
        quick: One twin and one policy of each kind.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of the circles, and of gains.
    """
    twins = TWINS[:1] if quick else TWINS
    policies = (THESIS[-1], OURS[-1]) if quick else THESIS + OURS
    disturbances = DISTURBANCES[1:2] if quick else DISTURBANCES
    slow = make_task("rig_circle")
    cases = [(SLOW, slow, CAMERA, *case) for case in product(policies, twins, disturbances)]
    cases += [(SLOW, slow, SENSOR, *case) for case in product(_FED_BACK, twins, disturbances)]
    if not quick:
        fast = _laps(slow)
        cases += [(FAST, fast, CAMERA, *case) for case in product(OURS, twins, disturbances)]
        own = product(OURS[-1:], twins, disturbances)
        cases += [(FAST, fast, SENSOR, *case) for case in own]
    jobs = [_job(*case) for case in cases]
    found = run_in_processes([*jobs, ("gains", gain_rows)], progress)
    return [row for rows in found for row in rows]


def _laps(task: Task) -> Task:
    """Laps of a second on the same circle."""
    circle = LapCircle(**_FAST)
    return replace(task, trajectory=circle, duration=circle.end_time)


def _job(path: str, task: Task, seen_by: str, policy: str, twin: int, disturbance: str) -> Job:
    name = f"{path}, {policy}, {seen_by}, twin {twin} {disturbance}".rstrip()
    return name, lambda: [lap_row(path, task, seen_by, policy, twin, disturbance)]


def lap_row(
    path: str, task: Task, seen_by: str, policy: str, twin: int, disturbance: str
) -> LapRow:
    """Run a circle."""
    rollout, run = _rollout(task, seen_by, policy, twin, disturbance), task.trajectory
    begin, end = run.lap_time
    on_lap = (rollout.time >= begin + run.ramp) & (rollout.time <= end - run.ramp)
    error, failed = rollout.error[on_lap], rollout.failure is not None
    lap = 2 * np.pi * run.radius / run.speed
    last = rollout.error[on_lap & (rollout.time >= end - run.ramp - lap)]
    shown = twin == SHOWN and path == SLOW and (seen_by == CAMERA or policy == OURS[-1])
    return LapRow(
        path=path,
        seen_by=seen_by,
        policy=policy,
        twin=twin,
        disturbance=disturbance,
        rms=None if failed else float(np.sqrt(np.mean(error**2))),
        mean=None if failed else float(error.mean()),
        largest=None if failed else float(error.max()),
        last=None if failed else float(np.sqrt(np.mean(last**2))),
        thesis=PRINTED.get((policy, disturbance)) if path == SLOW else None,
        failure=rollout.failure,
        trace=rollout.thinned(_SAMPLE).slim() if shown else None,
    )


def _rollout(task: Task, seen_by: str, policy: str, twin: int, disturbance: str) -> Rollout:
    case = Case(task, policy, scene={"twin": disturbed(twin, disturbance)})
    if seen_by == CAMERA:
        return run_episode(case).rollout
    with closing(rig_with_sensor(task, disturbed(twin, disturbance))) as env:
        return run_episode(case, env, sensed(policy, twin, env.control_period)).rollout
