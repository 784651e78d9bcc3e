"""Small vibrations of a straight beam of several or tapered sections, with discs and a tip mass."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from softrobot_env.robots import RobotParams


def bending_frequencies(robot: RobotParams, n: int = 1) -> np.ndarray:
    """First n undamped bending frequencies (n,) [Hz] of the clamped robot, without gravity.

    Euler and Bernoulli's beam with the rotary inertia of its sections (Rayleigh): deflection w,
    slope p, moment M and shear force Q of a harmonic motion at the rate o obey

        w' = p,   p' = M / EI,   M' = -Q - o^2 rho I p,   Q' = -o^2 rho A w,

    a disc of mass m and inertia J adds -o^2 J p to M and -o^2 m w to Q beyond it. The frequencies
    are the zeros of the determinant that M = Q = 0 at the tip lead to, found by shooting.
    """
    found, high, step = [], 0.0, _scale(robot) / 4
    before = _determinant(robot, step / 10)
    low = step / 10
    while len(found) < n:
        high = low + step
        value = _determinant(robot, high)
        if value * before < 0:
            root = brentq(lambda o: _determinant(robot, o), low, high, rtol=1e-11)
            found.append(root / (2 * np.pi))
        low, before = high, value
    return np.array(found)


def _scale(robot: RobotParams) -> float:
    """Angular frequency [rad/s] of the order of the first one."""
    stiffness = robot.backbone.bending(np.array([robot.length / 2]))[0]
    return float(np.sqrt(stiffness / (robot.mass * robot.length**3)))


def _determinant(robot: RobotParams, rate: float) -> float:
    backbone, discs = robot.backbone, robot.discs
    edges = np.unique(np.concatenate([backbone.ends, [disc.station for disc in discs]]))
    y = np.zeros((4, 2))
    y[2, 0], y[3, 1] = 1.0, 1.0 / robot.length
    square = rate**2

    def slope(s: float, flat: np.ndarray) -> np.ndarray:
        at = np.array([min(max(s, low), high)])
        w, p, moment, force = flat.reshape(4, 2)
        return np.concatenate(
            [
                p,
                moment / backbone.bending(at)[0],
                -force - square * backbone.rotary(at)[0] * p,
                -square * backbone.mass(at)[0] * w,
            ]
        )

    for start, end in pairwise(edges):
        margin = 1e-12 * (end - start)
        low, high = start + margin, end - margin
        flat = solve_ivp(slope, (start, end), y.ravel(), "DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
        y = flat.reshape(4, 2)
        for disc in discs:
            if disc.station == end:
                y[2] -= square * disc.inertia[1] * y[1]
                y[3] -= square * disc.mass * y[0]
    return float(np.linalg.det(y[2:]))
