"""Closed forms and exact solutions of a uniform cantilever, without any mesh.

Frame as in `softrobot_env.robots`: the straight rod lies along +z from its clamp at the origin,
bends in the x-z plane, and a positive moment or curvature bends it towards +x. Forces and points
in the plane are pairs (x, z). All quantities are in SI units.
"""

from dataclasses import dataclass
from math import cos, cosh, pi
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.optimize import brentq

from softrobot_env.robots import RobotParams
from studies.truths.shooting import grown, integral

_NODES = 201


def euler_bernoulli_deflection(
    length: float,
    bending_stiffness: float,
    distributed: float = 0.0,
    force: float = 0.0,
    moment: float = 0.0,
) -> float:
    """Small tip deflection [m] of a beam that only bends.

    w = q L^4 / (8 EI) + F L^3 / (3 EI) + M L^2 / (2 EI) (Timoshenko, Strength of Materials).

    Args:
        length: L [m].
        bending_stiffness: EI [N m2].
        distributed: Uniform lateral load q [N/m].
        force: Lateral tip force F [N].
        moment: Tip moment M [N m].
    """
    sum_ = distributed * length**4 / 8 + force * length**3 / 3 + moment * length**2 / 2
    return sum_ / bending_stiffness


def timoshenko_deflection(
    length: float, bending_stiffness: float, shear_stiffness: float, distributed: float
) -> float:
    """As `euler_bernoulli_deflection`, of a beam that also shears: q L^2 / (2 kGA) more.

    Args:
        length, bending_stiffness, distributed: As there.
        shear_stiffness: kGA [N], k being the shear coefficient.
    """
    bending = euler_bernoulli_deflection(length, bending_stiffness, distributed)
    return bending + distributed * length**2 / 2 / shear_stiffness


def clamped_free_root(n: int) -> float:
    """n-th positive root x [1] of cos(x) cosh(x) = -1, n = 1, 2, ...

    The roots lie close to (n - 1/2) pi; dividing by cosh(x) keeps the function of order one.
    """
    if n < 1:
        raise ValueError(f"modes are counted from 1, got {n}")
    middle = (n - 0.5) * pi
    return brentq(lambda x: cos(x) + 1 / cosh(x), middle - pi / 4, middle + pi / 4, xtol=1e-14)


def euler_bernoulli_frequency(
    length: float, bending_stiffness: float, mass_per_length: float, n: int = 1
) -> float:
    """n-th bending frequency [Hz], (x_n / L)^2 sqrt(EI / rho A) / (2 pi), thesis (2.75).

    Args:
        length: L [m].
        bending_stiffness: EI [N m2].
        mass_per_length: rho A [kg/m].
        n: Mode, from 1.
    """
    wave = (clamped_free_root(n) / length) ** 2
    return float(wave * np.sqrt(bending_stiffness / mass_per_length) / (2 * pi))


def torsion_angle(robot: RobotParams, moment: float) -> float:
    """Twist [rad] of the tip under a moment [N m], thesis (2.77)."""
    return moment * robot.length / robot.torsional_stiffness


def torsion_frequency(robot: RobotParams) -> float:
    """First torsional frequency [Hz] of a clamped-free shaft: sqrt(GJ / 2 rho I) / (4 L)."""
    polar = 2 * robot.density * robot.second_moment
    return float(np.sqrt(robot.torsional_stiffness / polar) / (4 * robot.length))


def arc_tip(length: float, curvature: float) -> ndarray:
    """Tip (2,) [m] in (x, z) of a circular arc: (1 - cos kL, sin kL) / k, smooth at k = 0.

    An inextensible rod under a pure tip moment M is such an arc with k = M / EI.

    Args:
        length: L [m].
        curvature: k [1/m].
    """
    half = curvature * length / 2
    return length * np.sinc(half / pi) * np.array([np.sin(half), np.cos(half)])


@dataclass(frozen=True)
class Section:
    """Stiffness of a cross-section.

    Attributes:
        bending: EI [N m2].
        shear: k G A [N], infinite without shear.
        axial: EA [N], infinite without extension.
        torsion: GJ [N m2], zero where it does not count.
    """

    bending: float
    shear: float = np.inf
    axial: float = np.inf
    torsion: float = 0.0


