"""Tasks of the test rig."""

import numpy as np
import pytest

from softrobot_env.robots import RIG, WORKSPACE
from softrobot_env.tasks import RIG_TASKS, SetPoints, Task, make_task
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle


def test_tasks_are_those_of_the_audit():
    triangle = make_task("triangle", period=1.0)
    assert triangle.trajectory == RoundedTriangle(period=1.0)
    assert triangle.duration == pytest.approx(17.0)
    assert make_task("triangle").duration == pytest.approx(45.0)
    assert triangle.label == "triangle 1 s"
    circle = make_task("rig_circle")
    assert circle.trajectory == LapCircle(radius=0.12, speed=0.05)
    assert circle.duration == pytest.approx(35.08, abs=0.01)
    for name, make in RIG_TASKS.items():
        assert make_task(name).trajectory == make().trajectory
        assert make_task(name).robot is RIG


def test_set_points_fill_the_workspace():
    points = np.concatenate([make_task("reach", seed=s).trajectory.points for s in range(100)])
    square = np.sum(points**2, axis=1) / WORKSPACE**2
    assert square.max() < 1
    # Uniform in the disc: the squared distance is uniform in [0, 1].
    assert square.mean() == pytest.approx(0.5, abs=0.03)
    assert np.abs(points.mean(axis=0)).max() < 0.1 * WORKSPACE
    assert make_task("reach", seed=1) == make_task("reach", seed=1)


def test_set_points_are_held():
    points = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0))
    run = SetPoints(points, 3.0)
    times = np.array([-1.0, 0.0, 2.999, 3.0, 100.0])
    np.testing.assert_array_equal(run.position(times), np.array(points)[[0, 0, 0, 1, 1]])
    assert not run.velocity(times).any()
    assert run.acceleration(times).shape == (5, 3)
    np.testing.assert_array_equal(run.path(), points)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("wave", {}, "triangle, rig_circle, reach"),
        ("triangle", {"speed": 1.0}, "it has period"),
        ("triangle", {"period": "fast"}, "must be a number"),
        ("rig_circle", {"radius": -0.1}, "0.121"),
        ("rig_circle", {"radius": 0.13}, "0.121"),
        ("rig_circle", {"speed": 0.0}, "speed must be finite and positive"),
        ("reach", {"seed": 0.5}, "whole number"),
        ("reach", {"radius": 0.2}, "0.121"),
        ("reach", {"hold": 0.0}, "hold must be finite and positive"),
    ],
)
def test_bad_tasks_are_named(name, options, message):
    with pytest.raises(ValueError, match=message):
        make_task(name, **options)


def task_of(start=(0.0,) * 3, duration=1.0):
    return Task("short", RIG, RoundedTriangle(), duration, start, axes="xy")


@pytest.mark.parametrize(
    ("make", "values", "allowed"),
    [
        (task_of, [(0.0, 0.0)], "3 tendon inputs, start_input 2"),
        (lambda duration: task_of(duration=duration), [0.0], "duration"),
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
    ],
)
def test_what_cannot_be_is_refused(make, values, allowed):
    for value in values:
        with pytest.raises(ValueError, match=allowed):
            make(value)
