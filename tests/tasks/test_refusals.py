"""What no task or trajectory can be is refused in words that name what is allowed."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.robots import ARM, CANTILEVER_WEAK, RIG, Base
from softrobot_env.tasks import ALL_TASKS, SetPoints, Task, make_task
from softrobot_env.tasks.smooth_paths import FourierPath, SmoothRun, circle, random_path
from softrobot_env.tasks.trajectories import CurveSweep, EqualForceCurve, Polyline
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle

TRUNK = {"robot": "hanging_trunk"}

#: (task, options, what the message says)
OPTIONS = [
    *((name, {}, "unknown task.*" + ".*".join(ALL_TASKS)) for name in ("jump", "", "Step", "arm")),
    ("swing", {"speed": 0.1}, "it has none"),
    ("step", {"seed": 1}, "it has step_width"),
    ("circle", {"seed": 1}, "it has speed"),
    ("random", {"seed": -1}, "whole number >= 0"),
    ("random", {"seed": "1"}, "must be a number"),
    ("circle", {"speed": 0.0}, r"must lie in \(0, 1.01\] m/s"),
    ("circle", {"speed": 9.0}, "must lie in"),
    ("circle", {"speed": 1e-9}, "duration"),
    *((n, {"step_width": 0.1}, "has no option 'step_width'") for n in ("swing", "lshape")),
    *(("step", {"step_width": x}, r"\(0, \d+\] mm") for x in (0.0, -0.1, 0.5, np.nan, np.inf)),
    ("wave", {}, "triangle, rig_circle, reach"),
    ("triangle", {"speed": 1.0}, "it has period"),
    ("triangle", {"period": "fast"}, "must be a number"),
    ("rig_circle", {"radius": -0.1}, "0.121"),
    ("rig_circle", {"radius": 0.13}, "0.121"),
    ("rig_circle", {"speed": 0.0}, "speed must be finite and positive"),
    ("reach", {"seed": 0.5}, "whole number"),
    ("reach", {"radius": 0.2}, "0.121"),
    ("reach", {"hold": 0.0}, "hold must be finite and positive"),
    ("circle", TRUNK | {"radius": 0.3}, "cannot hold its tip at"),
    ("circle", TRUNK | {"radius": -0.1}, "radius must be positive"),
    ("circle", TRUNK | {"frequency": 0.0}, "frequency must be positive"),
    ("circle", TRUNK | {"frequency": 0.1, "speed": 0.1}, "speed or its frequency, not both"),
    ("circle", TRUNK | {"period": 1.0}, "no option 'period'; it has radius, speed"),
    ("random", TRUNK | {"seed": 0.5}, "seed must be a whole number"),
    ("triangle", TRUNK, "unknown task 'triangle'; choose from reach, circle"),
    ("circle", {"robot": "nobody"}, "unknown robot 'nobody'"),
]


@pytest.mark.parametrize(("name", "options", "message"), OPTIONS, ids=str)
def test_options_that_cannot_be(name, options, message):
    with pytest.raises(ValueError, match=message):
        make_task(name, **options)


START, ALONG, ACROSS = (0.3, 0.0, 0.3), (0.06, 0.0, -0.08), (-0.024, 0.0, -0.018)
CORNERS = ((0.24, 0.0, 0.42), (0.24, 0.0, 0.30), (0.35, 0.0, 0.30))
CURVE = EqualForceCurve(0.5)


def run_of(**changes):
    """Two laps of 0.1 pi m leave room for the ramps of 0.5 s up to 0.2 pi / 0.5 m/s."""
    given = {"curve": circle(START, (0.33, 0.0, 0.26)), "speed": 0.4, "laps": 2}
    return SmoothRun(**given | changes)


def sweep_of(**changes):
    return CurveSweep(CURVE, **({"half_length": 0.5, "speed": 0.1} | changes))


def swing_of(**changes):
    return replace(make_task("swing"), **changes)


def task_of(start):
    return Task("short", RIG, RoundedTriangle(), 1.0, start, axes="xy")


@pytest.mark.parametrize(
    ("make", "values", "allowed"),
    [
        (lambda duration: swing_of(duration=duration), [-1.0, 1e9], "duration"),
        (lambda start: swing_of(start_input=start), [(1.0,)], "3 tendon inputs"),
        (lambda robot: swing_of(robot=robot, start_input=()), [CANTILEVER_WEAK], "at least one"),
        (
            lambda towards: swing_of(robot=replace(ARM, base=Base(direction=towards))),
            [(0.0, 1.0, 0.0)],
            "moves in space, axes must be xy or xyz",
        ),
        (task_of, [(0.0, 0.0)], "3 tendon inputs, start_input 2"),
        (
            lambda length: task_of((0.0, length, 0.0)),
            [0.031, -0.031],
            r"start_input must lie between \[-0.03, -0.03, -0.03\] and .* m",
        ),
        (
            lambda length: task_of((0.0, length, 0.0)),
            [np.nan, np.inf],
            r"start_input\[1\] must be a finite number",
        ),
        (
            lambda point: SetPoints(((0.0, 0.0, 0.0), point), 1.0),
            [(0.1, 0.0), (0.1, np.nan, 0.0), (np.inf, 0.0, 0.0)],
            r"points\[1\].* finite number",
        ),
        (lambda b1: RoundedTriangle(b1=b1), [0.0], "b1 must be finite and positive"),
        (lambda period: RoundedTriangle(period=period), [-1.0], "period must be"),
        (lambda n: RoundedTriangle(laps=n), [-1], "laps must be a whole number, 0 or more"),
        (lambda t: RoundedTriangle(approach=t), [np.inf], "approach must be finite and zero or"),
        (lambda laps: LapCircle(laps=laps), [0], "laps must be a whole number, 1 or more"),
        (lambda ramp: LapCircle(ramp=ramp), [20.0], r"ramp must lie in \[0, 15.1\] s"),
        (
            lambda times: Polyline(CORNERS, times),
            [(0.0, 5.0), (0.0, 5.0, 5.0), (0.0, 5.0, 4.0)],
            "one increasing time per waypoint",
        ),
        (
            lambda distance: CURVE.parameter_at_distance(0.6, distance),
            [0.0, -0.05, 0.4, np.nan, np.inf],
            r"step width must lie in \(0, \d+\] mm",
        ),
        (lambda half: sweep_of(half_length=half), [1.0, -0.5], "a sweep needs"),
        (lambda speed: sweep_of(speed=speed), [0.0, -0.1], "a sweep needs"),
        (
            lambda seed: random_path(seed, START, ALONG, ACROSS),
            [-1, 0.5, "0", None, True],
            "whole number >= 0",
        ),
        (lambda v: run_of(speed=v), [0.0, -0.1, 1.3], r"must lie in \(0, 1.26\] m/s"),
        (lambda laps: run_of(laps=laps), [0], "laps must be a whole number, 1 or more"),
        (lambda ramp: run_of(ramp=ramp), [0.0], "ramp must be finite and positive"),
        (lambda sine: FourierPath(START, ((1.0, 0, 0),), sine), [()], "as many cosines as sines"),
        (
            lambda one: FourierPath(START, (one,), (one,)),
            [(1.0, 0.0)],
            r"cosine\[0\] must be a tuple of 3",
        ),
        (lambda one: FourierPath(START, (one,), (one,)), [(0.0,) * 3], "not stay at its start"),
    ],
)
def test_what_cannot_be_is_refused(make, values, allowed):
    for value in values:
        with pytest.raises(ValueError, match=allowed):
            make(value)
