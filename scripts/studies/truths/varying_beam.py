"""Small vibrations of a straight beam of several or tapered sections, with discs and a tip mass."""

from functools import reduce
from itertools import pairwise

import numpy as np
from numpy import ndarray
from scipy.optimize import brentq

from softrobot_env.robots import RobotParams

#: Steps of Runge and Kutta's method between two ends of sections or discs.
_STEPS = 200


def bending_frequencies(robot: RobotParams, n: int = 1, shear: float | None = None) -> ndarray:
    """First n undamped bending frequencies (n,) [Hz] of the clamped robot, without gravity.

    Deflection w, angle p of the sections, moment M and shear force Q of a harmonic motion at the
    rate o obey (Timoshenko 1921)

        w' = p + Q / kGA,   p' = M / EI,   M' = -Q - o^2 rho I p,   Q' = -o^2 rho A w,

    a disc of mass m and inertia J adds -o^2 J p to M and -o^2 m w to Q beyond it. The frequencies
    are the zeros of the determinant that M = Q = 0 at the tip lead to, found by shooting.

    Args:
        robot: The robot.
        n: How many.
        shear: k of the shear stiffness k G A; None for a beam that does not shear (Rayleigh).
    """
    beam = _Beam(robot, shear)
    step = beam.scale / 4
    low, found = step / 10, []
    before = beam.determinant(low)
    while len(found) < n:
        high = low + step
        value = beam.determinant(high)
        if value * before < 0:
            found.append(brentq(beam.determinant, low, high, rtol=1e-12) / (2 * np.pi))
        low, before = high, value
    return np.array(found)


class _Beam:
    """A robot on a grid.

    Attributes:
        scale: Angular frequency [rad/s] of the order of the first one.
    """

    def __init__(self, robot: RobotParams, shear: float | None) -> None:
        backbone, self._length = robot.backbone, robot.length
        edges = np.unique([*backbone.ends, *(disc.station for disc in robot.discs)])
        middle = backbone.bending(np.array([robot.length / 2]))[0]
        self.scale = float(np.sqrt(middle / (robot.mass * robot.length**3)))
        self._spans = []
        for start, end in pairwise(edges):
            margin = 1e-12 * (end - start)  # properties jump at the ends
            s = np.linspace(start + margin, end - margin, 2 * _STEPS + 1)
            sheared = 0 * s if shear is None else 1 / (shear * backbone.shear(s))
            values = sheared, backbone.bending(s), backbone.rotary(s), backbone.mass(s)
            discs = [disc for disc in robot.discs if disc.station == end]
            self._spans.append(((end - start) / _STEPS, values, discs))

    def determinant(self, rate: float) -> float:
        """Of moment and force at the tip by those at the clamp, at a rate [rad/s]."""
        y = np.zeros((4, 2))
        y[2, 0], y[3, 1] = 1.0, 1.0 / self._length
        for h, values, discs in self._spans:
            y = reduce(lambda y, step: step @ y, _steps(h, *values, rate**2), y)
            for disc in discs:
                y[2] -= rate**2 * disc.inertia[1] * y[1]
                y[3] -= rate**2 * disc.mass * y[0]
        return float(np.linalg.det(y[2:]))


def _steps(
    h: float, sheared: ndarray, bending: ndarray, rotary: ndarray, mass: ndarray, square: float
) -> ndarray:
    """Matrices (steps, 4, 4) of Runge and Kutta's steps of size h [m]."""
    slope = np.zeros((len(bending), 4, 4))
    slope[:, 0, 1], slope[:, 1, 2], slope[:, 2, 3] = 1, 1 / bending, -1
    slope[:, 0, 3], slope[:, 2, 1], slope[:, 3, 0] = sheared, -square * rotary, -square * mass
    start, middle, end, one = slope[:-1:2], slope[1::2], slope[2::2], np.eye(4)
    second = middle @ (one + h / 2 * start)
    third = middle @ (one + h / 2 * second)
    last = end @ (one + h * third)
    return one + h / 6 * (start + 2 * second + 2 * third + last)
