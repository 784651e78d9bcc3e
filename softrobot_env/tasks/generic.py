"""Tasks for any robot, in its own workspace.

Their paths run in the plane in which the robot's statics can place its tip freely: the x-z plane of
a planar robot, and across the axis of a spatial one, whose tip's height then follows from the
statics. All points are reachable: the inputs that hold them have been computed. The data of a robot
(`site_of`) are cached in the process; MuJoCo is loaded when the first task is made.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import lstsq, norm

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.registry import Registry
from softrobot_env.robots import RobotParams

from .smooth_paths import FourierPath, SmoothRun, figure_eight, random_path
from .spec import Maker, Task, whole
from .trajectories import SetPoints

if TYPE_CHECKING:
    from softrobot_env.scene.inverse import InverseStatics, ReachableEllipse

#: Default size of a path, and of the disc of set points, as shares of the tip's range.
PATH_SHARE, REACH_SHARE = 0.5, 0.8

#: Default speed: a lap takes at least this many periods of the first mode, and this many s; the
#: speed is at most this many reaches of the robot per second.
_LAP, _SHORTEST_LAP, _FASTEST = 8.0, 1.0, 0.5

#: Default time at a set point, in periods of the first mode, and at least [s].
_HOLD, _SHORTEST_HOLD = 5.0, 1.0

_POINTS = 10

#: Number of discs of set points tried if no size is given, each half as large as the last.
_HALVINGS = 4

_LAPS, _REST = 2, 1.0

#: Laps at a frequency: the ramps, each a lap long, cost one lap, so that two are at full rate.
_LAPS_AT_FREQUENCY = 3

#: A height is computed at this many points, and this many per harmonic of the flat path; the number
#: of fitted harmonics is a share of that.
_SOLVED, _PER_HARMONIC, _FITTED = 48, 16, 0.4


#: Harmonics of a height below this, over the reach, are dropped.
_FELT = 1e-8

#: The surface of the tips is computed on this many rings and spokes, and fitted by polynomials of
#: this total degree, with this largest error over the reach.
_RINGS, _SPOKES, _DEGREE, _SMOOTH = 6, 20, 8, 1e-4

#: Margin, as a share of the reach, of tips of such a surface that were beyond it: series through
#: tips are about as accurate.
_SPARE = 1e-6


class ReachableRegion(NamedTuple):
    """The region of a robot's tasks.

    Attributes:
        inverse: Its inverse statics.
        ground: Region fully reachable by its tip, in the plane of the paths.
        period: [s], about that of the first mode, by which default speeds are scaled.
        frequency: [Hz] of the first mode about the middle of the ground, tensions or lengths held.
    """

    inverse: "InverseStatics"
    ground: "ReachableEllipse"
    period: float
    frequency: float

    def held_along(self, points: ndarray, what: str) -> tuple[ndarray, ndarray]:
        """Tips (n, 3) [m] and inputs (n, n_inputs) that hold points (n, 3), one after the other.

        Raises:
            ValueError: A point cannot be reached; the message says by how much, and which size is
                safe.
        """
        held, rows = self.inverse.solve(self.ground.middle[None], self.ground.inputs), []
        for point in points:
            held = self.inverse.solve(point[None], held, anywhere=False)
            if not held.errors[0] <= self.inverse.tolerance:
                raise ValueError(f"{what}: {self._out_of_reach(point, held.errors[0])}")
            rows.append(held)
        tips = self.inverse.scene.tip(np.concatenate([row.postures for row in rows]))
        return tips, np.concatenate([row.inputs for row in rows])

    def _out_of_reach(self, point: ndarray, error: float) -> str:
        far = "no equilibrium is found" if np.isinf(error) else f"{1e3 * error:.3g} mm off"
        name, ground = self.inverse.scene.config.robot.name, self.ground
        return (
            f"robot {name!r} cannot hold its tip at {np.round(point, 4).tolist()} m ({far}); "
            f"choose a smaller radius: from the middle of its tasks it gets {ground.radius:.3g} m "
            f"to all sides, and {ground.length:.3g} m along the longest way"
        )


@lru_cache(maxsize=32)
def site_of(robot: RobotParams) -> ReachableRegion:
    """The region of a robot's tasks; raises the errors of `scene.inverse.workspace_of`."""
    from softrobot_env.scene.inverse import workspace_of
    from softrobot_env.scene.linearised import linearised

    try:
        space = workspace_of(robot)
    except EquilibriumError as error:
        raise EquilibriumError(
            f"robot {robot.name!r} does not rest under the action 0, from which its tasks are laid "
            f"out: {error}"
        ) from None
    first = float(linearised(space.inverse, space.ground.inputs).frequencies[0])
    return ReachableRegion(space.inverse, space.ground, space.scene.timestep.first_period, first)


