"""Twins of the rig that nobody told: identified from a recording, then driven.

Each is recorded as `identification.parameters.record` tells it, slowly, and is identified from what
its camera saw. Then the same law drives it three times round the triangle: by
the robot that was found, by the twin itself, and by the rig as everybody believes it to be. Zeros
of the servos are corrected by what each of them knows.
"""

from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.records import Record
from softrobot_env.control.registry import find_policy, make_policy
from softrobot_env.core.jobs import Job
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.runner import Case
from softrobot_env.evaluation.runner import run as run_case
from softrobot_env.identification.parameters import identified, record
from softrobot_env.robots import RIG, RobotParams
from softrobot_env.robots.actuation import with_balance
from softrobot_env.robots.twin import Twin, rig3d_twin
from softrobot_env.tasks import make_task

#: Seeds of the twins.
TWINS = (1, 2, 3, 4, 5)

#: Laws that need nothing but a robot, and periods [s] of a lap.
POLICIES, PERIODS = ("chain_dynamics_pi", "inverse_dynamics"), (5.0, 1.0)


@dataclass(frozen=True)
class TwinRow(Record):
    """Laps of a twin.

    Attributes:
        kind: "twin".
        twin: Its seed.
        policy: The law.
        period: [s] of a lap.
        found, true, believed: [m], mean error by the robot that was identified, by the twin
            itself, and by the rig as its parameters say; None after a failure.
        ratio: Found over true.
        time: [s] that the identification took.
    """

    kind: str
    twin: int
    policy: str
    period: float
    found: float | None
    true: float | None
    believed: float | None
    ratio: float | None
    time: float


def twin_jobs() -> list[Job]:
    """A job for each twin, which makes its rows."""
    return [(f"twin {seed}", partial(driven, seed)) for seed in TWINS]


def driven(seed: int) -> list[TwinRow]:
    """Rows of a twin."""
    twin, began = rig3d_twin(seed), perf_counter()
    found = identified(record(twin, seed))
    taken = perf_counter() - began
    zeros = found.header.commands.zeros or (0.0,) * len(RIG.tendons)
    known = _known(twin)
    pulled = [
        (t.pretension - k.pretension) / t.stiffness
        for t, k in zip(twin.robot.tendons, known.tendons, strict=True)
    ]
    offsets = np.array(twin.servo_offset)
    rigs = (
        (replace(found.robot, file=None), offsets - zeros),
        (known, np.array(pulled)),
        (RIG, offsets),
    )
    rows = []
    for policy in POLICIES:
        for period in PERIODS:
            errors = [_error(policy, period, robot, twin, left) for robot, left in rigs]
            ratio = None if None in errors[:2] else errors[0] / errors[1]
            rows.append(TwinRow("twin", seed, policy, period, *errors, ratio, taken))
    return rows


def _known(twin: Twin) -> RobotParams:
    """The twin's robot as an identification would write it, without any error."""
    drive = replace(RIG.drive, backlash=float(np.mean(twin.backlash)))
    return with_balance(replace(twin.robot, pieces=6, drive=drive))


def _error(
    policy: str, period: float, robot: RobotParams, twin: Twin, offsets: np.ndarray
) -> float | None:
    """Mean error [m] of laps of a twin with servo offsets (3,) [m], by a law for a robot."""
    built = replace(twin, servo_offset=tuple(offsets.tolist()))
    case = Case(make_task("triangle", period=period), policy, scene={"twin": built})
    env = case.environment()
    told = find_policy(policy).told(twin.camera_delay)
    law = make_policy(policy, robot, env.control_period, **told)
    rollout = run_case(case, env, law).rollout
    env.close()
    if rollout.failure is not None:
        return None
    return approached_metrics(rollout, case.task.trajectory).e_mean_tracking
