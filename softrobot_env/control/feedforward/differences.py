"""How a robot differs from its model, learned from where corrections leave its tip."""

from typing import NamedTuple

import numpy as np

#: Standard deviations before anything was seen: of offsets, in full scales of the inputs, of the
#: stiffness, as a share of it, and of a weight at the tip, in weights of the robot.
_OFFSET, _STIFFER, _WEIGHT = 0.05, 0.3, 0.3

#: Least and largest values of the same.
_OFFSETS, _STIFFNESSES, _WEIGHTS = (-0.5, 0.5), (-0.5, 1.0), (-0.5, 1.0)

#: What no difference explains: a share of the reach, for a time over that of the first mode, 1 / w.
#: It is far more than sensors err by: what is not modelled lasts, and an estimate that follows
#: faster than the first mode would take motions for differences.
_ERROR, _LASTS = 0.03, 10.0

#: Times, over that of the first mode, in which as much is forgotten as was unknown at first.
_FORGETS_OFFSETS, _FORGETS = 30.0, 300.0


class Differences(NamedTuple):
    """An estimate.

    Attributes:
        mean: (n_inputs + 2,), offsets of the inputs [full scale], share by which the robot is
            stiffer, and weight at its tip [weights of the robot].
        covariance: (n_inputs + 2, n_inputs + 2).
    """

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def offset(self) -> np.ndarray:
        """Of the inputs (n_inputs,) [full scale]."""
        return self.mean[:-2]

    @property
    def stiffer(self) -> float:
        """Share by which the robot is stiffer than its model [1]."""
        return float(self.mean[-2])

    @property
    def weight(self) -> float:
        """Weight at the tip, in weights of the robot [1]."""
        return float(self.mean[-1])


class DifferenceFilter:
    """Kalman filter of `Differences` that walk randomly, about constant.

    An error that there would be without any correction is -G(ways) times the differences, with
    the ways of the tip by each of them and G the first mode.
    """

    def __init__(self, n_inputs: int, reach: float, frequency: float, period: float) -> None:
        """Weigh what is seen every `period` [s] of a robot of a `reach` [m].

        Args:
            n_inputs: Of the robot.
            reach: [m].
            frequency: Angular frequency w [rad/s] of the first mode.
            period: [s] between two updates.
        """
        spread = np.array([*[_OFFSET] * n_inputs, _STIFFER, _WEIGHT])
        self._begun = Differences(np.zeros(n_inputs + 2), np.diag(spread**2))
        limits = np.array([*[_OFFSETS] * n_inputs, _STIFFNESSES, _WEIGHTS])
        self._least, self._most = limits.T
        forgets = np.array([*[_FORGETS_OFFSETS] * n_inputs, _FORGETS, _FORGETS])
        self._walk = self._begun.covariance * (period * frequency / forgets)
        self._noise = (_ERROR * reach) ** 2 * max(1.0, _LASTS / (frequency * period))

    def begin(self) -> Differences:
        """Before anything was seen."""
        return self._begun

    def updated(self, before: Differences, left: np.ndarray, ways: np.ndarray) -> Differences:
        """After an error was seen.

        Args:
            before: The last estimate.
            left: (k,) [m], the error that there would be without any correction.
            ways: (n_inputs + 2, k) [m], of the tip by each difference, as G gives them.
        """
        covariance = before.covariance + self._walk
        seen = covariance @ ways
        expected = ways.T @ seen + self._noise * np.eye(len(left))
        gain = np.linalg.solve(expected, seen.T).T
        mean = before.mean - gain @ (left + ways.T @ before.mean)
        covariance = covariance - gain @ seen.T
        return Differences(np.clip(mean, self._least, self._most), (covariance + covariance.T) / 2)