def _circle(
    robot: RobotParams,
    radius: float | None = None,
    speed: float | None = None,
    frequency: float | None = None,
) -> Task:
    """Laps of a circle of `radius` [m], paced as `laps` says, from rest to rest."""
    ground, (radius, _) = _wide_ground(robot, "circle", radius, long=False)
    e1, e2 = radius * ground.axes
    flat = FourierPath(_point(ground.middle + e1), (_point(e1),), (_point(e2),))
    return laps("circle", robot, flat, speed, frequency, radius=radius)


def _figure_eight(
    robot: RobotParams,
    radius: float | None = None,
    speed: float | None = None,
    frequency: float | None = None,
) -> Task:
    """Laps of a figure eight, 2 `radius` [m] from end to end; as wide as the robot reaches, at
    most half as wide as long."""
    ground, (radius, width) = _wide_ground(robot, "figure_eight", radius)
    along, across = radius * ground.axes[0], min(width, radius / 2) * ground.axes[1]
    flat = figure_eight(_point(ground.middle), _point(along), _point(across))
    return laps("figure_eight", robot, flat, speed, frequency, radius=radius)


def _random(
    robot: RobotParams,
    radius: float | None = None,
    speed: float | None = None,
    seed: int = 0,
    frequency: float | None = None,
) -> Task:
    """Laps of a smooth random path that just fills an ellipse, 2 `radius` [m] long and as wide
    as the robot reaches."""
    ground, (radius, width) = _wide_ground(robot, "random", radius)
    along, across = radius * ground.axes[0], width * ground.axes[1]
    path = random_path(whole(seed), _point(ground.middle), _point(along), _point(across))
    sheet = _sheet(robot, radius, width, "task 'random'")
    return laps("random", robot, path, speed, frequency, sheet, radius=radius, seed=seed)


def _reach(
    robot: RobotParams, seed: int = 0, radius: float | None = None, hold: float | None = None
) -> Task:
    """Ten set points, uniform in a disc of `radius` [m], held for `hold` [s] one by one.

    For a robot whose tip cannot move in all directions they lie on a line, within `radius` of its
    rest.
    """
    site, rng = site_of(robot), np.random.default_rng(whole(seed))
    points, radius = _set_points(site, rng, radius)
    hold = max(_SHORTEST_HOLD, np.ceil(2 * _HOLD * site.period) / 2) if hold is None else hold
    trajectory = SetPoints(tuple(map(_point, points)), float(hold))
    options = (("seed", seed), ("radius", radius), ("hold", float(hold)))
    return _task("reach", robot, trajectory, _POINTS * float(hold), site.ground.inputs, options)


