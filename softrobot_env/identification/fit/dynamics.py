"""Damping, delay and friction of a robot that was recorded in motion, by the MuJoCo chain.

The chain is given the recording's commands from rest, as a replay does; damping of the backbone,
delay of the markers and friction of the tendons are changed until its markers move as the recorded
ones. Errors at rest are the business of the statics: of each window the mean error of each marker
is left out. Friction is of both: where a robot sways before it rests, part of the friction is gone
by then, and the statics find too little.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.identification.fit.least_squares import clustered, correlation_time
from softrobot_env.identification.replay.simulation import mean_known, replay
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

_LONGEST = 12.0  # s that are simulated
_SLOW = 0.2  # of the largest speed; slower motion tells friction at rest, not damping
_WINDOW, _BEFORE = 1.5, 3.0  # s after it begins to move, and at most before
_STEPS = 6
_PROBE = (0.05, 0.004, 0.01, 0.05)  # of log damping, delay [s], log modulus, log friction
_PRIOR = (1.5, 0.05)  # of the first two
_LEAST = 1e-3  # of the modulus
_IN_MOTION = 0.2  # by which friction in motion may differ from what is left of it at rest
_MOST = np.array([1.0, 0.03, 0.2, 0.5])  # of a step
_MODULUS, _FRICTION = 2, 3


@dataclass(frozen=True)
class Dynamics:
    """What was found.

    Attributes:
        robot: With its damping, and with its friction in motion if that was to be found.
        delay: [s] of the markers.
        values: (2,) logarithm of the damping's factor, and delay [s].
        deviation: (2,) standard deviations.
        prior: (2,) those of the prior.
        by_friction: (2,) how values change with the logarithm of the friction, the rest fitted.
        modulus, friction: Logarithms of Young's modulus and of friction in motion over those of
            the statics, and their standard deviations; zeros where there is no friction to find.
        before, after: RMS [m] of the markers' errors in the windows, their means left out.
        duration: [s] of the windows.
    """

    robot: RobotParams
    delay: float
    values: np.ndarray
    deviation: np.ndarray
    prior: np.ndarray
    by_friction: np.ndarray
    modulus: tuple[float, float]
    friction: tuple[float, float]
    before: float
    after: float
    duration: float


def dynamics_of(
    robot: RobotParams,
    recording: Recording,
    modulus: float = 0.0,
    friction: float | None = 0.0,
    begin: np.ndarray | None = None,
    show: Callable[[int, float], None] | None = None,
) -> Dynamics:
    """Find damping, delay and friction.

    Args:
        robot: With its statics identified.
        recording: In motion, in its identified frame.
        modulus: Standard deviation of the logarithm of Young's modulus, as the statics left it. It
            may change with damping and delay, so that these are as uncertain as that makes them,
            but the robot of the result has what it had.
        friction: Likewise of the tendons' friction in common, which is found anew; None where it is
            known, which then stays as it is.
        begin: (2,) logarithm of the damping's factor, and delay [s], where the search begins.
        show: Told each step and its RMS [m].

    Raises:
        ValueError: The robot has no damping to begin with, or the simulation fails everywhere.
    """
    if not all(s.damping_time > 0 for s in robot.backbone.sections):
        raise ValueError(
            f"robot {robot.name!r} has damping_time_s = 0: give a guess to begin with, such as 0.02"
        )
    windows = windows_of(recording)

    def built(values: np.ndarray) -> RobotParams:
        damping, _, modulus, friction = (float(np.exp(x)) for x in values)
        rubbing = tuple(replace(t, friction=t.friction * friction) for t in robot.tendons)
        moved = replace(robot, tendons=rubbing)
        return moved.vary(damping_time=damping, youngs_modulus=modulus)

    def error(values: np.ndarray) -> np.ndarray:
        delay = max(float(values[1]), 0.0)
        markers = tuple(replace(m, delay_s=m.delay_s + delay) for m in windows.header.marker)
        moved = replace(windows, header=replace(windows.header, marker=markers))
        found = replay(moved, built(values)).error
        out = np.full_like(found, np.nan)
        for run in range(int(windows.runs[-1]) + 1):
            rows = windows.runs == run
            if np.isfinite(found[rows]).any():
                out[rows] = found[rows] - mean_known(found[rows])
        if np.isnan(out).all():
            raise ValueError("the identified robot could not be simulated in motion")
        return out

    values = np.zeros(4)
    values[:2] = 0.0 if begin is None else begin
    prior = np.array(
        [
            *_PRIOR,
            max(modulus, _LEAST),
            _LEAST if friction is None else np.hypot(friction, _IN_MOTION),
        ]
    )
    count = len(values)
    here = error(values)
    before = _rms(here)
    damping, normal = 1e-3, np.eye(count)

    def cost(left: np.ndarray, at: np.ndarray, variance: float) -> float:
        return float(np.nansum(left**2) / variance + np.sum((at / prior) ** 2))

    for step in range(_STEPS):
        slopes = np.stack(
            [
                (error(values + np.eye(count)[k] * probe) - here) / probe
                for k, probe in enumerate(_PROBE)
            ],
            axis=-1,
        )
        variance = max(_rms(here) ** 2 / 3, 1e-12) * correlation_time(here, windows.runs)
        known = np.isfinite(here) & np.isfinite(slopes).all(axis=-1)
        a, b = slopes[known], here[known]
        normal = a.T @ a / variance + np.diag(1 / prior**2)
        right = a.T @ b / variance + values / prior**2
        better = False
        for _ in range(5):
            step_by = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right)
            there = values - np.clip(step_by, -_MOST, _MOST)
            there[1] = max(there[1], 0.0)
            trial = error(there)
            if cost(trial, there, variance) < cost(here, values, variance):
                better = True
                break
            damping *= 10
        if not better:
            break
        moved = np.abs(there - values) / prior
        values, here, damping = there, trial, max(damping / 10, 1e-6)
        if show is not None:
            show(step + 1, _rms(here))
        if moved.max() < 2e-3:
            break
    noise = np.linalg.inv(normal)
    covariance = clustered(slopes, here, normal, variance, windows.runs)
    # When within a sample a command begins is not told.
    same = np.diff(windows.runs) == 0
    covariance[1, 1] += float(np.median(np.diff(windows.times)[same])) ** 2 / 12
    deviation = np.sqrt(np.diag(covariance))
    own = [(float(v), float(s)) for v, s in zip(values, deviation, strict=True)]
    if friction is None or not any(t.friction > 0 for t in robot.tendons):
        own[_FRICTION] = (0.0, 0.0)
    return Dynamics(
        robot=built(np.array([values[0], 0.0, 0.0, own[_FRICTION][0]])),
        delay=float(values[1]),
        values=values[:2],
        deviation=deviation[:2],
        prior=prior[:2],
        by_friction=noise[:2, _FRICTION] / noise[_FRICTION, _FRICTION],
        modulus=own[_MODULUS],
        friction=own[_FRICTION],
        before=before,
        after=_rms(here),
        duration=float(sum(windows.times[windows.runs == r][-1] for r in set(windows.runs))),
    )


def windows_of(recording: Recording) -> Recording:
    """Parts of the recording, each from rest on, in which markers move fastest.

    Markers on the way to where a part begins do not count.
    """
    if recording.times[-1] <= _LONGEST and recording.runs[-1] == 0:
        return recording
    times, runs = recording.times, recording.runs
    same = np.append(False, np.diff(runs) == 0)
    change = np.append(0.0, np.abs(np.diff(recording.commands, axis=0)).max(axis=1))
    speed = np.linalg.norm(
        np.nan_to_num(np.diff(recording.markers[:, -1], axis=0, prepend=recording.markers[:1, -1])),
        axis=1,
    )
    quiet = change <= 1e-3 * np.ptp(recording.commands, axis=0).max()
    begins = np.flatnonzero(~quiet & np.append(True, quiet[:-1]) & same) - 1
    ends = np.append(times[begins[1:]], np.inf)  # of a window: where the next motion begins
    ends[np.append(np.diff(runs[begins]) != 0, False)] = np.inf
    judged, last = [], None
    for begin, end in zip(begins, ends, strict=True):
        still = (times >= times[begin] - 0.3) & (times <= times[begin]) & (runs == runs[begin])
        if not quiet[still][1:].all():
            continue
        until = (times <= times[begin] + _WINDOW) & (times < end) & (runs == runs[begin])
        # The way there sets which way the tendons rub before it is let go.
        first = begin
        if last is not None and runs[last] == runs[begin]:
            first = last if times[begin] - times[last] <= _BEFORE else begin
        after, rows = until & (times >= times[begin]), until & (times >= times[first])
        judged.append((float(speed[after].max()), times[begin], rows))
        last = begin
    judged.sort(key=lambda one: -one[0])
    chosen: list[np.ndarray] = []
    lead = np.zeros(len(times), dtype=bool)
    for fastest, moment, rows in judged:
        full = sum(np.ptp(times[other]) for other in chosen) >= _LONGEST
        if full or fastest < _SLOW * judged[0][0]:
            break
        if all(not np.any(rows & other) for other in chosen):
            chosen.append(rows)
            lead |= rows & (times < moment)
    if not chosen:
        rows = (times <= _LONGEST) & (runs == 0)
        return recording.part(rows)
    chosen.sort(key=lambda rows: int(np.argmax(rows)))
    order = np.concatenate([np.flatnonzero(rows) for rows in chosen])
    number = np.concatenate([np.full(int(rows.sum()), k) for k, rows in enumerate(chosen)])
    first = np.append(True, np.diff(number) != 0)
    elapsed = times[order] - times[order][first][number]
    lost = tuple(replace(marker, may_be_lost=True) for marker in recording.header.marker)
    return replace(
        recording,
        header=replace(recording.header, marker=lost),
        times=elapsed,
        commands=recording.commands[order],
        markers=np.where(lead[order, None, None], np.nan, recording.markers[order]),
        labels=recording.labels[order],
        runs=number,
    )


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.nansum(error**2, axis=-1))))
