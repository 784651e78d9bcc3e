"""Rods pulled by tendons in channels of any route, exactly.

A weightless rod without loads is in balance with its tendons at every cross-section: it carries
minus their tensions. With r(s) = (x, y, 0) the place of a tendon in the section, t its direction,

    n = -sum T t,   m = -sum r x T t,   t along v + kappa x r + r',
    v = e_z + C_n^-1 n,   kappa = C_m^-1 m,

so the strains v and kappa of each section follow from equations of that section alone (Rucker and
Webster, IEEE Trans. Robotics 27, 2011, without what is distributed). All of the rod is then one
initial-value problem from the clamp, for any sections, tapers and ends of tendons.

Of a uniform rod a helical tendon turns at the rate w about e_z from section to section, and so do
the strains: seen from axes that turn with it they are constant, so that the rod is a helix,

    F(s) = exp([kappa(0) + w e_z] s),   x(s) = integral of F v(0).
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from softrobot_env.beams.exact.spatial_rod import SpatialShape
from softrobot_env.robots import RobotParams

_RTOL, _ATOL = 1e-10, 1e-12
_AXIS = np.array([0.0, 0.0, 1.0])


def tendon_rod(
    robot: RobotParams,
    tension: np.ndarray,
    stations: np.ndarray,
    shear_coefficient: float | None = None,
) -> SpatialShape:
    """Shape of a robot under tensions (n_tendons,) [N] of tendons in channels.

    Args:
        robot: The robot; neither its gravity nor its base count.
        tension: (n_tendons,) [N].
        stations: (k,) [m], increasing.
        shear_coefficient: k of the shear stiffness k G A; None for a rod without shear and
            extension.

    Raises:
        ValueError: A tendon has guides.
    """
    _check(robot)
    s = np.asarray(stations, dtype=float)
    breaks = [robot.backbone.ends, *(t.knots[:, 0] for t in robot.tendons), s]
    edges = np.unique(np.concatenate(breaks))
    y, states = np.concatenate([np.zeros(3), [1.0, 0, 0, 0]]), {}

    def slope(at: float, y: np.ndarray) -> np.ndarray:
        inside = min(max(at, low), high)
        return _motion(y, *strains(robot, tension, inside, shear_coefficient))

    states[0.0] = y
    for start, end in pairwise(edges):
        margin = 1e-12 * (end - start)
        low, high = start + margin, end - margin
        y = solve_ivp(slope, (start, end), y, "DOP853", rtol=_RTOL, atol=_ATOL).y[:, -1]
        states[float(end)] = y
    found = np.array([states[float(x)] for x in s])
    frames = Rotation.from_quat(found[:, [4, 5, 6, 3]])
    return SpatialShape(s, found[:, :3], frames.as_matrix())


def tendon_helix(
    robot: RobotParams,
    tension: float,
    stations: np.ndarray,
    shear_coefficient: float | None = None,
) -> SpatialShape:
    """The helix that one helical tendon along all of a uniform robot makes; see the module."""
    _check(robot)
    robot.require_uniform("a helix of one tendon")
    (tendon,) = robot.tendons
    s = np.asarray(stations, dtype=float)
    along, kappa = strains(robot, np.array([tension]), 0.0, shear_coefficient)
    rate = 2 * np.pi * tendon.turns / tendon.end
    screw = kappa + rate * _AXIS
    turned = Rotation.from_rotvec(s[:, None] * screw)
    frames = turned * Rotation.from_rotvec(-rate * s[:, None] * _AXIS)
    return SpatialShape(s, _integral(screw, along, s), frames.as_matrix())


def _integral(rate: np.ndarray, along: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Integrals (k, 3) from 0 to s (k,) of a vector turned at a rate (3,) [rad/m]."""
    speed = np.linalg.norm(rate)
    if speed == 0:
        return s[:, None] * along
    about = rate / speed
    still, side = about * (about @ along), np.cross(about, along)
    around, angle = along - still, (speed * s)[:, None]
    return s[:, None] * still + (np.sin(angle) * around + (1 - np.cos(angle)) * side) / speed


def strains(
    robot: RobotParams, tension: np.ndarray, station: float, shear_coefficient: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Strains v [1] and kappa [1/m], (3,) each, of one cross-section."""
    backbone, s = robot.backbone, np.array([station])
    bending, torsion = backbone.bending(s)[0], backbone.torsion(s)[0]
    soft = np.zeros(3)
    if shear_coefficient is not None:
        shear = shear_coefficient * backbone.shear(s)[0]
        soft = 1 / np.array([shear, shear, backbone.axial(s)[0]])
    active = [k for k, t in enumerate(robot.tendons) if t.end > station]
    pull = np.asarray(tension, dtype=float)[active][:, None]
    place, lead = np.zeros((2, len(active), 3))
    for row, k in enumerate(active):
        place[row, :2] = robot.tendons[k].at(station)
        lead[row, :2] = robot.tendons[k].slope(station)
    along, kappa = _AXIS.copy(), np.zeros(3)
    for _ in range(200):
        way = along + np.cross(kappa, place) + lead
        force = pull * way / np.linalg.norm(way, axis=1)[:, None]
        new = _AXIS - soft * force.sum(axis=0)
        moment = -np.cross(place, force).sum(axis=0) / [bending, bending, torsion]
        change = max(np.abs(new - along).max(), np.abs(moment - kappa).max() * robot.length)
        along, kappa = new, moment
        if change < 1e-15:
            return along, kappa
    raise ValueError(f"the strains at {station} m did not converge: the tensions are too large")


def _motion(y: np.ndarray, along: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """Derivative of position and quaternion (real part first)."""
    w, x, y_, z = y[3:7]
    a, b, c = kappa / 2
    turn = [
        -x * a - y_ * b - z * c,
        w * a + y_ * c - z * b,
        w * b + z * a - x * c,
        w * c + x * b - y_ * a,
    ]
    return np.concatenate([Rotation.from_quat([x, y_, z, w]).apply(along), turn])


def _check(robot: RobotParams) -> None:
    guided = [t.name for t in robot.tendons if t.guides]
    if guided:
        raise ValueError(f"need tendons in channels, {', '.join(guided)} have guides")
