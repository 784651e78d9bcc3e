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

With weight, section and tendons together also carry the weight W(s) of what lies beyond, and its
moment M' = -x' x W, which vanishes at the tip: a boundary-value problem for M at the clamp.

Between two guides a tendon is a straight line. It ends where the rod takes the next guide to, so
that its direction is found span by span, from the clamp.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from softrobot_env.robots import RobotParams
from studies.truths.shooting import grown
from studies.truths.spatial_rod import SpatialShape, frame_of, motion_of, turned_along

_RTOL, _ATOL = 1e-10, 1e-12
_ENOUGH = 1e-8  # where equations are solved by integrating again and again
_ZERO = np.zeros(3)

#: Derivative (n,) of a state by the arc length.
Slope = Callable[[float, ndarray], ndarray]
_AXIS = np.array([0.0, 0.0, 1.0])
_CLAMPED = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # position and quaternion


def tendon_rod(
    robot: RobotParams, tension: ndarray, stations: ndarray, shear: float | None = None
) -> SpatialShape:
    """Shape of a robot under tensions (n_tendons,) [N] of tendons in channels.

    Args:
        robot: The robot; neither its gravity nor its base count.
        tension: (n_tendons,) [N].
        stations: (k,) [m], increasing.
        shear: k of the shear stiffness k G A; None for a rod without shear and
            extension.

    Raises:
        ValueError: A tendon has guides.
    """
    s, breaks = np.asarray(stations, dtype=float), _breaks(robot)

    def slope(at: float, y: ndarray) -> ndarray:
        return motion_of(y, *strains(robot, tension, at, shear))

    return _shape(s, _integrated(slope, _CLAMPED, breaks, s))


def _integrated(
    slope: Slope, y: ndarray, breaks: Sequence[ndarray], stations: ndarray, rtol: float = _RTOL
) -> ndarray:
    """States (k + 1, n) at stations (k,) [m] and at the last break, from the first on.

    The slope may jump at the breaks.
    """
    edges, out = np.unique(np.concatenate(breaks)), np.empty((len(stations) + 1, len(y)))
    out[:-1][stations == edges[0]] = y
    for start, end in pairwise(edges):
        margin = 1e-12 * (end - start)

        def inside(
            at: float, y: ndarray, low: float = start + margin, high: float = end - margin
        ) -> ndarray:
            return slope(min(max(at, low), high), y)

        asked = (stations > start) & (stations <= end)
        found = solve_ivp(
            inside, (start, end), y, "DOP853", rtol=rtol, atol=_ATOL, dense_output=asked.any()
        )
        if asked.any():
            out[:-1][asked] = found.sol(stations[asked]).T
        y = found.y[:, -1]
    out[-1] = y
    return out


def _shape(stations: ndarray, states: ndarray) -> SpatialShape:
    rows = states[: len(stations)]
    return SpatialShape(stations, rows[:, :3], np.array([frame_of(y) for y in rows]))


def hanging_rod(
    robot: RobotParams, tension: ndarray, stations: ndarray, shear: float | None = None
) -> SpatialShape:
    """The same of a robot with weight, along the axes of its base.

    Raises:
        ValueError: A tendon has guides.
        EquilibriumError: No equilibrium was found.
    """
    backbone, s = robot.backbone, np.asarray(stations, dtype=float)
    breaks = _breaks(robot)
    breaks.append(np.array([disc.station for disc in robot.discs]))
    fine = np.unique(np.concatenate([*breaks, np.linspace(0, robot.length, 2001)]))
    parts = backbone.integrals(backbone.mass, fine)
    rod = np.append(np.cumsum(parts[::-1])[::-1], 0.0)
    gravity = np.array(robot.own_gravity)

    def weight(at: float) -> ndarray:
        """[N] of what lies beyond."""
        discs = sum(disc.mass for disc in robot.discs if disc.station > at)
        return (np.interp(at, fine, rod) + discs) * gravity

    def along(moment: ndarray, share: float, asked: ndarray) -> ndarray:
        """States at places, from a moment at the clamp, with a share of the weight."""

        def slope(at: float, y: ndarray) -> ndarray:
            load, turn = share * weight(at), frame_of(y)
            loads = turn.T @ load, turn.T @ y[7:]
            motion = motion_of(y, *strains(robot, tension, at, shear, *loads))
            return np.concatenate([motion, -np.cross(motion[:3], load)])

        y = np.concatenate([_CLAMPED, moment])
        return _integrated(slope, y, breaks, asked, _ENOUGH)

    def missing(moment: ndarray, share: float) -> ndarray:
        return along(moment, share, np.empty(0))[-1, 7:]

    # Integration errs by some 1e-8.
    loose = {"most": 1e-6, "tol": None, "options": {"xtol": 1e-7, "eps": 1e-6}}
    moment = grown(missing, _ZERO, f"robot {robot.name!r}", **loose)
    return _shape(s, along(moment, 1.0, s))


def guided_rod(
    robot: RobotParams, tension: ndarray, stations: ndarray, shear: float | None = None
) -> SpatialShape:
    """The same of a weightless robot whose tendons run through the same guides, up to their ends.

    Raises:
        ValueError: They do not.
        EquilibriumError: No equilibrium was found.
    """
    s = np.asarray(stations, dtype=float)
    guides = np.unique([x for t in robot.tendons for x in t.stations])
    missed = [t.name for t in robot.tendons if len(t.stations) != np.sum(guides <= t.end)]
    if missed:
        raise ValueError(f"need tendons through the same guides, unlike {', '.join(missed)}")
    y = _CLAMPED
    rows = np.tile(y, (len(s), 1))
    for start, end in pairwise(guides):
        active = [k for k, t in enumerate(robot.tendons) if t.end > start]
        ends = np.zeros((2, len(active), 3))
        for row, k in enumerate(active):
            ends[:, row, :2] = robot.tendons[k].at(np.array([start, end]))
        pull = np.asarray(tension, dtype=float)[active][:, None]
        asked = (s > start) & (s <= end)
        states = _to_next_guide(robot, shear, y, (start, end), ends, pull, s[asked])
        rows[asked], y = states[:-1], states[-1]
    return _shape(s, rows)


