"""Planar geometrically exact rods of a robot: its section, its tendons and its frequencies.

Frame and equations as in `truths.analytic`: the straight rod lies along +z from its clamp and bends
in the x-z plane; points and forces are pairs (x, z).
"""

from itertools import pairwise
from math import pi

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, root

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots import RobotParams
from studies.truths.analytic import Section, euler_bernoulli_frequency, section_slope


def section(robot: RobotParams, shear_coefficient: float | None) -> Section:
    """Section of a robot; None for the shear coefficient k leaves out shear and extension."""
    torsion = robot.torsional_stiffness
    if shear_coefficient is None:
        return Section(robot.bending_stiffness, torsion=torsion)
    shear_modulus = robot.youngs_modulus / (2 * (1 + robot.poisson_ratio))
    shear = shear_coefficient * shear_modulus * robot.area
    return Section(robot.bending_stiffness, shear, robot.youngs_modulus * robot.area, torsion)


def tendon_tip(robot: RobotParams, rod: Section, tension: ndarray) -> ndarray:
    """Tip (2,) [m] of a weightless robot under tensions (n_tendons,) [N].

    In channels a tension T at distance x bends by T x / EI and shortens by T / EA everywhere up
    to the tendon's end, without shear: rod and tendon are in balance at every section.

    Between guides a tendon is straight. All forces on a section balance, so the rod carries minus
    the tensions, and its moment is theirs about the section; the pose of the next guides follows
    from that of the last by a boundary-value problem in three unknowns.

    Raises:
        EquilibriumError: The pose of a guide was not found.
        ValueError: Some tendons have guides, others none, or not the same ones.
    """
    if not any(t.guides for t in robot.tendons):
        return _channel_tip(robot, rod, tension)
    routes = [(0.0, *t.guides, t.end) for t in robot.tendons]
    stations = max(routes, key=len)
    if any(not np.allclose(route, stations[: len(route)]) for route in routes):
        raise ValueError("tendons need the same guides, each up to its own end")
    pose = np.zeros(3)
    offsets = np.array([t.offset[0] for t in robot.tendons])
    for index, (start, end) in enumerate(pairwise(stations)):
        active = np.array([len(route) > index + 1 for route in routes])
        pose = _next_guides(pose, end - start, rod, offsets[active], np.asarray(tension)[active])
    rest = robot.length - stations[-1]
    return pose[:2] + rest * np.array([np.sin(pose[2]), np.cos(pose[2])])


def _channel_tip(robot: RobotParams, rod: Section, tension: ndarray) -> ndarray:
    edges = np.unique([0.0, *(t.end for t in robot.tendons), robot.length])
    angle, tip = 0.0, np.zeros(2)
    for start, end in pairwise(edges):
        active = [(t.offset[0], f) for t, f in zip(robot.tendons, tension, strict=True)]
        active = [a for a, t in zip(active, robot.tendons, strict=True) if t.end > start]
        turn = (end - start) * sum(x * f for x, f in active) / rod.bending
        stretch = 1 - sum(f for _, f in active) / rod.axial
        middle = angle + turn / 2
        chord = stretch * (end - start) * np.sinc(turn / 2 / pi)
        tip = tip + chord * np.array([np.sin(middle), np.cos(middle)])
        angle += turn
    return tip


def _next_guides(
    pose: ndarray, span: float, rod: Section, offsets: ndarray, tension: ndarray
) -> ndarray:
    """Pose (x, z, t) of the next guides, `span` [m] of rod further on."""
    first = _across(pose, offsets)

    def integrate(guess: ndarray) -> ndarray:
        chord = _across(guess, offsets) - first
        pull = tension[:, None] * chord / np.linalg.norm(chord, axis=1)[:, None]
        force = -pull.sum(axis=0)

        def derivative(_: float, y: ndarray) -> ndarray:
            arm = first - y[:2]
            moment = -np.sum(arm[:, 1] * pull[:, 0] - arm[:, 0] * pull[:, 1])
            return np.array([*section_slope(y[2], force, rod), moment / rod.bending])

        return solve_ivp(derivative, (0, span), pose, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]

    guess = pose + span * np.array([np.sin(pose[2]), np.cos(pose[2]), 0.0])
    found = root(lambda x: integrate(x) - x, integrate(guess), tol=1e-12)
    if np.max(np.abs(found.fun)) > 1e-10:
        raise EquilibriumError(f"no pose of the next guides: {found.message}")
    return found.x


def _across(pose: ndarray, offsets: ndarray) -> ndarray:
    """Points (k, 2) at distances (k,) from the centreline in the section of a pose."""
    return pose[:2] + offsets[:, None] * np.array([np.cos(pose[2]), -np.sin(pose[2])])


def bending_frequency(robot: RobotParams, shear_coefficient: float | None) -> float:
    """First bending frequency [Hz] of the weightless cantilever with rotary inertia.

    The deflection w, section angle p, moment M and shear force Q of a harmonic motion obey
    w' = p + Q / kGA, p' = M / EI, M' = -Q - o^2 rho I p, Q' = -o^2 rho A w (Timoshenko 1921);
    the frequency o is a root of the determinant that M = Q = 0 at the tip leads to.
    """
    rod = section(robot, shear_coefficient)
    beam = robot.length, robot.bending_stiffness, robot.mass_per_length
    slender = 2 * pi * euler_bernoulli_frequency(*beam)
    rotary = robot.density * robot.second_moment

    def determinant(omega: float) -> float:
        change = np.zeros((4, 4))
        change[0, 1], change[0, 3] = 1, 1 / rod.shear
        change[1, 2] = 1 / rod.bending
        change[2, 1], change[2, 3] = -(omega**2) * rotary, -1
        change[3, 0] = -(omega**2) * robot.mass_per_length
        return float(np.linalg.det(expm(change * robot.length)[2:, 2:]))

    return brentq(determinant, 1e-3 * slender, slender * (1 + 1e-9), rtol=1e-12) / (2 * pi)


def torsion_angle(robot: RobotParams, moment: float) -> float:
    """Twist [rad] of the tip under a moment [N m], thesis (2.77)."""
    return moment * robot.length / robot.torsional_stiffness


def torsion_frequency(robot: RobotParams) -> float:
    """First torsional frequency [Hz] of a clamped-free shaft: sqrt(GJ / 2 rho I) / (4 L)."""
    polar = 2 * robot.density * robot.second_moment
    return float(np.sqrt(robot.torsional_stiffness / polar) / (4 * robot.length))
