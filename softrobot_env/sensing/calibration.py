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
    """Polynomial of an order that gives angles (n,) of relative currents (n,) best (4.7).

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


def mean_curvature(angle: float, segments: int, length: float) -> float:
    """Curvature [1/m] of a sensor of segments of `length` [m], if it is constant, by (4.2)."""
    return angle / ((segments - 1) * length)


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
        flat = readings.reshape(len(readings), -1)
        ranges = [Range.of(x) for x in flat.T]
        fits = [
            fit(reach.relative(x), angle, order)
            for reach, x, angle in zip(ranges, flat.T, angles.reshape(flat.shape).T, strict=True)
        ]
        shape = readings.shape[1:]
        low, high = np.array(ranges).T
        coefficients = np.stack([found.coef for found in fits], axis=1)
        return cls(low.reshape(shape), high.reshape(shape), coefficients.reshape(-1, *shape))

    def __call__(self, readings: ndarray) -> ndarray:
        """Angles (..., sensors) [rad]."""
        x = 2 * (readings - self.low) / (self.high - self.low) - 1
        inside = np.clip(x, -1.0, 1.0)
        value, slope = np.zeros_like(x), np.zeros_like(x)
        for coefficient in self.coefficients[::-1]:
            slope = slope * inside + value
            value = value * inside + coefficient
        return value + slope * (x - inside)
