"""Rods bent and twisted in space, exactly: helices under a moment, and rods under any wrenches.

A uniform rod of bending stiffness EI and torsional stiffness GJ is clamped at the origin, straight
along +z (frame as in `robots`). Its sections have the directors d1, d2, d3, the columns of R(s).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.robots.loads import Load
from studies.truths.analytic import Section
from studies.truths.shooting import integral

_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class SpatialShape:
    """Shape of a rod in space.

    Attributes:
        station: (k,) [m], arc length of the straight rod.
        position: (k, 3) [m].
        frame: (k, 3, 3), columns are the directors.
    """

    station: ndarray
    position: ndarray
    frame: ndarray

    @property
    def tip(self) -> ndarray:
        """(3,) [m], position at the last station."""
        return self.position[-1]


def helix(
    length: float, section: Section, moment: ndarray, stations: ndarray, follows: bool = False
) -> SpatialShape:
    """The helix that a moment at the tip makes of a rod without forces (Kirchhoff 1859).

    The moment M is the same in every section, so d3' = M x d3 / EI: the tangent turns about M at a
    constant rate whatever the torsional stiffness is, and M . d3 / GJ is the constant twist. With
    the cross products [a] b = a x b

        R(s) = exp([M] s / EI) exp([e_z] s (1 / GJ - 1 / EI) M_z).

    A moment that follows the tip's section with components m is R(L) m in the world, hence m
    turned about e_z by L (1 / GJ - 1 / EI) m_z.

    Args:
        length: L [m].
        section: The section; shear and extension play no part.
        moment: (3,) [N m], in the world, or in the tip's section if it follows.
        stations: (k,) [m].
        follows: Whether it follows.
    """
    moment, s = np.asarray(moment, dtype=float), np.asarray(stations, dtype=float)
    rate = (1 / section.torsion - 1 / section.bending) * moment[2]
    if follows:
        moment = Rotation.from_rotvec([0, 0, length * rate]).apply(moment)
    bend = moment / section.bending
    turned = Rotation.from_rotvec(s[:, None] * bend)
    frames = turned * Rotation.from_rotvec(s[:, None] * [0, 0, rate])
    return SpatialShape(s, turned_along(bend, _AXIS, s), frames.as_matrix())


def turned_along(rate: ndarray, vector: ndarray, s: ndarray) -> ndarray:
    """Integrals (k, 3) from 0 to s (k,) of a vector (3,) turned at a rate (3,) [rad/m]."""
    speed = np.linalg.norm(rate)
    if speed == 0:
        return s[:, None] * vector
    about = rate / speed
    along, side = about * (about @ vector), np.cross(about, vector)
    around, half = vector - along, speed * s / 2
    chord = s * np.sinc(half / np.pi)
    turning = (chord * np.cos(half))[:, None] * around + (chord * np.sin(half))[:, None] * side
    return s[:, None] * along + turning


def followed_rod(
    length: float,
    section: Section,
    loads: Sequence[Load],
    stations: ndarray,
    weight: ndarray | None = None,
) -> SpatialShape:
    """Equilibrium of a rod under forces and moments that follow its sections, however large.

    Seen from the tip's section such loads are known, so one initial-value problem from the tip to
    the clamp gives the shape: no equations are solved. With the force N and the moment M in a
    section, both in one fixed frame (Antman, Nonlinear Problems of Elasticity, ch. VIII),

        x' = R (e_z + C_n^-1 R^T N),   R' = R [C_m^-1 R^T M],   M' = N x x',   N' = -w.

    Args:
        length: L [m].
        section: The section.
        loads: Loads; all are taken to follow, `dead_loads` gives those that do not.
        stations: (k,) [m], increasing.
        weight: (3,) [N/m], dead load per length seen from the tip's section: `frame[-1] @ weight`
            in the world, if the tip is the last station; none unless given.
    """
    w = np.zeros(3) if weight is None else np.asarray(weight, dtype=float)
    s = np.asarray(stations, dtype=float)
    y = np.concatenate([np.zeros(3), [1.0, 0, 0, 0], np.zeros(6)])
    places = sorted({0.0, length, *s.tolist(), *(x.station for x in loads)}, reverse=True)
    states = {}
    for above, here in zip([None, *places], places, strict=False):
        if above is not None:
            y = integral(lambda _, y: _slope(y, section, w), (above, here), y)
        states[here] = y
        for load in loads:
            if load.station == here:
                y = y + np.concatenate(
                    [np.zeros(7), frame_of(y) @ load.force, frame_of(y) @ load.moment]
                )
    base = states[0.0]
    back = frame_of(base).T
    found = [states[x] for x in s.tolist()]
    position = np.array([back @ (y[:3] - base[:3]) for y in found])
    return SpatialShape(s, position, np.array([back @ frame_of(y) for y in found]))


def dead_loads(loads: Sequence[Load], shape: SpatialShape) -> list[Load]:
    """Loads of fixed direction that hold a rod in the same shape as those that follow.

    Args:
        loads: Loads that follow.
        shape: The shape, with their stations among its own.
    """
    found = []
    for load in loads:
        frame = shape.frame[shape.station.tolist().index(load.station)]
        force, moment = (tuple((frame @ x).tolist()) for x in (load.force, load.moment))
        found.append(replace(load, force=force, moment=moment, follows=False))
    return found


def frame_of(y: ndarray) -> ndarray:
    """Directors (3, 3) of a state, which begins with position and quaternion (real part first)."""
    w, a, b, c = y[3:7] / np.linalg.norm(y[3:7])
    return np.array(
        [
            [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
            [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
            [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
        ]
    )


def motion_of(y: ndarray, along: ndarray, kappa: ndarray) -> ndarray:
    """Derivative (7,) of position and quaternion by the arc length, of strains v and kappa (3,)."""
    w, x, y_, z = y[3:7]
    a, b, c = kappa / 2
    turn = [
        -x * a - y_ * b - z * c,
        w * a + y_ * c - z * b,
        w * b + z * a - x * c,
        w * c + x * b - y_ * a,
    ]
    return np.concatenate([frame_of(y) @ along, turn])


def _slope(y: ndarray, section: Section, weight: ndarray) -> ndarray:
    frame = frame_of(y)
    force, moment = frame.T @ y[7:10], frame.T @ y[10:]
    along = _AXIS + force / [section.shear, section.shear, section.axial]
    motion = motion_of(y, along, moment / [section.bending, section.bending, section.torsion])
    return np.concatenate([motion, -weight, np.cross(y[7:10], motion[:3])])
