"""The largest gains of P and PI feedback of a late tip around statics, by the first mode."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from softrobot_env.benchmarks.feedback.rigs import LATE
from softrobot_env.benchmarks.records import Record
from softrobot_env.control.feedforward.statics import ChainStatics
from softrobot_env.robots import EQUIVALENT_RIG

#: [s] between two decisions.
_PERIOD = 0.02

#: Ratio of the gains K_I / K_P [1/s] of the thesis' (0.2, 1), and the gains for which it tells what
#: happens.
_RATIO, TOLD = 5.0, ((0.2, 1.0), (0.3, 2.0))


@dataclass(frozen=True)
class GainRow(Record):
    """A pair of gains.

    Attributes:
        proportional: K_P [1].
        integral: K_I [1/s].
        radius: Largest magnitude of the loop's eigenvalues, for a control period [1]; above 1 it is
            unstable.
        decay: [s], time in which what rings longest falls to 1 / e; None if it does not.
        limit: Whether these are the largest stable gains of the thesis' ratio.
    """

    proportional: float
    integral: float
    radius: float
    decay: float | None
    limit: bool


def gain_rows() -> list[GainRow]:
    """The thesis' gains, and the largest stable ones in the same ratio."""
    rows = [_row(*gains, False) for gains in TOLD]
    least, most = 0.0, 10.0
    for _ in range(50):
        middle = (least + most) / 2
        stable = _spectral_radius(middle, _RATIO * middle) < 1
        least, most = (middle, most) if stable else (least, middle)
    return [*rows, _row(least, _RATIO * least, True)]


def left(proportional: float, integral: float, rate: float) -> float:
    """Share [1] that feedback leaves of an error that turns with a `rate` [rad/s], in the long run.

    By the first mode alone, as `gain_rows`; held actions act half a period late.
    """
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    if rate == 0:
        return 1 / (1 + proportional) if integral == 0 else 0.0
    s = 1j * rate
    plant = 1 / (1 + damping_time * s + (s / frequency) ** 2)
    late = np.exp(-s * (LATE + _PERIOD / 2))
    return float(abs(1 / (1 + (proportional + integral / s) * plant * late)))


def _row(proportional: float, integral: float, limit: bool) -> GainRow:
    radius = _spectral_radius(proportional, integral)
    decay = -_PERIOD / np.log(radius) if radius < 1 and not limit else None
    return GainRow(proportional, integral, radius, decay, limit)


def _spectral_radius(proportional: float, integral: float) -> float:
    """Of the states place, rate, places on the way to the controller, integral."""
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    period, late = _PERIOD, round(LATE / _PERIOD)
    square = frequency**2
    rates = np.array([[0, 1, 0], [-square, -damping_time * square, square], [0, 0, 0]])
    held = expm(period * rates)
    n = 3 + late
    loop = np.zeros((n, n))
    seen, total = 1 + late, n - 1
    loop[:2, :2] = held[:2, :2]
    loop[2, 0] = 1.0
    loop[3 : 2 + late, 2 : 1 + late] = np.eye(late - 1)
    loop[total, total], loop[total, seen] = 1.0, -period
    change = np.zeros(n)
    change[seen] = -proportional - integral * period
    change[total] = integral
    loop[:2] += np.outer(held[:2, 2], change)
    return float(np.abs(np.linalg.eigvals(loop)).max())
