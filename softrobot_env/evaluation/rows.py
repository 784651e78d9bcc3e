"""Typed rows of episodes, as reports have them."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """What every report says of an episode; after a failure all metrics of the motion are None.

    Attributes:
        task, policy, robot, plant, source: Names.
        step_width: [m] of a step, None for other tasks.
        variation: What differed from the nominal robot.
        e_mean, e_max, e_rms, e_final: [m], see `TrackingMetrics`.
        rise_time, settling_time, overshoot, steady_state_error: See `StepMetrics`; None where the
            task is no step.
        policy_time_median, policy_time_p99: [s] per decision.
        realtime_factor: Duration of the motion over that of the whole simulation [1].
        remarks: Share of the decisions with each status that was not to do what was wanted.
        failure: What went wrong, or None.
    """

    task: str
    step_width: float | None
    policy: str
    robot: str
    plant: str
    source: str
    variation: dict[str, float]
    e_mean: float | None
    e_max: float | None
    e_rms: float | None
    e_final: float | None
    rise_time: float | None
    settling_time: float | None
    overshoot: float | None
    steady_state_error: float | None
    policy_time_median: float
    policy_time_p99: float
    realtime_factor: float
    remarks: dict[str, float]
    failure: str | None


@dataclass(frozen=True, kw_only=True)
class EvaluatedRow(EpisodeRow):
    """A row of `softrobot evaluate`.

    Attributes:
        options: Columns of the task's options, see `labels.option_columns`.
        twin: Seed of the rig's twin; None for other rigs and robots.
        e_mean_tracking, e_max_tracking: [m], see `ApproachedMetrics`.
        feedback: What the policy measured; None where it measures nothing.
        learnt: The rig of which the policy's identified parameters are, for people, or None.
    """

    options: dict[str, float | None]
    twin: int | None
    e_mean_tracking: float | None
    e_max_tracking: float | None
    feedback: str | None
    learnt: str | None

    def columns(self) -> dict[str, Any]:
        """What report.json has: a column for each option as well."""
        flat = {}
        for name, value in vars(self).items():
            flat |= value if name == "options" else {name: value}
        return flat
