"""Inputs over time, as polynomials between equally spaced instants."""

from collections.abc import Callable
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure


@structure
class Signal(NamedTuple):
    """Inputs u(t); before the start and after the end the nearest value holds.

    Attributes:
        start, step: [s], first instant and distance of the instants.
        coefficients: (intervals, order + 1, n_inputs), from the constant term up, in powers of
            the time [s] since the interval's beginning.
    """

    start: float
    step: float
    coefficients: ndarray


def constant(values: ndarray) -> Signal:
    """Inputs (n_inputs,) that never change."""
    return Signal(0.0, 1.0, np.array(values, float).reshape(1, 1, -1))


def held(values: ndarray, period: float) -> Signal:
    """Row i of values (k, n_inputs) from i * period on (zero-order hold)."""
    return Signal(0.0, float(period), np.array(values, float)[:, None, :])


def smooth(function: Callable[[float], ndarray], duration: float, step: float = 2e-3) -> Signal:
    """Cubic spline through a smooth function of time, from 0 to the duration [s].

    Its error is of fourth order in the step: for 2 ms about 1e-9 of the amplitude of an
    oscillation at 10 rad/s.
    """
    from scipy.interpolate import CubicSpline

    count = max(3, ceil(duration / step - 1e-9))
    times = np.linspace(0, duration, count + 1)
    values = np.array([np.atleast_1d(function(t)) for t in times], float)
    spline = CubicSpline(times, values)
    coefficients = np.ascontiguousarray(spline.c[::-1].transpose(1, 0, 2))
    return Signal(0.0, duration / count, coefficients)


@kernel
def evaluate(signal, t, out):
    """Set out (n_inputs,) to the inputs at time t [s]."""
    intervals, terms = signal.coefficients.shape[0], signal.coefficients.shape[1]
    place = (t - signal.start) / signal.step
    # The smallest shift lets an instant that rounding puts just before an interval fall into it.
    interval = min(max(int(np.floor(place + 1e-9)), 0), intervals - 1)
    since = (min(max(place, 0.0), float(intervals)) - interval) * signal.step
    for j in range(len(out)):
        value = signal.coefficients[interval, terms - 1, j]
        for k in range(terms - 2, -1, -1):
            value = value * since + signal.coefficients[interval, k, j]
        out[j] = value
