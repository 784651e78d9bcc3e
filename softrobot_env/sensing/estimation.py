"""Tip of a robot from its spatial sensor by a model of the light, instead of a network.

Four readings tell two bends; what is left over tells how the gains of the four paths drift.
`LightModel` has the few numbers of a specimen, `calibrate` finds them, with its hysteresis, from
readings with tips seen by a camera, and `BendFilter` finds the bend, its play and the drift of the
gains from one reading to the next: the most probable values by Gauss and Newton.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from softrobot_env.robots.sensors import ACCEPTANCE, OUTPUTS, Sensor
from softrobot_env.sensing.optics import STRAIGHT, TILT, split_light
from softrobot_env.sensing.specimens import DRIFT_TIME, follow, lagged

#: How far numbers of specimens are expected to lie from the design [1, rad].
_SPREAD = 0.1

#: Relative noise [1] of a reading and of the model, and noise [1] by the converter.
_RELATIVE = 0.005
_CONVERTER = 1.5 / STRAIGHT["spatial"]

#: Bend of the rig per tip [rad/m], about.
BEND_PER_PLACE = 3.0

#: Standard deviation [1] of the drift of a gain.
DRIFT = 0.015

#: Largest bend [rad] of the sensor, and bends on a side of the grid where a search begins.
_FARTHEST, _GRID = 0.75, 9
_ITERATIONS = 12


@dataclass(frozen=True)
class LightModel:
    """Numbers of one specimen on one robot.

    Attributes:
        gain, tilt, azimuth: (4,) of the light paths, see `specimens.Specimen`.
        acceptance: [rad].
        lag: [1], share of the bend that lags behind.
        straight: (2,) [rad], bend where the tip is at the origin.
        turn: (2, 2) [rad/m], bend per tip near there.
        curve: (2,) [1/m2, 1/m4], how the bend grows faster than the tip far from there.
    """

    gain: np.ndarray
    tilt: np.ndarray
    azimuth: np.ndarray
    acceptance: float
    lag: float
    straight: np.ndarray
    turn: np.ndarray
    curve: np.ndarray

    def light(self, bend: np.ndarray) -> np.ndarray:
        """Readings (..., 4) at felt bends (..., 2) [rad], without drift."""
        light = split_light(bend, self.azimuth, self.tilt, np.array([self.acceptance]))
        return np.e * self.gain * light

    def bend(self, tip: np.ndarray) -> np.ndarray:
        """Bends (..., 2) [rad] of tips (..., 2) [m]."""
        square = (tip**2).sum(axis=-1, keepdims=True)
        growth = 1 + self.curve[0] * square + self.curve[1] * square**2
        return self.straight + growth * (tip @ self.turn.T)

    def tip(self, bend: np.ndarray) -> np.ndarray:
        """Tips (..., 2) [m] of bends (..., 2) [rad], inverse of `bend`."""
        inverse = np.linalg.inv(self.turn).T
        straight = (bend - self.straight) @ inverse
        tip = straight.copy()
        for _ in range(60):
            square = (tip**2).sum(axis=-1, keepdims=True)
            growth = 1 + self.curve[0] * square + self.curve[1] * square**2
            tip = 0.5 * (tip + straight / growth)
        return tip


def _unpacked(numbers: np.ndarray, design: Sensor) -> LightModel:
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


def calibrate(
    readings: np.ndarray, tips: np.ndarray, known: np.ndarray, design: Sensor
) -> LightModel:
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

    def errors(numbers: np.ndarray) -> np.ndarray:
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


def _felt(model: LightModel, bends: np.ndarray) -> np.ndarray:
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
        tip: (2,) [m].
    """

    def __init__(self, model: LightModel, drift: float = DRIFT) -> None:
        """A filter before any reading, of a robot that was straight.

        Args:
            model: Of the specimen.
            drift: Standard deviation [1] of the drift of a gain that is expected.
        """
        self._expected = drift**2 * np.eye(OUTPUTS)
        self.model, self.bend, self.drift = model, np.zeros(2), np.zeros(OUTPUTS)
        self.tip = model.tip(self.bend)
        self._variance = self._expected
        self._play = np.zeros((1, 1, 3, 2))
        side = np.linspace(-_FARTHEST, _FARTHEST, _GRID)
        grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        self._grid = grid[np.hypot(*grid.T) <= _FARTHEST]

    def update(self, reading: np.ndarray, passed: float, straight: bool = False) -> np.ndarray:
        """Take a reading (4,), `passed` seconds after the last; returns the tip (2,) [m].

        Args:
            reading: The reading.
            passed: [s].
            straight: Whether the robot is known to be at rest with its tip at the origin.
        """
        keep = np.exp(-passed / DRIFT_TIME)
        self.drift = keep * self.drift
        self._variance = keep**2 * self._variance + (1 - keep**2) * self._expected
        weight = 1 / (_RELATIVE * reading + _CONVERTER) ** 2
        starts = [self.bend, self._nearest(reading, weight)]
        prior = np.linalg.inv(self._variance)
        anchor = (self.model.bend(np.zeros(2)), 1e8) if straight else (np.zeros(2), 1e-2)
        found = [self._search(s, reading, weight, prior, anchor) for s in starts]
        _, bend, drift, hessian = min(found, key=lambda one: one[0])
        self.bend, self.drift = bend, drift
        self._variance = np.linalg.inv(hessian)[2:, 2:]
        follow(self._play, bend[None, None])
        self.tip = self.model.tip(bend)
        return self.tip

    def _nearest(self, reading: np.ndarray, weight: np.ndarray) -> np.ndarray:
        light = (1 + self.drift) * self.model.light(self._grid)
        return self._grid[((light - reading) ** 2 * weight).sum(axis=1).argmin()]

    def _light(self, bend: np.ndarray) -> np.ndarray:
        """Readings (k, 4) at bends (k, 2) reached from the last one, without drift."""
        play = np.repeat(self._play, len(bend), axis=0)
        follow(play, bend[:, None])
        share = np.full((len(bend), 1), self.model.lag)
        return self.model.light(lagged(play, bend[:, None], share)[:, 0])

    def _search(
        self,
        bend: np.ndarray,
        reading: np.ndarray,
        weight: np.ndarray,
        prior: np.ndarray,
        anchor: tuple[np.ndarray, float],
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Cost, bend, drift and Hessian (6, 6) at a minimum near a bend."""
        mean, drift = self.drift, self.drift
        (place, sure), step = anchor, 1e-5
        tries = step * np.array([[0.0, 0.0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        best, damping = None, 1e-3
        for _ in range(_ITERATIONS):
            light = self._light(bend + tries)
            off = reading - (1 + drift) * light[0]
            slope = np.empty((OUTPUTS, 2 + OUTPUTS))
            slope[:, 0] = (1 + drift) * (light[1] - light[2]) / (2 * step)
            slope[:, 1] = (1 + drift) * (light[3] - light[4]) / (2 * step)
            slope[:, 2:] = np.diag(light[0])
            cost = weight @ off**2 + (drift - mean) @ prior @ (drift - mean)
            cost += sure * ((bend - place) ** 2).sum()
            if best is not None and cost > best[0]:
                damping *= 10
            else:
                damping /= 3
                hessian = (slope.T * weight) @ slope
                hessian[2:, 2:] += prior
                hessian[0, 0] += sure
                hessian[1, 1] += sure
                gradient = slope.T @ (weight * off)
                gradient[2:] -= prior @ (drift - mean)
                gradient[:2] -= sure * (bend - place)
                best = (cost, bend, drift, hessian)
                if np.abs(gradient / np.diag(hessian)).max() < 1e-7:
                    break
                kept = gradient, hessian
            way = np.linalg.solve(kept[1] + damping * np.diag(np.diag(kept[1])), kept[0])
            bend = best[1] + np.clip(way[:2], -0.2, 0.2)
            drift = best[2] + way[2:]
        return best
