"""Calibration as in the thesis: polynomials of relative currents (4.7), and errors (4.8)."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial


class Range(NamedTuple):
    """Lowest and highest reading, which are 0 and 100 % of the relative current."""

    low: float
    high: float

    @classmethod
    def of(cls, readings: np.ndarray) -> "Range":
        """That of readings."""
        return cls(float(readings.min()), float(readings.max()))

    def relative(self, readings: np.ndarray) -> np.ndarray:
        """Relative currents [%]."""
        return 100 * (readings - self.low) / (self.high - self.low)


class AngleErrors(NamedTuple):
    """Errors [rad] of (4.8): mean and standard deviation of their size, and the largest."""

    mean: float
    deviation: float
    largest: float

    @classmethod
    def of(cls, errors: np.ndarray) -> "AngleErrors":
        """Those of errors of either sign."""
        size = np.abs(errors)
        return cls(float(size.mean()), float(size.std()), float(size.max()))


def fit(relative: np.ndarray, angle: np.ndarray, order: int) -> Polynomial:
    """Polynomial of an order that gives angles (n,) of relative currents (n,) best (4.7).

    Raises:
        ValueError: Fewer samples than coefficients.
    """
    if len(relative) <= order:
        raise ValueError(f"{len(relative)} samples cannot determine {order + 1} coefficients")
    return Polynomial.fit(relative, angle, order)


def curvatures(angles: np.ndarray, length: float, first: float) -> np.ndarray:
    """Curvatures (n + 1,) [1/m] of segments of `length` [m] from joints' angles (n,) [rad].

    Corrected (4.5). The error of the first curvature does not decay along the sensor, it
    alternates: use it where that is known.
    """
    kappa = [first]
    for angle in angles:
        kappa.append(2 * angle / length - kappa[-1])
    return np.array(kappa)


def mean_curvature(angle: float, segments: int, length: float) -> float:
    """Curvature [1/m] of a sensor of segments of `length` [m], if it is constant, by (4.2)."""
    return angle / ((segments - 1) * length)
