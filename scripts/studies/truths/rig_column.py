"""Equilibria of the rig without any mesh: a column under its weight and a heavy head.

The rig is alike on all sides and its tendons pull with constant moments, so it bends in one plane,
towards the azimuth p. In that plane, with the weight W(s) of everything above s, the force on the
section at angle t is (0, -W), less the tendons' tensions F along its axis; with x towards p,

    r' = (stretch, shear) as in `truths.analytic`,   EI t' = m,   m' = -W x',
    m(L) = sum F_k r_k . (cos p, sin p) + W_head h sin t(L).

Three numbers are unknown: the components of the end's bending vector t(L) (cos p, sin p), and how
much the fibre is shortened, which together give the tensions. They are right where t(0) = 0, where
the tendons pull towards p, and where the shortening is what the forces cause.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams
from studies.truths.analytic import Section, section, section_slope
from studies.truths.shooting import grown, integral

_GUESS = 0.3  # rad


def tensions(
    robot: RobotParams, pulled: ndarray, bend: ndarray, shortening: float = 0.0
) -> ndarray:
    """Tensions (3,) [N] of elastic tendons in channels; slack ones have none.

    Args:
        robot: The robot; its tendons end at its tip.
        pulled: (3,) [m].
        bend: (2,) [rad], angle of the end towards x and y.
        shortening: [m], how much the neutral fibre is compressed.
    """
    tendons = robot.tendons
    taut = pulled - np.array([t.offset for t in tendons]) @ bend - shortening
    force = np.array([t.pretension for t in tendons])
    force = force + np.array([t.stiffness for t in tendons]) * taut
    return np.clip(force, 0.0, [t.tension_limit for t in tendons])


def column_tip(robot: RobotParams, pulled: ndarray, shear_coefficient: float | None) -> ndarray:
    """Output point (3,) [m] with lengths (3,) [m] pulled in, reached from the straight pose.

    Args:
        robot: An upright robot with a head and elastic tendons in channels up to its end.
        pulled: Lengths.
        shear_coefficient: k [1] of the shear stiffness; None leaves out shear and extension.

    Raises:
        EquilibriumError: No equilibrium was found.
        ValueError: The lengths pull to no side.
    """
    rod = section(robot, shear_coefficient)
    toward = np.asarray(pulled) @ robot.of_tendons("offset")
    if not np.any(toward):
        raise ValueError(f"lengths {pulled} m pull to no side: the rig stays straight")
    guess = np.array([*(_GUESS * toward / np.hypot(*toward)), 0.0])
    lengths = np.asarray(pulled)

    def missing(x: ndarray, share: float) -> ndarray:
        return _missing(robot, rod, share * lengths, x)

    unknown = grown(missing, guess, f"the rig at {pulled} m")
    bend = unknown[:2]
    angle = float(np.hypot(*bend))
    base, _ = _base(robot, rod, lengths, unknown)
    aside = robot.head.output * np.sin(angle) - base[2]
    return np.array([*(aside * bend / angle), robot.head.output * np.cos(angle) - base[3]])


def _missing(robot: RobotParams, rod: Section, pulled: ndarray, unknown: ndarray) -> ndarray:
    """Errors (3,) [1]: angle at the base, curvature across the bend, shortening per length."""
    base, across = _base(robot, rod, pulled, unknown)
    length = robot.length
    return np.array(
        [base[0], across / robot.bending_stiffness * length, (base[4] - unknown[2]) / length]
    )


def _base(
    robot: RobotParams, rod: Section, pulled: ndarray, unknown: ndarray
) -> tuple[ndarray, float]:
    """What `_toward_base` finds, and the moment [N m] of the tendons across the bend."""
    bend, angle = unknown[:2], float(np.hypot(*unknown[:2]))
    force = tensions(robot, pulled, bend, unknown[2])
    x, y = force @ robot.of_tendons("offset")
    along, across = (x * bend[0] + y * bend[1]) / angle, (x * bend[1] - y * bend[0]) / angle
    return _toward_base(robot, rod, angle, float(along), float(force.sum())), float(across)


def _toward_base(
    robot: RobotParams, rod: Section, angle: float, moment: float, pull: float
) -> ndarray:
    """Section angle, moment, x, z and shortening (5,) at the base, from those at the end."""
    gravity = -robot.gravity[2]
    head, per_length = robot.head.mass * gravity, robot.mass_per_length * gravity

    def slope(s: float, y: ndarray) -> ndarray:
        weight = head + per_length * (robot.length - s)
        axis = np.array([np.sin(y[0]), np.cos(y[0])])
        along = section_slope(y[0], np.array([0.0, -weight]) - pull * axis, rod)
        return np.array([y[1] / rod.bending, -weight * along[0], *along, axis @ along - 1])

    top = [angle, moment + head * robot.head.centre * np.sin(angle), 0.0, 0.0, 0.0]
    return integral(slope, (robot.length, 0.0), top)
