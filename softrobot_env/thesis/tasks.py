"""Tasks of the planar arm and of the spatial test rig (thesis secs. 5.4 and 6, audit sec. 4)."""

from math import pi

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.tasks import smooth_paths, trajectories
from softrobot_env.tasks.registry import with_option
from softrobot_env.tasks.spec import Maker, Task, whole

from .robots import ARM, RIG, WORKSPACE
from .trajectories import LapCircle, RoundedTriangle

#: Start of the step task on the equal-force curve.
_STEP_START = 0.6

#: Reduced input [N] of least norm that holds the arm's tip at the L-shape's start; a test holds
#: it to the constant-curvature statics.
_LSHAPE_START = (5.37167978, 7.43194333, 7.85705717)


def equal_input(robot: RobotParams, a: float) -> tuple[float, ...]:
    """Equal reduced inputs [N] that bend the arm to parameter a of its equal-force curve."""
    force = a * robot.bending_stiffness / abs(robot.tendons[0].offset[0])
    return (force,) * (len(robot.tendons) // 2)


def _step(step_width: float = 0.05) -> Task:
    step_width = float(step_width)
    curve = trajectories.EqualForceCurve(ARM.length)
    target = curve.parameter_at_distance(_STEP_START, step_width)
    trajectory = trajectories.Step(
        start=tuple(curve.derivative(_STEP_START, 0)), target=tuple(curve.derivative(target, 0))
    )
    return Task("step", ARM, trajectory, 5.0, equal_input(ARM, _STEP_START))


def _swing() -> Task:
    sweep = trajectories.CurveSweep(
        trajectories.EqualForceCurve(ARM.length), half_length=0.5, speed=0.1
    )
    return Task("swing", ARM, sweep, 15.0, equal_input(ARM, sweep.start_parameter))


def _lshape() -> Task:
    corners = ((0.24, 0.0, 0.42), (0.24, 0.0, 0.30), (0.35, 0.0, 0.30))
    return Task(
        "lshape", ARM, trajectories.Polyline(corners, (0.0, 5.0, 10.0)), 15.0, _LSHAPE_START
    )


#: Start of the unseen tasks, in the middle of the arm's workspace on one side, unit vectors along
#: and across this crescent, and the input [N] of least norm that holds the tip there; a test holds
#: it to the constant-curvature statics.
_START, _ALONG, _ACROSS = (0.29, 0.0, 0.325), (0.6, 0.0, -0.8), (-0.8, 0.0, -0.6)
_UNSEEN_START = (-21.46455231, 7.58592414, 29.89212503)

#: Laps of the unseen tasks, and the rest [s] at their end.
_LAPS, _REST = 2, 1.0


def _scaled(direction: tuple[float, float, float], size: float) -> tuple[float, float, float]:
    return tuple(size * part for part in direction)


def _unseen(name: str, curve: smooth_paths.FourierPath, speed: float) -> Task:
    run = smooth_paths.SmoothRun(curve, float(speed), _LAPS)
    side = 1.0 if curve.start[0] > 0 else -1.0
    held = tuple(side * force for force in _UNSEEN_START)
    return Task(name, ARM, run, run.end_time + _REST, held)


def _circle(speed: float = 0.1) -> Task:
    """A circle of radius 40 mm."""
    centre = tuple(a + b for a, b in zip(_START, _scaled(_ALONG, 0.04), strict=True))
    return _unseen("circle", smooth_paths.circle(_START, centre), speed)


def _figure_eight(speed: float = 0.1) -> Task:
    """A figure eight of 200 by 60 mm."""
    curve = smooth_paths.figure_eight(_START, _scaled(_ALONG, 0.1), _scaled(_ACROSS, 0.03))
    return _unseen("figure_eight", curve, speed)


def _random(speed: float = 0.1, seed: int = 0) -> Task:
    """A smooth random path in an ellipse of 240 by 60 mm, at -x for odd seeds."""
    seed = whole(seed)
    curve = smooth_paths.random_path(seed, _START, _scaled(_ALONG, 0.12), _scaled(_ACROSS, 0.03))
    return _unseen("random", curve.mirrored() if seed % 2 else curve, speed)


#: The thesis' tasks (sec. 6.6.1).
TASKS: dict[str, Maker] = {"step": _step, "swing": _swing, "lshape": _lshape}

#: Smooth paths of the tip at any speed, which no policy has met in its training.
UNSEEN_TASKS: dict[str, Maker] = {
    "circle": _circle,
    "figure_eight": _figure_eight,
    "random": _random,
}

#: All tasks of the arm.
ALL_TASKS = TASKS | UNSEEN_TASKS

#: Step widths [m] of Tabs. 6.2 to 6.4.
STEP_WIDTHS = (0.05, 0.1, 0.2)

#: Set points of a `reach` task.
_POINTS = 10


def _rig_task(name: str, trajectory: trajectories.Trajectory, duration: float) -> Task:
    return Task(name, RIG, trajectory, duration, (0.0, 0.0, 0.0), axes="xy")


def _triangle(period: float = 5.0) -> Task:
    """Laps of a triangle with rounded corners, of `period` [s], 10 s after the straight pose."""
    run = RoundedTriangle(period=float(period))
    return _rig_task("triangle", run, run.end_time)


def _rig_circle(radius: float = 0.12, speed: float = 0.05) -> Task:
    """From the straight pose out to a circle, one lap, and back; `radius` [m], `speed` [m/s]."""
    _check_radius(radius)
    run = LapCircle(radius=float(radius), speed=float(speed))
    return _rig_task("rig_circle", run, run.end_time)


def _reach(seed: int = 0, radius: float = WORKSPACE, hold: float = 3.0) -> Task:
    """Ten set points, uniform in a disc of `radius` [m], held for `hold` [s] one by one."""
    _check_radius(radius)
    distance, turn = np.random.default_rng(whole(seed)).uniform(size=(2, _POINTS))
    z = radius * np.sqrt(distance) * np.exp(2j * pi * turn)
    points = tuple((float(x.real), float(x.imag), 0.0) for x in z)
    return _rig_task("reach", trajectories.SetPoints(points, float(hold)), _POINTS * float(hold))


def _check_radius(radius: float) -> None:
    if not 0 < radius <= WORKSPACE:
        raise ValueError(f"radius must lie in (0, {WORKSPACE:g}] m, got {radius!r}")


#: All tasks of the test rig.
RIG_TASKS: dict[str, Maker] = {"triangle": _triangle, "rig_circle": _rig_circle, "reach": _reach}

#: Option -> tasks of both that have it.
WITH_OPTION = with_option(ALL_TASKS | RIG_TASKS)
