"""Tasks of the spatial test rig (thesis secs. 5.4 and 6.1, audit sec. 4)."""

from math import pi

import numpy as np

from softrobot_env.robots import RIG, WORKSPACE
from softrobot_env.tasks.rig_trajectories import LapCircle, RoundedTriangle, SetPoints
from softrobot_env.tasks.spec import Maker, Task, whole
from softrobot_env.tasks.trajectories import Trajectory

#: Set points of a `reach` task.
_POINTS = 10


def _task(name: str, trajectory: Trajectory, duration: float) -> Task:
    return Task(name, RIG, trajectory, duration, (0.0, 0.0, 0.0), axes="xy")


def _triangle(period: float = 5.0) -> Task:
    """Laps of a triangle with rounded corners, of `period` [s], 10 s after the straight pose."""
    run = RoundedTriangle(period=float(period))
    return _task("triangle", run, run.end_time)


def _circle(radius: float = 0.12, speed: float = 0.05) -> Task:
    """From the straight pose out to a circle, one lap, and back; `radius` [m], `speed` [m/s]."""
    _check_radius(radius)
    run = LapCircle(radius=float(radius), speed=float(speed))
    return _task("rig_circle", run, run.end_time)


def _reach(seed: int = 0, radius: float = WORKSPACE, hold: float = 3.0) -> Task:
    """Ten set points, uniform in a disc of `radius` [m], held for `hold` [s] one by one."""
    _check_radius(radius)
    distance, turn = np.random.default_rng(whole(seed)).uniform(size=(2, _POINTS))
    z = radius * np.sqrt(distance) * np.exp(2j * pi * turn)
    points = tuple((float(x.real), float(x.imag), 0.0) for x in z)
    return _task("reach", SetPoints(points, float(hold)), _POINTS * float(hold))


def _check_radius(radius: float) -> None:
    if not 0 < radius <= WORKSPACE:
        raise ValueError(f"radius must lie in (0, {WORKSPACE:g}] m, got {radius!r}")


#: All tasks of the test rig.
RIG_TASKS: dict[str, Maker] = {
    "triangle": _triangle,
    "rig_circle": _circle,
    "reach": _reach,
}
