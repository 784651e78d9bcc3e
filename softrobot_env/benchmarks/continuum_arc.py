"""Uniform bending of a St. Venant-Kirchhoff continuum, the material of the ANCF model, exactly.

Under an axial force and a moment that do not change along the rod, every fibre at distance x
from the axis is stretched by l = s + k x, with stretch s and curvature k per reference length, and
carries E (l^2 - 1) / 2 l per reference area (Poisson ratio 0). In the section the powers of x
integrate to A, I and the fourth moment.
"""

from math import pi

import numpy as np
from scipy.optimize import fsolve

from softrobot_env.beams.analytic import arc_tip
from softrobot_env.robots import RobotParams

#: What the truth is called in a report.
TEXT = "arc of a St. Venant-Kirchhoff continuum (exact)"


def continuum_arc(robot: RobotParams, force: float, moment: float) -> tuple[float, float]:
    """Stretch [1] and curvature per reference length [1/m] under force [N] and moment [N m].

    Raises:
        ValueError: No equilibrium was found near the linear one.
    """
    area, second = robot.area, robot.second_moment
    fourth = pi / 8 * (robot.outer_radius**6 - robot.inner_radius**6)
    modulus = robot.youngs_modulus

    def balance(x: np.ndarray) -> list[float]:
        s, k = x[0], x[1] / robot.length
        axial = area * s * (s**2 - 1) / 2 + 1.5 * second * s * k**2
        bending = second * k * (3 * s**2 - 1) / 2 + fourth * k**3 / 2
        unit = modulus * second / robot.length
        return [
            (modulus * axial - force) * robot.length / unit,
            (modulus * bending - moment) / unit,
        ]

    linear = moment / robot.bending_stiffness * robot.length
    start = np.array([1 + force / (modulus * area), linear])
    x, _, status, message = fsolve(balance, start, xtol=1e-12, full_output=True)
    if status != 1:
        raise ValueError(f"no uniform bending of the continuum was found: {message}")
    return float(x[0]), float(x[1] / robot.length)


def continuum_arc_tip(robot: RobotParams, force: float, moment: float) -> np.ndarray:
    """Tip (2,) [m] in (x, z) of the whole robot bent uniformly."""
    stretch, curvature = continuum_arc(robot, force, moment)
    return stretch * arc_tip(robot.length, curvature)