def _set_points(
    site: ReachableRegion, rng: np.random.Generator, radius: float | None
) -> tuple[ndarray, float]:
    """Points (n, 3) [m], and the radius [m] of the disc or line that contains them.

    If a point of the default disc cannot be held, a smaller disc is used, and finally a line.
    """
    if site.ground.radius == 0:
        return _on_line(site, rng, radius)
    distance, turn = rng.uniform(size=(2, _POINTS))
    shares = np.sqrt(distance) * np.exp(2j * np.pi * turn)
    if radius is not None:
        return _in_disc(site, shares, _radius(radius, 0.0))
    for halvings in range(_HALVINGS):
        try:
            return _in_disc(site, shares, _rounded(REACH_SHARE * site.ground.radius / 2**halvings))
        except ValueError:
            continue
    return _on_line(site, rng, None)


def _in_disc(site: ReachableRegion, shares: ndarray, radius: float) -> tuple[ndarray, float]:
    """Tips (n, 3) [m] over places in the unit disc (n,), complex, times a radius [m].

    Raises:
        ValueError: One cannot be held.
    """
    z = radius * shares
    flat = site.ground.middle + np.stack([z.real, z.imag], axis=1) @ site.ground.axes
    sheet = _sheet(site.inverse.scene.config.robot, radius, radius, "task 'reach'")
    return site.held_along(flat, "task 'reach'")[0] if sheet is None else sheet.over(flat), radius


def _on_line(
    site: ReachableRegion, rng: np.random.Generator, radius: float | None
) -> tuple[ndarray, float]:
    """Tips (n, 3) [m] along the line of the tip's largest range.

    They lie within `radius` [m] of the tip under the action 0, uniform in the length of the line: a
    slack tendon moves nothing.
    """
    shares = np.linspace(-1, 1, 81)
    tips, postures = site.inverse.line(shares)
    stands = np.isfinite(tips[:, 0])
    shares, tips, postures = shares[stands], tips[stands], postures[stands]
    away = norm(tips - site.ground.middle, axis=1)
    most, name = away.max(), site.inverse.scene.config.robot.name
    if not most > site.inverse.tolerance:
        raise ValueError(f"task 'reach' needs a tip that moves: no action moves robot {name!r}")
    radius = _radius(radius, REACH_SHARE * most)
    if radius > most:
        raise ValueError(f"radius must be at most {most:.3g} m here, got {radius!r}")
    length = np.append(0.0, norm(np.diff(tips, axis=0), axis=1).cumsum())
    near = length[away <= radius]
    chosen = np.interp(np.sort(rng.uniform(near[0], near[-1], _POINTS)), length, shares)
    tips, _ = site.inverse.line(chosen, (shares, postures))
    return rng.permutation(tips), radius


def _wide_ground(
    robot: RobotParams, task: str, radius: float | None, long: bool = True
) -> tuple["ReachableEllipse", tuple[float, float]]:
    """The ground of a path, its half length or radius [m], and its half width in proportion.

    Raises:
        ValueError: The robot's tip only moves on a line, or the radius is not positive.
    """
    site = site_of(robot)
    ground = site.ground
    if ground.radius == 0:
        raise ValueError(
            f"task {task!r} needs a tip that moves to all sides; that of robot {robot.name!r} is "
            "not found to from where it is under the action 0: task 'reach' works along a line"
        )
    length = ground.length if long else ground.radius
    radius = _radius(radius, PATH_SHARE * length)
    return ground, (radius, radius * ground.radius / length)


def laps(
    name: str,
    robot: RobotParams,
    flat: FourierPath,
    speed: float | None = None,
    frequency: float | None = None,
    sheet: "_Sheet | None" = None,
    **options: float,
) -> Task:
    """Laps of a closed path of the tip, from rest to rest; at least two of them at full rate.

    Args:
        name: Of the task.
        robot: The robot.
        flat: The path, in the plane of `site_of(robot).ground`: the height of a spatial robot's tip
            follows from its statics.
        speed: [m/s], largest of the reference; by default slow for the robot.
        frequency: Laps per second instead of the speed, over the frequency of the robot's first
            mode (`ReachableRegion.frequency`) [1]. The ramps at both ends are then a lap long.
        sheet: Surface of the tip's rests over this plane, if known.
        **options: Options of the path, for labels and reports.

    Raises:
        ValueError: The robot cannot hold its tip somewhere on the path.
    """
    site, what = site_of(robot), f"task {name!r}"
    if sheet is None:
        curve, start = _held_path(robot, flat, what)
    else:
        tips = sheet.over(flat.derivative(_phases(flat), 0))
        curve, start = _raised(site, flat, tips), site.held_along(tips[:1], what)[1][0]
    run, pace = _paced(site, curve, speed, frequency, what)
    return _task(name, robot, run, run.end_time + _REST, start, (*options.items(), pace))