def _to_next_guide(
    robot: RobotParams,
    shear: float | None,
    y: ndarray,
    span: tuple[float, float],
    ends: ndarray,
    pull: ndarray,
    stations: ndarray,
) -> ndarray:
    """States at stations and at the second of two guides, of a rod from a state at the first on.

    Args:
        robot, shear, y: The robot, its shear coefficient, and the state.
        span: Stations [m] of both guides.
        ends: Places (2, tendons, 3) [m] of the tendons in both.
        pull: (tendons, 1) [N].
        stations: (k,) [m].

    Raises:
        EquilibriumError: None was found.
    """
    first = y[:3] + ends[0] @ frame_of(y).T
    breaks = [np.array([*span, *(x for x in robot.backbone.ends if span[0] < x < span[1])])]

    def states(ways: ndarray, asked: ndarray) -> ndarray:
        """If tendons have directions (3 k,)."""
        force = -pull * ways.reshape(-1, 3)

        def slope(at: float, y: ndarray) -> ndarray:
            turn, moment = frame_of(y), np.cross(first - y[:3], force).sum(axis=0)
            loads = turn.T @ force.sum(axis=0), turn.T @ moment
            return motion_of(y, *_answer(robot, at, shear, *loads))

        return _integrated(slope, y, breaks, asked)

    def missed(ways: ndarray, _: float) -> ndarray:
        """By how much (3 k,) [1] such tendons miss the second guide."""
        reached = states(ways, np.empty(0))[-1]
        line = reached[:3] + ends[1] @ frame_of(reached).T - first
        return ways - (line / np.linalg.norm(line, axis=1)[:, None]).ravel()

    straight = np.tile(frame_of(y)[:, 2], len(pull))
    found = grown(missed, straight, f"robot {robot.name!r}", steps=1, tol=1e-10)
    return states(found, stations)


def tendon_helix(
    robot: RobotParams, tension: float, stations: ndarray, shear: float | None = None
) -> SpatialShape:
    """The helix that one helical tendon along all of a uniform robot makes; see the module."""
    _breaks(robot)
    robot.require_uniform("a helix of one tendon")
    (tendon,) = robot.tendons
    s = np.asarray(stations, dtype=float)
    along, kappa = strains(robot, np.array([tension]), 0.0, shear)
    rate = 2 * np.pi * tendon.turns / tendon.end
    screw = kappa + rate * _AXIS
    turned = Rotation.from_rotvec(s[:, None] * screw)
    frames = turned * Rotation.from_rotvec(-rate * s[:, None] * _AXIS)
    return SpatialShape(s, turned_along(screw, along, s), frames.as_matrix())


def strains(
    robot: RobotParams,
    tension: ndarray,
    station: float,
    shear: float | None,
    force: ndarray = _ZERO,
    moment: ndarray = _ZERO,
) -> tuple[ndarray, ndarray]:
    """Strains v [1] and kappa [1/m], (3,) each, of one cross-section.

    Under tensions, and a force [N] and a moment [N m] along its axes from what lies beyond.
    """
    active = [k for k, t in enumerate(robot.tendons) if t.end > station]
    pull = np.asarray(tension, dtype=float)[active][:, None]
    place, lead = np.zeros((2, len(active), 3))
    for row, k in enumerate(active):
        place[row, :2], lead[row, :2] = robot.tendons[k].course(station)
    along, kappa = _answer(robot, station, shear, force, moment)
    for _ in range(200):
        way = along + np.cross(kappa, place) + lead
        pulls = pull * way / np.linalg.norm(way, axis=1)[:, None]
        rest = force - pulls.sum(axis=0), moment - np.cross(place, pulls).sum(axis=0)
        new, bent = _answer(robot, station, shear, *rest)
        change = max(np.abs(new - along).max(), np.abs(bent - kappa).max() * robot.length)
        along, kappa = new, bent
        if change < 1e-14:
            return along, kappa
    raise ValueError(f"the strains at {station} m did not converge: the tensions are too large")


def _answer(
    robot: RobotParams, station: float, shear: float | None, force: ndarray, moment: ndarray
) -> tuple[ndarray, ndarray]:
    """Strains v and kappa of a cross-section under a force and a moment along its axes."""
    backbone, s = robot.backbone, np.array([station])
    bending, torsion = backbone.bending(s)[0], backbone.torsion(s)[0]
    along = _AXIS
    if shear is not None:
        across = shear * backbone.shear(s)[0]
        along = _AXIS + force / [across, across, backbone.axial(s)[0]]
    return along, moment / [bending, bending, torsion]


def _breaks(robot: RobotParams) -> list[ndarray]:
    """Places [m] where strains may jump; ValueError unless all tendons run in channels."""
    guided = [t.name for t in robot.tendons if t.guides]
    if guided:
        raise ValueError(f"need tendons in channels, {', '.join(guided)} have guides")
    return [robot.backbone.ends, *(t.knots[:, 0] for t in robot.tendons)]
