"""Tracking metrics of thesis secs. 5.4 and 6.6, step metrics of sec. 6.6."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.tasks.trajectories import Trajectory

from .rollout import Rollout

#: Final part of a step response, whose mean is the steady-state value.
_STEADY_WINDOW = 0.1

#: Half width of the settling band, relative to the step.
_BAND = 0.02


@dataclass(frozen=True)
class TrackingMetrics:
    """Error of the tip (6.34) over an episode, all in [m]."""

    e_mean: float
    e_max: float
    e_rms: float
    e_final: float


@dataclass(frozen=True)
class StepMetrics:
    """Characteristic quantities of a step response (Tabs. 6.2 to 6.4).

    Attributes:
        rise_time: [s] from 10 % to 90 % of the way to the steady-state value.
        settling_time: [s] after which the response stays within 2 % of the steady-state value; None
            if it does not within the record.
        overshoot: [1], largest excursion beyond the steady-state value, over the distance to it.
        steady_state_error: [1], difference of steady-state value and target, over the step width.
    """

    rise_time: float | None
    settling_time: float | None
    overshoot: float | None
    steady_state_error: float


def tracking_metrics(rollout: Rollout) -> TrackingMetrics:
    """Mean, maximum, root mean square and last value of the tip error."""
    error = rollout.error
    return TrackingMetrics(
        e_mean=float(error.mean()),
        e_max=float(error.max()),
        e_rms=float(np.sqrt(np.mean(error**2))),
        e_final=float(error[-1]),
    )


@dataclass(frozen=True)
class ApproachedMetrics:
    """Error of the tip after the approach to the path, in [m], as in Tabs. 5.2 and 5.3.

    None if the trajectory has no approach, the record ends with it, or the episode failed.
    """

    e_mean_tracking: float | None
    e_max_tracking: float | None


def approached_metrics(rollout: Rollout, trajectory: Trajectory) -> ApproachedMetrics:
    """Mean and maximum of the tip error after the `approach` [s] of a trajectory."""
    error = rollout.error[rollout.time > getattr(trajectory, "approach", np.inf)]
    if rollout.failure is not None or len(error) == 0:
        return ApproachedMetrics(None, None)
    return ApproachedMetrics(float(error.mean()), float(error.max()))


def step_metrics(time: ndarray, tip: ndarray, target: ndarray) -> StepMetrics:
    """Metrics of the tip's projection onto the direction of the step.

    Args:
        time: (T,) [s], the step happens at time 0.
        tip: (T, 3) [m], the first row is where the step starts.
        target: (3,) [m].
    """
    way = target - tip[0]
    response = (tip - tip[0]) @ way / (way @ way)
    window = max(1, round(_STEADY_WINDOW * len(response)))
    steady = float(response[-window:].mean())
    error = abs(1 - steady)
    if steady <= _BAND:  # it never left the start: rise and overshoot are undefined
        return StepMetrics(None, None, None, error)
    relative = response / steady
    begin, end = (_first_crossing(time, relative, level) for level in (0.1, 0.9))
    return StepMetrics(
        rise_time=None if begin is None or end is None else end - begin,
        settling_time=_settling_time(time, relative, window),
        overshoot=max(0.0, float(relative.max()) - 1),
        steady_state_error=error,
    )


def _first_crossing(time: ndarray, response: ndarray, level: float) -> float | None:
    """Time at which the response first reaches a level, interpolated between samples."""
    above = np.flatnonzero(response >= level)
    if len(above) == 0:
        return None
    i = above[0]
    if i == 0:
        return float(time[0])
    share = (level - response[i - 1]) / (response[i] - response[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))


def _settling_time(time: ndarray, relative: ndarray, window: int) -> float | None:
    outside = np.flatnonzero(np.abs(relative - 1) > _BAND)
    if len(outside) == 0:
        return 0.0
    last = outside[-1]
    if last >= len(time) - window:  # still outside the band where the steady value is computed
        return None
    gap = np.abs(relative[last : last + 2] - 1)
    share = (gap[0] - _BAND) / (gap[0] - gap[1])
    return float(time[last] + share * (time[last + 1] - time[last]))
