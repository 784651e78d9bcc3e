"""Tip of a robot from its spatial sensor by a model of the light, instead of a network.

Four readings give two bends; what is left over shows how the gains of the four paths drift.
`LightModel` has the few numbers of a specimen, `calibrate` finds them, with its hysteresis, from
readings with tips seen by a camera, and `BendFilter` finds the bend, its play and the drift of the
gains from one reading to the next: the most probable values by Gauss and Newton.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import inv, solve
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from softrobot_env.core.continuation import Damping, descend
from softrobot_env.robots.sensors import ACCEPTANCE, OUTPUTS, Sensor

from .optics import DRIFT_TIME, STRAIGHT, TILT, follow, lagged, split_light

#: How far numbers of specimens are expected to lie from the design [1, rad].
_SPREAD = 0.1

#: Relative noise [1] of a reading and of the model, and noise [1] by the converter.
_RELATIVE = 0.005
_CONVERTER = 1.5 / STRAIGHT["spatial"]

#: Bend of the rig per tip [rad/m], about.
BEND_PER_PLACE = 3.0

#: Standard deviation [1] of the drift of a gain.
DRIFT = 0.015

#: How much it counts [1/rad2] that bends are expected to be small.
_SURE = 1e-2

#: Largest bend [rad] of the sensor, and bends on a side of the grid where a search begins.
_FARTHEST, _GRID = 0.75, 9
_ITERATIONS = 12
_DAMPING, _RULE = 1e-3, Damping(tries=12)
_CLOSE = 1e-7  # change of a bend [rad] or gain [1] that is none
_DIFFERENCE = 1e-5  # rad
_TURNS = _DIFFERENCE * np.array([[0.0, 0.0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@dataclass(frozen=True)
class LightModel:
    """Numbers of one specimen on one robot.

    Attributes:
        gain, tilt, azimuth: (4,) of the light paths, see `optics.Specimen`.
        acceptance: [rad].
        lag: [1], share of the bend that lags behind.
        straight: (2,) [rad], bend where the tip is at the origin.
        turn: (2, 2) [rad/m], bend per tip near there.
        curve: (2,) [1/m2, 1/m4], how the bend grows faster than the tip far from there.
    """

    gain: ndarray
    tilt: ndarray
    azimuth: ndarray
    acceptance: float
    lag: float
    straight: ndarray
    turn: ndarray
    curve: ndarray

    def light(self, bend: ndarray) -> ndarray:
        """Readings (..., 4) at felt bends (..., 2) [rad], without drift."""
        light = split_light(bend, self.azimuth, self.tilt, np.array([self.acceptance]))
        return np.e * self.gain * light

    def bend(self, tip: ndarray) -> ndarray:
        """Bends (..., 2) [rad] of tips (..., 2) [m]."""
        return self.straight + self._growth(tip) * (tip @ self.turn.T)

    def _growth(self, tip: ndarray) -> ndarray:
        square = (tip**2).sum(axis=-1, keepdims=True)
        return 1 + self.curve[0] * square + self.curve[1] * square**2

    def tip(self, bend: ndarray) -> ndarray:
        """Tips (..., 2) [m] of bends (..., 2) [rad], inverse of `bend`."""
        straight = (bend - self.straight) @ inv(self.turn).T
        tip = straight.copy()
        for _ in range(60):
            tip = 0.5 * (tip + straight / self._growth(tip))
        return tip


def _unpacked(numbers: ndarray, design: Sensor) -> LightModel:
    gain, tilt, azimuth, rest = np.split(numbers, [OUTPUTS, 2 * OUTPUTS, 3 * OUTPUTS])
    around = design.azimuth + 2 * np.pi / OUTPUTS * np.arange(OUTPUTS)
    return LightModel(
        gain=np.exp(gain),
        tilt=TILT * (1 + tilt),
        azimuth=around + azimuth,
        acceptance=ACCEPTANCE * (1 + rest[0]),
        lag=rest[1],
        straight=rest[2:4],
        turn=BEND_PER_PLACE * np.eye(2) + rest[4:8].reshape(2, 2),
        curve=rest[8:10] * [10.0, 1000.0],
    )


def calibrate(readings: ndarray, tips: ndarray, known: ndarray, design: Sensor) -> LightModel:
    """The model of a specimen from a series of postures at rest.

    Args:
        readings: (n, 4), in the order in which they were taken, from the straight pose on.
        tips: (n, 2) [m], as a camera sees them; or whatever else the bend grows with about as it
            does with the tip of the rig [m].
        known: (n,) bool, which of these tips may be used.
        design: The sensor as designed.

    Raises:
        ValueError: Fewer postures than numbers.
    """
    # Where the tip is not known, the play is as if the robot had gone straight on.
    order = np.arange(len(tips))
    path = np.stack([np.interp(order, order[known], x[known]) for x in tips.T], axis=1)
    noise = (_RELATIVE + DRIFT / 2) * readings[known] + _CONVERTER

    def errors(numbers: ndarray) -> ndarray:
        model = _unpacked(numbers, design)
        felt = _felt(model, model.bend(path))
        off = (model.light(felt[known]) - readings[known]) / noise
        prior = numbers[: 3 * OUTPUTS + 1] / _SPREAD
        return np.concatenate([off.ravel(), prior, [(numbers[13] - 0.05) / 0.1]])

    if 4 * np.count_nonzero(known) < 60:
        raise ValueError(f"{np.count_nonzero(known)} postures do not determine a specimen")
    start = np.zeros(3 * OUTPUTS + 10)
    found = least_squares(errors, start, loss="soft_l1", x_scale="jac", max_nfev=60)
    return _unpacked(found.x, design)


def _felt(model: LightModel, bends: ndarray) -> ndarray:
    """Bends (n, 2) that fibres feel along a series of bends (n, 2)."""
    play, out = np.zeros((1, 1, 3, 2)), np.empty_like(bends)
    for bend, row in zip(bends, out, strict=True):
        follow(play, bend[None, None])
        row[:] = lagged(play, bend[None, None], np.array([[model.lag]]))[0, 0]
    return out


class BendFilter:
    """Bend, play and drift from one reading to the next.

    Attributes:
        model: Of the specimen.
        bend: (2,) [rad], the most probable one.
        drift: (4,) [1], of the gains.
    """

    def __init__(self, model: LightModel, drift: float = DRIFT) -> None:
        """A filter before any reading, of a robot that was straight.

        Args:
            model: Of the specimen.
            drift: Standard deviation [1] of the drift of a gain that is expected.
        """
        self._expected = drift**2 * np.eye(OUTPUTS)
        self.model, self.bend, self.drift = model, np.zeros(2), np.zeros(OUTPUTS)
        self._variance = self._expected
        self._play = np.zeros((1, 1, 3, 2))
        side = np.linspace(-_FARTHEST, _FARTHEST, _GRID)
        grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        self._grid = grid[np.hypot(*grid.T) <= _FARTHEST]

    def update(self, reading: ndarray, passed: float) -> ndarray:
        """Take a reading (4,), `passed` seconds after the last; returns the bend (2,) [rad]."""
        keep = np.exp(-passed / DRIFT_TIME)
        self.drift = keep * self.drift
        self._variance = keep**2 * self._variance + (1 - keep**2) * self._expected
        weight = 1 / (_RELATIVE * reading + _CONVERTER) ** 2
        # Of bend and drift, what is expected and how much that counts.
        mean = np.concatenate([np.zeros(2), self.drift])
        prior = block_diag(_SURE * np.eye(2), inv(self._variance))

        def guess(x: ndarray) -> _Guess:
            light, gain = self._light(x[:2] + _TURNS), 1 + x[2:]
            off, slope = reading - gain * light[0], np.diag(light[0])
            by_bend = (light[1::2] - light[2::2]) * gain / (2 * _DIFFERENCE)
            slope = np.concatenate([by_bend.T, slope], axis=1)
            cost = weight @ off**2 + (x - mean) @ prior @ (x - mean)
            gradient = slope.T @ (weight * off) - prior @ (x - mean)
            return _Guess(float(cost), x, (slope.T * weight) @ slope + prior, gradient)

        starts = (self.bend, self._nearest(reading, weight))
        found = [_least(guess, np.concatenate([bend, self.drift])) for bend in starts]
        best = min(found, key=lambda one: one.cost)
        self.bend, self.drift = best.x[:2], best.x[2:]
        self._variance = inv(best.hessian)[2:, 2:]
        follow(self._play, self.bend[None, None])
        return self.bend

    def _nearest(self, reading: ndarray, weight: ndarray) -> ndarray:
        light = (1 + self.drift) * self.model.light(self._grid)
        return self._grid[((light - reading) ** 2 * weight).sum(axis=1).argmin()]

    def _light(self, bend: ndarray) -> ndarray:
        """Readings (k, 4) at bends (k, 2) reached from the last one, without drift."""
        play = np.repeat(self._play, len(bend), axis=0)
        follow(play, bend[:, None])
        share = np.full((len(bend), 1), self.model.lag)
        return self.model.light(lagged(play, bend[:, None], share)[:, 0])


class _Guess(NamedTuple):
    """Bend and drift (6,), what they cost, half of its second derivative, and the way down."""

    cost: float
    x: ndarray
    hessian: ndarray
    gradient: ndarray


def _least(guess: Callable[[ndarray], _Guess], x: ndarray) -> _Guess:
    """A minimum near x (6,), by Levenberg and Marquardt."""
    here, damping = guess(x), _DAMPING
    for _ in range(_ITERATIONS):
        diagonal = np.diag(here.hessian)
        if np.abs(here.gradient / diagonal).max() < _CLOSE:
            break

        def step(damping: float, here: _Guess = here, diagonal: ndarray = diagonal) -> _Guess:
            way = solve(here.hessian + damping * np.diag(diagonal), here.gradient)
            way[:2] = np.clip(way[:2], -0.2, 0.2)
            return guess(here.x + way)

        moved, damping = descend(here, step, damping, _RULE)
        if moved is None:
            break
        here = moved
    return here
