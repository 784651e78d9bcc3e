"""Damping, delay and friction of a robot recorded in motion, by the MuJoCo chain.

The chain gets the recording's commands from rest, as in a replay; damping of the backbone, delay of
the markers and friction of the tendons are changed until its markers move like the recorded ones.
Errors at rest belong to the statics: the mean error of each marker in each window is removed.
Friction concerns both: if a robot oscillates before it rests, part of the friction is lost, and the
statics underestimate it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import inv, norm, solve

from softrobot_env.core.continuation import Damping, descend
from softrobot_env.recordings import Recording
from softrobot_env.recordings.recording import since_begin
from softrobot_env.robots import RobotParams

from ..errors import centred, size
from ..replay import replay
from .least_squares import clustered, correlation_time

_LONGEST = 12.0  # s that are simulated
_SLOW = 0.2  # of the largest speed; slower motion shows friction at rest, not damping
_WINDOW, _BEFORE = 1.5, 3.0  # s after it begins to move, and at most before
_STEPS = 6
_DAMPING, _RULE = 1e-3, Damping(least=1e-6, tries=5)
_PROBE = (0.05, 0.004, 0.01, 0.05)  # of log damping, delay [s], log modulus, log friction
_PRIOR = (1.5, 0.05)  # of the first two
_LEAST = 1e-3  # of the modulus
_IN_MOTION = 0.2  # by which friction in motion may differ from what is left of it at rest
_MOST = np.array([1.0, 0.03, 0.2, 0.5])  # of a step
_MODULUS, _FRICTION = 2, 3


@dataclass(frozen=True)
class Dynamics:
    """Identified dynamics.

    Attributes:
        robot: With its damping, and with its friction in motion if that was identified.
        delay: [s] of the markers.
        values: (2,) logarithm of the damping's factor, and delay [s].
        deviation: (2,) standard deviations.
        prior: (2,) those of the prior.
        by_friction: (2,) derivative of the values by the logarithm of the friction, with the rest
            fitted.
        modulus, friction: Logarithms of Young's modulus and of friction in motion over those of the
            statics, and their standard deviations; zeros if no friction is identified.
        before, after: RMS [m] of the markers' errors in the windows, without their means.
        duration: [s] of the windows.
    """

    robot: RobotParams
    delay: float
    values: ndarray
    deviation: ndarray
    prior: ndarray
    by_friction: ndarray
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
    begin: ndarray | None = None,
    show: Callable[[int, float], None] | None = None,
) -> Dynamics:
    """Find damping, delay and friction.

    Args:
        robot: With its statics identified.
        recording: In motion, in its identified frame.
        modulus: Standard deviation of the logarithm of Young's modulus, as the statics left it. It
            is fitted along with damping and delay, whose uncertainty includes it, but the resulting
            robot keeps its value.
        friction: Likewise for the tendons' common friction, which is identified again; None if it
            is known and stays unchanged.
        begin: (2,) logarithm of the damping's factor, and delay [s], at the start of the search.
        show: Called with each step and its RMS [m].

    Raises:
        ValueError: The robot has no initial damping, or the simulation fails everywhere.
    """
    if not all(s.damping_time > 0 for s in robot.backbone.sections):
        raise ValueError(
            f"robot {robot.name!r} has damping_time_s = 0: give a guess to begin with, such as 0.02"
        )
    prior = (
        *_PRIOR,
        max(modulus, _LEAST),
        _LEAST if friction is None else float(np.hypot(friction, _IN_MOTION)),
    )
    problem = _Problem(robot, windows_of(recording), np.array(prior))
    here = problem.at(np.append(np.zeros(2) if begin is None else begin, [0.0, 0.0]))
    before, damping = size(here.error), _DAMPING
    for step in range(_STEPS):
        problem.linearize(here)
        moved, damping = descend(problem.weighed(here), problem.step, damping, _RULE)
        if moved is None:
            break
        way, here = np.abs(moved.values - here.values) / problem.prior, moved
        if show is not None:
            show(step + 1, size(here.error))
        if way.max() < 2e-3:
            break
    noise, deviation = inv(problem.normal), problem.deviation(here)
    own = [(float(v), float(s)) for v, s in zip(here.values, deviation, strict=True)]
    if friction is None or not any(t.friction > 0 for t in robot.tendons):
        own[_FRICTION] = (0.0, 0.0)
    return Dynamics(
        robot=problem.built(np.array([here.values[0], 0.0, 0.0, own[_FRICTION][0]])),
        delay=float(here.values[1]),
        values=here.values[:2],
        deviation=deviation[:2],
        prior=problem.prior[:2],
        by_friction=noise[:2, _FRICTION] / noise[_FRICTION, _FRICTION],
        modulus=own[_MODULUS],
        friction=own[_FRICTION],
        before=before,
        after=size(here.error),
        duration=problem.duration,
    )


class _Point(NamedTuple):
    """Values (4,), errors (t, k, 3) [m] that they leave, and what both cost."""

    values: ndarray
    error: ndarray
    cost: float = np.inf


class _Problem:
    """Least squares of a robot's damping, delay, modulus and friction over some windows.

    Attributes:
        prior: (4,) standard deviations.
        normal: (4, 4) matrix of the normal equations, of the last linearization.
    """

    def __init__(self, robot: RobotParams, windows: Recording, prior: ndarray) -> None:
        self._robot, self._windows, self.prior = robot, windows, prior

    def built(self, values: ndarray) -> RobotParams:
        """The robot with values (4,)."""
        damping, _, modulus, friction = (float(np.exp(x)) for x in values)
        rubbing = tuple(replace(t, friction=t.friction * friction) for t in self._robot.tendons)
        moved = replace(self._robot, tendons=rubbing)
        return moved.vary(damping_time=damping, youngs_modulus=modulus)

    def at(self, values: ndarray) -> _Point:
        """Simulate the windows, the mean error of each left out."""
        windows, delay = self._windows, max(float(values[1]), 0.0)
        moved = replace(windows, header=windows.header.later(delay))
        error = replay(moved, self.built(values)).error
        for run in np.unique(windows.runs):
            rows = windows.runs == run
            error[rows] = centred(error[rows])
        if np.isnan(error).all():
            raise ValueError("the identified robot could not be simulated in motion")
        return _Point(values, error)

    def linearize(self, here: _Point) -> None:
        """Take slopes by differences, and weights by what is left."""
        probes = enumerate(_PROBE)
        moved = ((self.at(here.values + np.eye(4)[k] * p).error, p) for k, p in probes)
        self._here = here
        self._slopes = np.stack([(error - here.error) / probe for error, probe in moved], axis=-1)
        lasting = correlation_time(here.error, self._windows.runs)
        self._variance = max(float(np.nanmean(here.error**2)), 1e-12) * lasting
        known = np.isfinite(here.error) & np.isfinite(self._slopes).all(axis=-1)
        a, b = self._slopes[known], here.error[known]
        self.normal = a.T @ a / self._variance + np.diag(1 / self.prior**2)
        self._right = a.T @ b / self._variance + here.values / self.prior**2

    def weighed(self, point: _Point) -> _Point:
        """A point with its cost, by the weights of the last linearization."""
        data = np.nansum(point.error**2) / self._variance
        return point._replace(cost=float(data + np.sum((point.values / self.prior) ** 2)))

    def step(self, damping: float) -> _Point:
        """Where a damped step leads."""
        matrix = self.normal + damping * np.diag(np.diag(self.normal))
        there = self._here.values - np.clip(solve(matrix, self._right), -_MOST, _MOST)
        there[1] = max(there[1], 0.0)
        return self.weighed(self.at(there))

    def deviation(self, here: _Point) -> ndarray:
        """(4,) standard deviations."""
        windows = self._windows
        covariance = clustered(self._slopes, here.error, self.normal, self._variance, windows.runs)
        # When within a sample a command begins is not known.
        covariance[1, 1] += float(np.median(windows.steps)) ** 2 / 12
        return np.sqrt(np.diag(covariance))

    @property
    def duration(self) -> float:
        """[s] of the windows."""
        return float(self._windows.steps.sum())


def windows_of(recording: Recording) -> Recording:
    """Parts of the recording, each from rest on, in which markers move fastest.

    Markers on the way to where a part begins do not count.
    """
    if recording.times[-1] <= _LONGEST and recording.runs[-1] == 0:
        return recording
    times = recording.times
    chosen: list[ndarray] = []
    lead = np.zeros(len(times), bool)
    judged = sorted(_judged(recording), key=lambda one: -one[0])
    for fastest, moment, rows in judged:
        full = sum(np.ptp(times[other]) for other in chosen) >= _LONGEST
        if full or fastest < _SLOW * judged[0][0]:
            break
        if all(not np.any(rows & other) for other in chosen):
            chosen.append(rows)
            lead |= rows & (times < moment)
    if not chosen:
        return recording.part((times <= _LONGEST) & (recording.runs == 0))
    chosen.sort(key=lambda rows: int(np.argmax(rows)))
    order = np.concatenate([np.flatnonzero(rows) for rows in chosen])
    number = np.concatenate([np.full(int(rows.sum()), k) for k, rows in enumerate(chosen)])
    found = recording.part(order)
    return replace(
        found,
        header=found.header.with_markers(may_be_lost=True),
        times=since_begin(found.times, number),
        markers=np.where(lead[order, None, None], np.nan, found.markers),
        runs=number,
    )


def _judged(recording: Recording) -> list[tuple[float, float, ndarray]]:
    """Largest speed [m/s], begin [s] and rows (t,) bool of each motion out of rest."""
    times, runs, tip = recording.times, recording.runs, recording.markers[:, -1]
    change = np.append(0.0, np.abs(np.diff(recording.commands, axis=0)).max(axis=1))
    speed = norm(np.nan_to_num(np.diff(tip, axis=0, prepend=tip[:1])), axis=1)
    quiet = change <= 1e-3 * np.ptp(recording.commands, axis=0).max()
    begins = np.flatnonzero(~quiet & np.append(True, quiet[:-1]) & ~recording.begins) - 1
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
        after = until & (times >= times[begin])
        judged.append((float(speed[after].max()), times[begin], until & (times >= times[first])))
        last = begin
    return judged