@lru_cache(maxsize=32)
def _held_path(robot: RobotParams, flat: FourierPath, what: str) -> tuple[FourierPath, ndarray]:
    """The path of the tip over a flat one, and the inputs (n_inputs,) that hold its start."""
    site = site_of(robot)
    tips, inputs = site.held_along(flat.derivative(_phases(flat), 0), what)
    return _raised(site, flat, tips), inputs[0]


def _paced(
    site: ReachableRegion,
    curve: FourierPath,
    speed: float | None,
    frequency: float | None,
    what: str,
) -> tuple[SmoothRun, tuple[str, float]]:
    """A run along a curve, and the option that sets its speed; arguments as in `laps`."""
    if speed is not None and frequency is not None:
        raise ValueError(f"{what}: give its speed or its frequency, not both")
    if frequency is not None:
        if not frequency > 0:
            raise ValueError(f"frequency must be positive, got {frequency!r}")
        rate = frequency * site.frequency
        run = SmoothRun(curve, 2 * np.pi * rate * curve.top_rate, _LAPS_AT_FREQUENCY, 1 / rate)
        return run, ("frequency", float(frequency))
    lap = max(_LAP * site.period, _SHORTEST_LAP)
    reach = site.inverse.scene.config.robot.reach
    fastest = min(_FASTEST * reach, 2 * np.pi * curve.top_rate / lap)
    speed = _rounded(fastest) if speed is None else float(speed)
    return SmoothRun(curve, speed, _LAPS), ("speed", speed)


def _phases(flat: FourierPath) -> ndarray:
    """Equal steps of the phase of a flat path, at which its tips are computed."""
    count = max(_SOLVED, _PER_HARMONIC * len(flat.cosine))
    return 2 * np.pi * np.arange(count) / count


def _raised(site: ReachableRegion, flat: FourierPath, tips: ndarray) -> FourierPath:
    """The path of the tip over a flat path, through tips (n, 3) [m] at its `_phases`.

    In the x-z plane it is the flat one. For a spatial robot the height is a Fourier series through
    the tips, so that the path stays smooth; between them its accuracy is that of the series (tests
    require less than 1e-4 of the reach).
    """
    if site.inverse.scene.config.bending == "planar":
        return flat
    axis = np.cross(*site.ground.axes)
    terms = np.fft.rfft(tips @ axis)[1 : int(_FITTED * len(tips)) + 1] * 2 / len(tips)
    k, reach = len(flat.cosine), site.inverse.scene.config.robot.reach
    felt = np.flatnonzero(np.abs(terms) > _FELT * reach)
    harmonics = max(k, felt[-1] + 1 if len(felt) else 0)
    terms = terms[:harmonics]
    cosine, sine = (np.zeros((harmonics, 3)) for _ in range(2))
    cosine[:k], sine[:k] = flat.cosine, flat.sine
    cosine += terms.real[:, None] * axis
    sine -= terms.imag[:, None] * axis
    return FourierPath(_point(tips[0]), *(tuple(map(_point, x)) for x in (cosine, sine)))