def section(robot: RobotParams, shear_coefficient: float | None) -> Section:
    """Section of a robot; None for the shear coefficient k leaves out shear and extension."""
    torsion = robot.torsional_stiffness
    if shear_coefficient is None:
        return Section(robot.bending_stiffness, torsion=torsion)
    shear_modulus = robot.youngs_modulus / (2 * (1 + robot.poisson_ratio))
    shear = shear_coefficient * shear_modulus * robot.area
    return Section(robot.bending_stiffness, shear, robot.youngs_modulus * robot.area, torsion)


def section_slope(angle: ndarray, force: ndarray, rod: Section) -> ndarray:
    """r' (2, ...) [1] at section angles (...) [rad] under internal forces (2, ...) [N]."""
    sin, cos = np.sin(angle), np.cos(angle)
    shear = (force[0] * cos - force[1] * sin) / rod.shear
    stretch = 1 + (force[0] * sin + force[1] * cos) / rod.axial
    return np.stack([stretch * sin + shear * cos, stretch * cos - shear * sin])


def planar_slope(y: ndarray, force: ndarray, rod: Section) -> ndarray:
    """Derivative (4,) of x, z, angle and moment along a rod with an internal force (2,) [N]."""
    x, z = section_slope(y[2], force, rod)
    return np.array([x, z, y[3] / rod.bending, force[1] * x - force[0] * z])


@dataclass(frozen=True)
class RodShape:
    """Shape of a planar rod.

    Attributes:
        station: (k,) [m], arc length of the straight rod.
        angle: (k,) [rad] of the section from +z towards +x.
        curvature: (k,) [1/m].
        position: (k, 2) [m], (x, z).
    """

    station: ndarray
    angle: ndarray
    curvature: ndarray
    position: ndarray

    @property
    def tip(self) -> ndarray:
        """(2,) [m], (x, z)."""
        return self.position[-1]


def bent_rod(
    length: float,
    rod: Section,
    weight: tuple[float, float] = (0.0, 0.0),
    force: tuple[float, float] = (0.0, 0.0),
    moment: float = 0.0,
    load_steps: int = 5,
) -> RodShape:
    """Equilibrium of a clamped rod under dead loads, however large its rotations.

    Geometrically exact (Reissner 1972, Simo 1985): the section at s is turned by t(s) towards +x.
    With its directions d1 = (cos t, -sin t) and d3 = (sin t, cos t) and the internal force
    N(s) = q (L - s) + F,

        r' = (1 + N.d3 / EA) d3 + (N.d1 / kGA) d1,    EI t'' = -(N_x z' - N_z x').

    Solved by shooting from the tip, whose angle is unknown.

    Args:
        length: L [m].
        rod: The section; without shear and extension the rod is an elastica.
        weight: q = (q_x, q_z) [N/m], load per length.
        force: F = (F_x, F_z) [N] at the tip.
        moment: [N m] at the tip, positive towards +x.
        load_steps: Number of load steps.

    Raises:
        EquilibriumError: No solution was found.
    """
    q, f = np.array(weight), np.array(force)

    def toward_clamp(angle: ndarray, share: float, stations: ndarray | None = None) -> ndarray:
        """(x, z, angle, moment) by the angle of the tip, where x and z are zero."""

        def slope(s: float, y: ndarray) -> ndarray:
            return planar_slope(y, share * (q * (length - s) + f), rod)

        tip = [0.0, 0.0, angle[0], share * moment]
        return integral(slope, (length, 0.0), tip, stations)

    def missing(angle: ndarray, share: float) -> ndarray:
        return toward_clamp(angle, share)[2:3]

    tip = grown(missing, np.zeros(1), "a bent rod", load_steps)
    s = np.linspace(0, length, _NODES)
    x, z, angle, carried = toward_clamp(tip, 1.0, s[::-1])[:, ::-1]
    return RodShape(s, angle, carried / rod.bending, np.stack([x - x[0], z - z[0]], axis=1))


def elastica(length: float, bending_stiffness: float, **loads: Any) -> RodShape:
    """As `bent_rod`, with the same loads, of a rod that neither shears nor stretches."""
    return bent_rod(length, Section(bending_stiffness), **loads)
