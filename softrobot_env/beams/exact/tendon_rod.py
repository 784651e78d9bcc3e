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

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from softrobot_env.beams.exact.spatial_rod import SpatialShape
from softrobot_env.robots import RobotParams

_RTOL, _ATOL = 1e-10, 1e-12
_ENOUGH = 1e-8  # where equations are solved by integrating again and again
_ZERO = np.zeros(3)
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


def hanging_rod(
    robot: RobotParams,
    tension: np.ndarray,
    stations: np.ndarray,
    shear_coefficient: float | None = None,
) -> SpatialShape:
    """The same of a robot with weight, along the axes of its base.

    Raises:
        ValueError: A tendon has guides, or no equilibrium was found.
    """
    _check(robot)
    backbone, s = robot.backbone, np.asarray(stations, dtype=float)
    breaks = [backbone.ends, *(t.knots[:, 0] for t in robot.tendons), s]
    breaks.append([disc.station for disc in robot.discs])
    edges = np.unique(np.concatenate(breaks))
    fine = np.union1d(edges, np.linspace(0, robot.length, 2001))
    parts = backbone.integrals(backbone.mass, fine)
    rod = np.append(np.cumsum(parts[::-1])[::-1], 0.0)
    gravity = np.array(robot.own_gravity)

    def mass(at: float) -> float:
        """[kg] of what lies beyond."""
        return np.interp(at, fine, rod) + sum(x.mass for x in robot.discs if x.station > at)

    def along(moment: np.ndarray, share: float) -> dict[float, np.ndarray]:
        """States at the edges, from a moment at the clamp, with a share of the weight."""
        y = np.concatenate([_ZERO, [1.0, 0, 0, 0], moment])
        states = {0.0: y}
        for start, end in pairwise(edges):
            margin = 1e-12 * (end - start)

            def slope(at: float, y: np.ndarray, low: float, high: float) -> np.ndarray:
                at = min(max(at, low), high)
                weight, turn = share * mass(at) * gravity, _turn(y)
                loads = turn.T @ weight, turn.T @ y[7:]
                v, kappa = strains(robot, tension, at, shear_coefficient, *loads)
                motion = _motion(y, v, kappa)
                return np.concatenate([motion, -np.cross(motion[:3], weight)])

            limits = (start + margin, end - margin)
            y = solve_ivp(slope, (start, end), y, "DOP853", args=limits, rtol=_ENOUGH, atol=1e-10)
            y = y.y[:, -1]
            states[float(end)] = y
        return states

    moment = _ZERO
    for share in (0.5, 1.0):
        found = root(lambda m, x=share: along(m, x)[float(edges[-1])][7:], moment, tol=1e-7)
        moment = found.x
    if not found.success:
        raise ValueError(f"no equilibrium of robot {robot.name!r}: {found.message}")
    states = along(moment, 1.0)
    y = np.array([states[float(x)] for x in s])
    return SpatialShape(s, y[:, :3], np.array([_turn(row) for row in y]))


