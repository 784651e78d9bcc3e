"""Which commands would be most informative about the least known parameters.

Candidates are single pulls of each tendon, with the others held or let out, and the robot lying or
hanging if gravity matters. Each is simulated with the identified robot; its derivatives predict the
spread of the least known parameters before anything is measured.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from numpy.linalg import norm, solve

from .least_squares import Fit
from .model import StaticModel

_LEVELS = 8
_ASKED = 5  # least known parameters
_REPORTED = 5  # experiments


@dataclass(frozen=True)
class Experiment:
    """Commands of an informative experiment.

    Attributes:
        name: Description.
        gain: [1], sum of the relative decrease of variance over the least known parameters.
        parameter: The one that gains most.
        before, after: Its standard deviation, without and with the experiment.
        commands: (t, n) in SI units, in the recording's columns.
    """

    name: str
    gain: float
    parameter: str
    before: float
    after: float
    commands: ndarray


def best_experiments(model: StaticModel, fit: Fit) -> list[Experiment]:
    """The most informative experiments, best first; none if no parameter is free."""
    spread = model.unknowns.spread
    free = np.flatnonzero(fit.free)
    asked = free[np.argsort(-(fit.deviation[free] / spread[free]))[:_ASKED]]
    found = []
    for name, commands, gravity in _candidates(model):
        slopes = _slopes(model, fit, commands, gravity)
        if slopes is None:
            continue
        a = slopes.reshape(-1, len(free)) / fit.weights.deviation
        old = fit.covariance[np.ix_(free, free)]
        gained = solve(np.eye(len(a)) + a @ old @ a.T, a @ old)
        new = np.diag(old - old @ a.T @ gained)
        places = np.searchsorted(free, asked)
        before, after = np.diag(old)[places], new[places]
        most = int(np.argmax(1 - after / before))
        label = model.unknowns.labels[asked[most]]
        deviations = np.sqrt([before[most], max(after[most], 0.0)]).tolist()
        gain = float((1 - after / before).sum())
        found.append(Experiment(name, gain, label, *deviations, commands))
    return sorted(found, key=lambda one: -one.gain)[:_REPORTED]


def _candidates(model: StaticModel) -> list[tuple[str, ndarray, ndarray | None]]:
    """Name, commands (t, n) and another gravity (3,) along the robot's axes, or None."""
    recording = model.recording
    names = recording.tendons or recording.header.commands.columns
    low, high = recording.commands.min(axis=0), recording.commands.max(axis=0)
    rise = np.concatenate([np.linspace(0, 1, _LEVELS), np.linspace(1, 0, _LEVELS)[1:]])
    middle = np.median(recording.commands, axis=0)
    lets_out = recording.kind == "length" and bool(np.any(low < 0))
    found: list[tuple[str, ndarray, ndarray | None]] = []
    for k, name in enumerate(names):
        held = np.tile(middle, (len(rise), 1))
        held[:, k] = middle[k] + rise * (high[k] - middle[k]) / 2
        found.append((f"pull {name}, hold the others", held, None))
        if lets_out:
            loose = np.tile(low, (len(rise), 1))
            loose[:, k] = rise * high[k] / 2
            found.append((f"pull {name}, let the others out", loose, None))
    gravity = np.array(model.robot.own_gravity)
    if gravity.any():
        still = np.tile(middle, (3, 1))
        size = float(norm(gravity))
        found.append(("lay the robot level, its x axis up", still, np.array([-size, 0.0, 0.0])))
        if model.spatial:
            found.append(("lay the robot level, its y axis up", still, np.array([0.0, -size, 0.0])))
        found.append(("turn the robot upside down", still, -gravity))
    return found


def _slopes(
    model: StaticModel, fit: Fit, commands: ndarray, gravity: ndarray | None
) -> ndarray | None:
    """(t, k, 3, f) slopes of an experiment; None where it cannot be simulated."""
    rows = len(commands)
    recording = model.recording
    planned = replace(
        recording,
        times=np.arange(rows, dtype=float),
        commands=commands,
        markers=np.zeros((rows, *recording.markers.shape[1:])),
        labels=np.full(rows, ""),
        runs=np.zeros(rows, int),
    )
    other = model.on(planned, gravity)
    found = other.simulate(fit.x, fit.free)
    slopes = found.slopes.copy()
    if gravity is not None:  # the robot is mounted again: the old frame is void
        slopes[..., other.unknowns.moves_frame[fit.free]] = 0
    return slopes if found.found.all() and np.isfinite(slopes).all() else None
