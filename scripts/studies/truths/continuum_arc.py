"""Uniform bending of a St. Venant-Kirchhoff continuum, the material of the ANCF model, exactly.

Where forces and moments do not change along the rod, a section keeps its stretch s, its curvature
k per reference length and the width w of its fibre pattern (the length of its director), and the
Green strains are (l^2 - 1) / 2 along a fibre at distance x, l = s + k w x, and (w^2 - 1) / 2
across. With Poisson ratio 0 the energy per length is E / 2 times the integral of their squares; in
it the powers of x integrate to the area, the second and the fourth moment of the section.
"""

from math import pi

import numpy as np
from numpy import ndarray
from scipy.optimize import fsolve

from softrobot_env.robots import RobotParams
from studies.truths.analytic import arc_tip

#: What the truth is called in a report.
TEXT = "arc of a St. Venant-Kirchhoff continuum (exact)"


def continuum_arc(
    robot: RobotParams, moment: float = 0.0, tension: float = 0.0, offset: float = 0.0
) -> tuple[float, float]:
    """Stretch [1] and curvature per reference length [1/m] in equilibrium.

    Args:
        robot: The robot; its Poisson ratio is taken as 0.
        moment: Moment [N m] on the end, positive towards +x.
        tension: Tension [N] in a channel.
        offset: Place x [m] of the channel in the section.

    Raises:
        ValueError: No equilibrium was found near the linear one.
    """
    modulus, area, second = robot.youngs_modulus, robot.area, robot.second_moment
    fourth = pi / 8 * (robot.outer_radius**6 - robot.inner_radius**6)
    force, torque = modulus * area, modulus * second / robot.length

    def balance(x: ndarray) -> list[float]:
        s, k, w = x[0], x[1] / robot.length, x[2]
        c = k * w
        axial = modulus * (area * s * (s**2 - 1) / 2 + 1.5 * second * s * c**2)
        bending = modulus * (second * c * (3 * s**2 - 1) / 2 + fourth * c**3 / 2)
        pulled = bending - tension * offset  # what the tendon leaves to the end's moment
        across = modulus * area * w * (w**2 - 1) / 2
        return [
            (axial + tension) / force,
            (pulled * w - moment) / torque,
            (pulled * k + across) / force,
        ]

    bend = (moment + tension * offset) / robot.bending_stiffness * robot.length
    start = np.array([1 - tension / force, bend, 1.0])
    x, _, status, message = fsolve(balance, start, xtol=1e-12, full_output=True)
    if status != 1:
        raise ValueError(f"no uniform bending of the continuum was found: {message}")
    return float(x[0]), float(x[1] / robot.length)


def continuum_arc_tip(
    robot: RobotParams, moment: float = 0.0, tension: float = 0.0, offset: float = 0.0
) -> ndarray:
    """Tip (2,) [m] in (x, z) of the whole robot, loaded as in `continuum_arc`."""
    stretch, curvature = continuum_arc(robot, moment, tension, offset)
    return stretch * arc_tip(robot.length, curvature)
