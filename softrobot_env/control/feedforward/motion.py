"""References for laws without feedback, ahead by the lag of the drives."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import solve


class Motion(NamedTuple):
    """A reference: (k,) each, [m, m/s, m/s2]."""

    position: ndarray
    velocity: ndarray
    acceleration: ndarray

    def after(self, time: float, jerk: ndarray | float) -> "Motion":
        """The motion `time` [s] later, with a constant jerk (k,) [m/s3]."""
        z, dz, ddz = self
        square = time * time / 2
        return Motion(
            z + time * dz + square * ddz + square * time / 3 * jerk,
            dz + time * ddz + square * jerk,
            ddz + time * jerk,
        )

    def ahead(self, time: float, before: ndarray | None, period: float) -> "Motion":
        """The same with the jerk since an acceleration (k,) a period [s] ago; None: no jerk."""
        return self.after(time, 0.0 if before is None else (self.acceleration - before) / period)


#: [m/s], speed below which the side to which a tendon lags is unclear.
TURNING = 2e-3


def ahead_of(rate: ndarray, period: float, speed: float, lag: ndarray | float = 0.0) -> ndarray:
    """Correction of commands [m] that puts tendons where they should be on average over a period.

    A servo needs a time |rate| T / speed for its motion in a period; and a tendon lags behind its
    command by half of the servo's backlash, and by its friction over its stiffness.

    Args:
        rate: (m,) [m/s], rate of the wanted lengths.
        period: T [s].
        speed: [m/s], speed of the servos; inf if it does not limit them.
        lag: (m,) [m], lag of the tendons.
    """
    late = np.minimum(np.abs(rate), speed) * period / (2 * speed) * rate
    return late + lag * np.tanh(rate / TURNING)


#: Differences of any robot: initial standard deviation, least and largest value.
#: For shares of stiffness and of damping, and a weight at the tip, in weights of the robot.
_ALWAYS = np.array([(0.3, -0.5, 1.0), (0.3, -0.8, 2.0), (0.3, -0.5, 1.0)])

#: The same for an offset of an input, over its full scale, and for the build of a spatial robot:
#: rotation of its tendons about the axis [rad], difference of the bending stiffnesses in two
#: directions.
_OFFSET, _BUILT = (0.05, -0.5, 0.5), (0.1, -0.5, 0.5)

#: Error that no difference explains: a share of the reach, for a time over that of the first mode,
#: 1 / w. It is far larger than sensor noise: unmodelled effects last, and an estimate faster than
#: the first mode would mistake motions for differences.
_ERROR, _LASTS = 0.01, 10.0

#: Time, over that of the first mode, in which the uncertainty grows back to its initial value.
_FORGETS_OFFSETS, _FORGETS = 300.0, 1000.0


class Differences(NamedTuple):
    """Estimated differences between a robot and its model.

    Attributes:
        mean: (n,), shares by which the robot is stiffer and its damping per stiffness larger,
            weight at its tip [weights of the robot], offsets of the inputs [full scale], and
            differences of its build (`nearby.Neighbourhood`).
        covariance: (n, n).
    """

    mean: ndarray
    covariance: ndarray

    @property
    def stiffer(self) -> float:
        """Share by which the robot is stiffer than its model [1]."""
        return float(self.mean[0])

    @property
    def damped(self) -> float:
        """Share by which its damping per stiffness is larger than its model's [1]."""
        return float(self.mean[1])

    @property
    def weight(self) -> float:
        """Weight at the tip, in weights of the robot [1]."""
        return float(self.mean[2])


class DifferenceFilter:
    """Kalman filter of `Differences`, modelled as slow random walks.

    The error without any correction is -G(ways) times the differences, with the tip's displacement
    by each of them (ways) and the first mode G.
    """

    def __init__(
        self, n_inputs: int, n_built: int, reach: float, frequency: float, period: float
    ) -> None:
        """Set up for a robot of a `reach` [m] that is measured every `period` [s].

        Args:
            n_inputs: Of the robot.
            n_built: Number of ways in which its build may differ.
            reach: [m].
            frequency: Angular frequency w [rad/s] of the first mode.
            period: [s] between two updates.
        """
        own = np.vstack([_ALWAYS, *[_OFFSET] * n_inputs, *[_BUILT] * n_built])
        spread, self._least, self._most = own.T
        self._begun = Differences(np.zeros(len(own)), np.diag(spread**2))
        forgets = np.full(len(own), _FORGETS)
        forgets[len(_ALWAYS) : len(_ALWAYS) + n_inputs] = _FORGETS_OFFSETS
        self._walk = self._begun.covariance * (period * frequency / forgets)
        self._reach, self._lasts = reach, max(1.0, _LASTS / (frequency * period))

    def begin(self) -> Differences:
        """The estimate before the first measurement."""
        return self._begun

    def updated(self, before: Differences, left: ndarray, ways: ndarray, far: float) -> Differences:
        """The estimate after a measured error.

        Args:
            before: The last estimate.
            left: (k,) [m], the error without any correction.
            ways: (n, k) [m], displacements of the tip by each difference, filtered by G.
            far: [m], distance of the tip from where they hold: their error grows with its square.
        """
        noise = ((_ERROR * self._reach) ** 2 + (far**2 / self._reach) ** 2) * self._lasts
        covariance = before.covariance + self._walk
        seen = covariance @ ways
        expected = ways.T @ seen + noise * np.eye(len(left))
        gain = solve(expected, seen.T).T
        mean = before.mean - gain @ (left + ways.T @ before.mean)
        covariance = covariance - gain @ seen.T
        return Differences(np.clip(mean, self._least, self._most), (covariance + covariance.T) / 2)