class _Sheet(NamedTuple):
    """The surface of the tips over an ellipse, all of which can be held.

    Attributes:
        site: Of the robot.
        size: (2,) [m], semi-axes of the ellipse along the axes of the ground.
        height: (terms,) [m], coefficients of `_powers`, of the height over the ground's middle.
    """

    site: ReachableRegion
    size: ndarray
    height: ndarray

    def over(self, flat: ndarray) -> ndarray:
        """Tips (n, 3) [m] over points (n, 3) in the plane of the ground, within the ellipse.

        Because the surface is fitted, tips of a straight robot may exceed its length: they are
        pulled back.
        """
        ground, robot = self.site.ground, self.site.inverse.scene.config.robot
        share = (flat - ground.middle) @ ground.axes.T / self.size
        tips = flat + np.outer(_powers(share) @ self.height, np.cross(*ground.axes))
        away = tips - robot.clamp.position
        far = norm(away, axis=1, keepdims=True) / robot.reach
        return tips - np.where(far > 1, 1 - (1 - _SPARE) / far, 0.0) * away


def _powers(points: ndarray) -> ndarray:
    """Products of powers, up to a total degree, of coordinates (n, 2) in the unit disc."""
    u, v = points.T
    degrees = [(i, k - i) for k in range(_DEGREE + 1) for i in range(k + 1)]
    return np.stack([u**i * v**j for i, j in degrees], axis=1)


@lru_cache(maxsize=32)
def _sheet(robot: RobotParams, length: float, width: float, what: str) -> _Sheet | None:
    """The sheet over an ellipse, computed once, so that tasks in it are cheap.

    Returns:
        The sheet; None if the surface is not smooth: then every tip must be solved for.

    Raises:
        ValueError: A tip on its rings cannot be held.
    """
    site, size = site_of(robot), np.array([length, width])
    rings = np.linspace(1, 0, _RINGS, endpoint=False)[::-1]
    turn = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    disc = np.outer(rings, np.exp(1j * turn)).ravel()
    points = np.stack([disc.real, disc.imag], axis=1)
    flat = site.ground.middle + points * size @ site.ground.axes
    if site.inverse.scene.config.bending == "planar":
        site.held_along(flat[-_SPOKES:], what)  # points inside can be held as well
        return _Sheet(site, size, np.zeros(_powers(points).shape[1]))
    tips, _ = site.held_along(flat, what)
    height = (tips - site.ground.middle) @ np.cross(*site.ground.axes)
    terms = _powers(points)
    fitted = lstsq(terms, height, rcond=None)[0]
    off = np.abs(terms @ fitted - height).max()
    return _Sheet(site, size, fitted) if off <= _SMOOTH * robot.reach else None


def _task(
    name: str,
    robot: RobotParams,
    trajectory: SmoothRun | SetPoints,
    duration: float,
    start: ndarray,
    options: tuple[tuple[str, float], ...],
) -> Task:
    axes = "xz" if robot.moves_in_xz else "xyz"
    return Task(name, robot, trajectory, duration, _point(start), options, axes)


def _point(values: ndarray) -> tuple[float, ...]:
    return tuple(np.asarray(values, float).tolist())


def _rounded(value: float) -> float:
    """The value rounded down to two digits."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{digit * np.floor(value / digit * (1 + 1e-12)):.6g}")


def _radius(given: float | None, usual: float) -> float:
    """A radius [m], by default about the usual one; ValueError unless it is positive."""
    if given is None:
        return _rounded(usual)
    if not given > 0:
        raise ValueError(f"radius must be positive, got {given!r}")
    return float(given)


#: Name -> function of the robot and options that makes the task.
GENERIC_TASKS: Registry[Callable[..., Task]] = Registry(
    "task", {"reach": _reach, "circle": _circle, "figure_eight": _figure_eight, "random": _random}
)


def generic_tasks(robot: RobotParams) -> dict[str, Maker]:
    """The generic tasks of a robot; options that are None have a default."""
    return {name: partial(make, robot) for name, make in GENERIC_TASKS.registered().items()}
