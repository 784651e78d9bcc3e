"""Tasks of the spatial test rig (thesis secs. 5.4 and 6.1, audit sec. 4)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite, pi
from typing import ClassVar

import numpy as np

from softrobot_env.robots import LENGTH_SCALE, RIG, WORKSPACE, RobotParams, as_number
from softrobot_env.tasks import LONGEST
from softrobot_env.tasks.rig_trajectories import LapCircle, RoundedTriangle
from softrobot_env.tasks.trajectories import Trajectory

#: Set points of a `reach` task.
_POINTS = 10


@dataclass(frozen=True)
class RigTask:
    """What an environment asks of a policy; references are x and y of the tip.

    Attributes:
        name: Key in `RIG_TASKS`.
        robot: The nominal robot; what is simulated may be a twin.
        trajectory: Reference.
        duration: [s] of an episode.
        start_length: (n_tendons,) [m], pulled-in lengths in whose equilibrium the episode starts at
            rest; at most `LENGTH_SCALE` to either side.
        options: What the task was made with, (name, value) each.
    """

    name: str
    robot: RobotParams
    trajectory: Trajectory
    duration: float
    start_length: tuple[float, ...] = (0.0, 0.0, 0.0)
    options: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        tendons = len(self.robot.tendons)
        if tendons == 0 or len(self.start_length) != tendons:
            raise ValueError(
                f"task {self.name!r}: robot {self.robot.name!r} has {tendons} tendons, "
                f"start_length {len(self.start_length)}; a task needs as many, and at least one"
            )
        if not all(abs(length) <= LENGTH_SCALE for length in self.start_length):
            raise ValueError(
                f"task {self.name!r}: start_length must lie within +-{LENGTH_SCALE:g} m, got "
                f"{self.start_length}"
            )
        if not 0 < self.duration <= LONGEST:
            raise ValueError(
                f"task {self.name!r}: duration must lie in (0, {LONGEST:g}] s, got "
                f"{self.duration!r}"
            )

    @property
    def label(self) -> str:
        """Name for people, with the options it was made with."""
        return " ".join([self.name, *(f"{name} {value:g}" for name, value in self.options)])


@dataclass(frozen=True)
class SetPoints:
    """Jumps from one point to the next, each held for a while.

    Attributes:
        points: (k, 3) [m].
        hold: [s] at each point; the last one stays.
    """

    jumps: ClassVar[bool] = True

    points: tuple[tuple[float, float, float], ...]
    hold: float

    def __post_init__(self) -> None:
        if not self.points or not 0 < self.hold < inf:
            raise ValueError(
                f"set points need one point or more and a positive hold [s], got "
                f"{len(self.points)} points and {self.hold} s"
            )
        for point in self.points:
            if len(point) != 3 or not all(isfinite(x) for x in point):
                raise ValueError(f"a set point needs three finite coordinates [m], got {point}")

    def position(self, t: np.ndarray) -> np.ndarray:
        """Position (n, 3) [m] at times (n,) [s]; at a jump the new point."""
        index = np.floor(np.asarray(t) / self.hold + 1e-9).astype(int)
        return np.array(self.points)[np.clip(index, 0, len(self.points) - 1)]

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Zero: the jumps have no finite velocity."""
        return np.zeros((*np.shape(t), 3))

    acceleration = velocity

    def path(self) -> np.ndarray:
        """The points."""
        return np.array(self.points)


def _triangle(period: float = 5.0) -> RigTask:
    """Laps of a triangle with rounded corners, 10 s after the straight pose."""
    run = RoundedTriangle(period=float(period))
    return RigTask("triangle", RIG, run, run.end_time)


def _circle(radius: float = 0.12, speed: float = 0.05) -> RigTask:
    """From the straight pose out to a circle, one lap, and back."""
    _check_radius(radius)
    run = LapCircle(radius=float(radius), speed=float(speed))
    return RigTask("rig_circle", RIG, run, run.end_time)


def _reach(seed: int = 0, radius: float = WORKSPACE, hold: float = 3.0) -> RigTask:
    """Ten set points, uniform in a disc, held one after the other."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed must be a whole number >= 0, got {seed!r}")
    _check_radius(radius)
    distance, turn = np.random.default_rng(int(seed)).uniform(size=(2, _POINTS))
    z = radius * np.sqrt(distance) * np.exp(2j * pi * turn)
    points = tuple((float(x.real), float(x.imag), 0.0) for x in z)
    return RigTask("reach", RIG, SetPoints(points, float(hold)), _POINTS * float(hold))


def _check_radius(radius: float) -> None:
    if not 0 < radius <= WORKSPACE:
        raise ValueError(f"radius must lie in (0, {WORKSPACE:g}] m, got {radius!r}")


RIG_TASKS: dict[str, Callable[..., RigTask]] = {
    "triangle": _triangle,
    "rig_circle": _circle,
    "reach": _reach,
}

#: Options of `make_rig_task` by task.
RIG_OPTIONS = {
    "triangle": ("period",),
    "rig_circle": ("radius", "speed"),
    "reach": ("seed", "radius", "hold"),
}


def make_rig_task(name: str, /, **options: float) -> RigTask:
    """Build a task by name.

    Args:
        name: One of `RIG_TASKS`.
        **options: Of the triangle `period` [s] of a lap, 5 unless given. Of the circle `radius`
            [m], 0.12, and `speed` [m/s], 0.05. Of the set points `seed`, 0, `radius` [m] of the
            disc they lie in, 0.121, and `hold` [s] at each, 3. No radius is beyond `WORKSPACE`.

    Raises:
        ValueError: Unknown name, an option of another task, or one out of range.
    """
    if name not in RIG_TASKS:
        raise ValueError(f"unknown task {name!r}; choose from {', '.join(RIG_TASKS)}")
    foreign = [option for option in options if option not in RIG_OPTIONS[name]]
    if foreign:
        raise ValueError(
            f"task {name!r} has no option {foreign[0]!r}; it has {', '.join(RIG_OPTIONS[name])}"
        )
    for option, value in options.items():
        if as_number(value) is None:
            raise ValueError(f"option {option!r} must be a number, got {value!r}")
    return replace(RIG_TASKS[name](**options), options=tuple(options.items()))


def remake_rig_task(task: RigTask, /, **options: float) -> RigTask:
    """The task with some options changed: trajectory and duration are new, robot and start stay.

    Raises:
        ValueError: As `make_rig_task`.
    """
    made = make_rig_task(task.name, **dict(task.options) | options)
    return replace(made, robot=task.robot, start_length=task.start_length)
