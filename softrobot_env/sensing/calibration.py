"""Calibration as in the thesis: polynomials of relative currents (4.7), and errors (4.8)."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.polynomial import Polynomial


class Range(NamedTuple):
    """Lowest and highest reading, which are 0 and 100 % of the relative current."""

    low: float
    high: float

    @classmethod
    def of(cls, readings: ndarray) -> "Range":
        """That of readings."""
        return cls(float(readings.min()), float(readings.max()))

    def relative(self, readings: ndarray) -> ndarray:
        """Relative currents [%]."""
        return 100 * (readings - self.low) / (self.high - self.low)


class AngleErrors(NamedTuple):
    """Errors [rad] of (4.8): mean and standard deviation of their size, and the largest."""

    mean: float
    deviation: float
    largest: float

    @classmethod
    def of(cls, errors: ndarray) -> "AngleErrors":
        """Those of errors of either sign."""
        size = np.abs(errors)
        return cls(float(size.mean()), float(size.std()), float(size.max()))


def fit(relative: ndarray, angle: ndarray, order: int) -> Polynomial:
    """Polynomial of an order that gives angles (n,) of currents (n,), relative or not, best (4.7).

    Raises:
        ValueError: Fewer samples than coefficients.
    """
    if len(relative) <= order:
        raise ValueError(f"{len(relative)} samples cannot determine {order + 1} coefficients")
    return Polynomial.fit(relative, angle, order)


def curvatures(angles: ndarray, length: float, first: float) -> ndarray:
    """Curvatures (n + 1,) [1/m] of segments of `length` [m] from joints' angles (n,) [rad].

    Corrected (4.5). The error of the first curvature does not decay along the sensor, it
    alternates: use it where that is known.
    """
    kappa = [first]
    for angle in angles:
        kappa.append(2 * angle / length - kappa[-1])
    return np.array(kappa)


class Calibration(NamedTuple):
    """Polynomials of many sensors; what lies beyond the readings they know goes on straight.

    Attributes:
        low, high: (...) readings that are 0 and 100 %.
        coefficients: (order + 1, ...) [rad], in relative currents between -1 and 1.
    """

    low: ndarray
    high: ndarray
    coefficients: ndarray

    @classmethod
    def fitted(cls, readings: ndarray, angles: ndarray, order: int = 5) -> "Calibration":
        """From readings (t, ...) and angles (t, ...) [rad], each sensor by itself.

        Raises:
            ValueError: Fewer samples than coefficients.
        """
        flat, shape = readings.reshape(len(readings), -1), readings.shape[1:]
        pairs = zip(flat.T, angles.reshape(flat.shape).T, strict=True)
        coefficients = np.stack([fit(x, angle, order).coef for x, angle in pairs], axis=1)
        ends = readings.min(axis=0), readings.max(axis=0)
        return cls(*ends, coefficients.reshape(-1, *shape))

    def __call__(self, readings: ndarray) -> ndarray:
        """Angles (..., sensors) [rad]."""
        x = 2 * (readings - self.low) / (self.high - self.low) - 1
        inside = np.clip(x, -1.0, 1.0)
        value, slope = np.zeros_like(x), np.zeros_like(x)
        for coefficient in self.coefficients[::-1]:
            slope = slope * inside + value
            value = value * inside + coefficient
        return value + slope * (x - inside)