def guided_rod(
    robot: RobotParams,
    tension: np.ndarray,
    stations: np.ndarray,
    shear_coefficient: float | None = None,
) -> SpatialShape:
    """The same of a weightless robot whose tendons run through the same guides, up to their ends.

    Raises:
        ValueError: They do not, or no equilibrium was found.
    """
    backbone, s = robot.backbone, np.asarray(stations, dtype=float)
    guides = np.unique([x for t in robot.tendons for x in t.stations])
    missed = [t.name for t in robot.tendons if len(t.stations) != np.sum(guides <= t.end)]
    if missed:
        raise ValueError(f"need tendons through the same guides, unlike {', '.join(missed)}")
    y = np.concatenate([_ZERO, [1.0, 0, 0, 0]])
    states = {0.0: y}
    for start, end in pairwise(guides):
        active = [k for k, t in enumerate(robot.tendons) if t.end > start]
        pull = np.asarray(tension, dtype=float)[active][:, None]
        places = [np.array([robot.tendons[k].at(x) for k in active]) for x in (start, end)]
        low, high = (np.column_stack([x, np.zeros(len(active))]) for x in places)
        starts = y[:3] + low @ _turn(y).T
        cuts = np.unique([start, end, *(x for x in (*s, *backbone.ends) if start < x < end)])

        def through(
            way: np.ndarray, y: np.ndarray = y, given: tuple = (starts, pull, cuts)
        ) -> dict[float, np.ndarray]:
            starts, pull, cuts = given
            force = -(pull * way)

            def slope(at: float, y: np.ndarray, middle: float) -> np.ndarray:
                turn = _turn(y)
                moment = np.cross(starts - y[:3], force).sum(axis=0)
                loads = turn.T @ force.sum(axis=0), turn.T @ moment
                return _motion(y, *_answer(robot, middle, shear_coefficient, *loads))

            out = {}
            for a, b in pairwise(cuts):
                # Sections do not change within a cut, but for tapers, which are taken as they go.
                args = ((a + b) / 2,)
                y = solve_ivp(slope, (a, b), y, "DOP853", args=args, rtol=_ENOUGH, atol=1e-11)
                y = y.y[:, -1]
                out[float(b)] = y
            return out

        def missed_by(
            flat: np.ndarray,
            high: np.ndarray = high,
            starts: np.ndarray = starts,
            end: float = end,
            through=through,
        ) -> np.ndarray:
            way = flat.reshape(-1, 3)
            y = through(way)[float(end)]
            line = y[:3] + high @ _turn(y).T - starts
            return (way - line / np.linalg.norm(line, axis=1)[:, None]).ravel()

        guess = np.tile(_turn(y)[:, 2], len(active))
        found = root(missed_by, guess, tol=1e-10)
        if not found.success:
            raise ValueError(f"no equilibrium of robot {robot.name!r}: {found.message}")
        states |= through(found.x.reshape(-1, 3))
        y = states[float(end)]
    found = np.array([states[float(x)] for x in s])
    return SpatialShape(s, found[:, :3], np.array([_turn(row) for row in found]))


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
    robot: RobotParams,
    tension: np.ndarray,
    station: float,
    shear_coefficient: float | None,
    force: np.ndarray = _ZERO,
    moment: np.ndarray = _ZERO,
) -> tuple[np.ndarray, np.ndarray]:
    """Strains v [1] and kappa [1/m], (3,) each, of one cross-section.

    Under tensions, and a force [N] and a moment [N m] along its axes from what lies beyond.
    """
    active = [k for k, t in enumerate(robot.tendons) if t.end > station]
    pull = np.asarray(tension, dtype=float)[active][:, None]
    place, lead = np.zeros((2, len(active), 3))
    for row, k in enumerate(active):
        place[row, :2], lead[row, :2] = robot.tendons[k].course(station)
    along, kappa = _answer(robot, station, shear_coefficient, force, moment)
    for _ in range(200):
        way = along + np.cross(kappa, place) + lead
        pulls = pull * way / np.linalg.norm(way, axis=1)[:, None]
        rest = force - pulls.sum(axis=0), moment - np.cross(place, pulls).sum(axis=0)
        new, bent = _answer(robot, station, shear_coefficient, *rest)
        change = max(np.abs(new - along).max(), np.abs(bent - kappa).max() * robot.length)
        along, kappa = new, bent
        if change < 1e-14:
            return along, kappa
    raise ValueError(f"the strains at {station} m did not converge: the tensions are too large")


def _answer(
    robot: RobotParams,
    station: float,
    shear_coefficient: float | None,
    force: np.ndarray,
    moment: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Strains v and kappa of a cross-section under a force and a moment along its axes."""
    backbone, s = robot.backbone, np.array([station])
    bending, torsion = backbone.bending(s)[0], backbone.torsion(s)[0]
    along = _AXIS
    if shear_coefficient is not None:
        shear = shear_coefficient * backbone.shear(s)[0]
        along = _AXIS + force / [shear, shear, backbone.axial(s)[0]]
    return along, moment / [bending, bending, torsion]


def _turn(y: np.ndarray) -> np.ndarray:
    """Axes (3, 3), as columns, of the section in a state."""
    w, a, b, c = y[3:7] / np.linalg.norm(y[3:7])
    return np.array(
        [
            [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
            [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
            [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
        ]
    )


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
    return np.concatenate([_turn(y) @ along, turn])


def _check(robot: RobotParams) -> None:
    guided = [t.name for t in robot.tendons if t.guides]
    if guided:
        raise ValueError(f"need tendons in channels, {', '.join(guided)} have guides")
