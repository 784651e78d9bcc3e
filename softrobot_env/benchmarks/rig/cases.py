"""Episodes of the rig's controllers on the triangle, and their rows."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.benchmarks.jobs import Row
from softrobot_env.control.registry import RIG_POLICIES, make_policy
from softrobot_env.control.rig.identified import IdentifiedParameters
from softrobot_env.envs.rig import RigEnv
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.run import run_episode, warm_up
from softrobot_env.robots.twin import twin_or_ideal

#: Periods [s] of a lap, Tabs. 5.2 and 5.3.
SLOW, FAST = 5.0, 1.0


@dataclass(frozen=True)
class Case:
    """One episode to run.

    Attributes:
        twin: Seed of the twin; None for the rig without errors.
        period: [s] of a lap.
        policy: One of `RIG_POLICIES`.
    """

    twin: int | None
    period: float
    policy: str

    @property
    def label(self) -> str:
        """For the progress bar."""
        return f"{rig_name(self.twin)}, T = {self.period:g} s, {self.policy}"


def rig_name(twin: int | None) -> str:
    """Name of a rig for people."""
    return "without errors" if twin is None else f"twin {twin}"


def run_case(case: Case, learnt: IdentifiedParameters, traced: bool) -> Row:
    """Run an episode; see `rig.run` for the row.

    Args:
        case: The episode.
        learnt: What is known of this rig.
        traced: Whether the row has a trace for the figures.
    """
    env = RigEnv("triangle", period=case.period, twin=twin_or_ideal(case.twin), observe="all")
    known = {"learnt": learnt} if RIG_POLICIES[case.policy].takes("learnt") else {}
    policy = make_policy(case.policy, env.task.robot, env.control_period, **known)
    warm_up(env, policy)
    rollout = run_episode(env, policy, seed=0)
    after = rollout.time > env.task.trajectory.approach
    row = {"twin": case.twin, "period": case.period, "policy": case.policy}
    row |= _errors(rollout, after) | _times(rollout)
    return row | {"trace": _trace(rollout, after, env.length_scale)} if traced else row


def _errors(rollout: Rollout, after: np.ndarray) -> Row:
    """Errors after the approach; None where the episode failed."""
    row = {"e_mean": None, "e_max": None, "failure": rollout.failure}
    row["limited"] = float(np.mean(rollout.policy_status != ""))
    if rollout.failure is not None:
        return row
    error = rollout.error[after]
    return row | {"e_mean": float(error.mean()), "e_max": float(error.max())}


def _times(rollout: Rollout) -> Row:
    times, duration = rollout.policy_time, float(rollout.time[-1])
    return {
        "policy_time_median": float(np.median(times)),
        "policy_time_p99": float(np.percentile(times, 99)),
        "policy_time_max": float(times.max()),
        "computing_factor": duration / float(times.sum()),
        "realtime_factor": duration / rollout.wall_time,
    }


def _trace(rollout: Rollout, after: np.ndarray, scale: float) -> dict[str, np.ndarray]:
    """Time from the end of the approach on [s], reference and tip (k, 2) [m], lengths (k, 3)."""
    return {
        "time": rollout.time[after] - rollout.time[after][0],
        "reference": rollout.reference[after, :2],
        "tip": rollout.tip[after, :2],
        "error": rollout.error[after],
        "lengths": scale * rollout.action[after],
    }
