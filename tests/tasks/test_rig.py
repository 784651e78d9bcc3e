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


# ---------------------------------------------------------------- trajectories

#: Smooth ones, and the times [s] at which their formulas change.
SMOOTH = [
    (RoundedTriangle(period=1.0), (0, 10, 12, 15, 17)),
    (RoundedTriangle(period=5.0, laps=0, approach=3.0), (0, 3, 13, 23)),
    (RoundedTriangle(b1=0.05, period=2.0, laps=1, approach=0.0), (0, 4, 6, 10)),
    (LapCircle(ramp=2.0), (0, 10, 12, *(10 + 4.8 * np.pi + np.array([0, 2, 12])))),
    (
        LapCircle(radius=0.09, speed=0.9, approach=2.0, ramp=0.1, laps=3),
        (0, 2, 2.1, *(2 + 0.6 * np.pi + np.array([0, 0.1, 2.1]))),
    ),
]


@pytest.mark.parametrize(("run", "joints"), SMOOTH)
def test_derivatives_are_those_of_the_position(run, joints):
    t = np.linspace(-0.5, run.end_time + 0.5, 1777)
    t = t[np.min(np.abs(t[:, None] - np.array(joints)), axis=1) > 0.01]
    for value, rate in ((run.position, run.velocity), (run.velocity, run.acceleration)):
        errors = []
        for h in (4e-3, 2e-3):
            near, far = value(t + h) - value(t - h), value(t + 2 * h) - value(t - 2 * h)
            errors.append(np.abs(rate(t) - (8 * near - far) / (12 * h)).max())
        assert errors[1] < max(1e-10, errors[0] / 12)  # of fourth order


@pytest.mark.parametrize(("run", "joints"), SMOOTH)
def test_position_velocity_and_acceleration_are_continuous(run, joints):
    for value in (run.position, run.velocity, run.acceleration):
        for joint in (*joints, run.end_time):
            jump = value(np.array([joint + 1e-9])) - value(np.array([joint - 1e-9]))
            assert np.abs(jump).max() < 1e-6


@pytest.mark.parametrize(("run", "_"), SMOOTH)
def test_at_rest_before_and_after(run, _):
    t = np.array([-1.0, -1e-9, run.end_time + 1e-9, run.end_time + 5])
    assert np.array_equal(run.velocity(t), np.zeros((4, 3)))
    assert np.abs(run.acceleration(t)).max() < 1e-12
    np.testing.assert_allclose(run.position(t[2:3]), run.position(t[3:]), atol=1e-15)


def test_triangle_is_the_audits():
    """Corners 87.5 mm, middles of the sides 52.5 mm from the centre, corners 151.6 mm apart."""
    run = RoundedTriangle(period=1.0, approach=10.0)
    assert run.end_time == 17.0  # thesis: 17 s, and 45 s with a period of 5 s
    assert RoundedTriangle(period=5.0).end_time == 45.0
    np.testing.assert_allclose(run.position(np.array([0.0, 10.0])), [[0, 0, 0], [0.0875, 0, 0]])
    lap = run.position(12 + np.arange(7) / 6)
    radius = np.hypot(*lap.T[:2])
    np.testing.assert_allclose(radius[::2], 0.0875)
    np.testing.assert_allclose(radius[1::2], 0.0525)
    assert np.linalg.norm(lap[2] - lap[0]) == pytest.approx(0.1516, abs=1e-4)
    turning = np.unwrap(np.arctan2(lap[:, 1], lap[:, 0]))
    assert turning[-1] - turning[0] == pytest.approx(-2 * np.pi)  # clockwise


def test_triangle_runs_as_many_laps_as_it_says():
    run = RoundedTriangle(period=1.0, laps=3, approach=0.0)
    position = run.position(np.linspace(0, run.end_time, 2001))
    angle = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
    assert angle[-1] == pytest.approx(-2 * np.pi * 5)  # one more to speed up and to slow down
    t = np.linspace(2, 4, 300)
    np.testing.assert_allclose(run.position(t), run.position(t + 1), atol=1e-15)


def test_circle_is_run_once_counter_clockwise_at_constant_speed():
    run = LapCircle()
    begin, end = run.lap_time
    assert (begin, end) == (10.0, pytest.approx(10 + 15.08, abs=1e-3))
    t = np.linspace(begin, end, 400, endpoint=False)
    position, velocity = run.position(t), run.velocity(t)
    np.testing.assert_allclose(np.hypot(*position.T[:2]), 0.12)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 0.05)
    assert np.all(np.cross(position, velocity)[:, 2] > 0)
    np.testing.assert_allclose(run.acceleration(t), -(run.rate**2) * position, atol=1e-15)
    np.testing.assert_allclose(run.position(np.array([0.0, run.end_time])), 0, atol=1e-15)
    assert run.end_time == pytest.approx(35.08, abs=1e-3)


@pytest.mark.parametrize("run", [RoundedTriangle(), RoundedTriangle(approach=0.0), LapCircle()])
def test_positions_lie_on_the_path(run):
    path = run.path()
    position = run.position(np.linspace(0, run.end_time, 300))
    gap = np.linalg.norm(position[:, None] - path, axis=2).min(axis=1)
    assert np.median(gap) < 2e-3


# ---------------------------------------------------------------- what cannot be


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
        (lambda b1: RoundedTriangle(b1=b1), [0.0], "b1 must be finite and positive"),
        (lambda period: RoundedTriangle(period=period), [-1.0], "period must be"),
        (lambda n: RoundedTriangle(laps=n), [-1], "laps must be a whole number, 0 or more"),
        (lambda t: RoundedTriangle(approach=t), [np.inf], "approach must be finite and zero or"),
        (lambda radius: LapCircle(radius=radius), [np.nan], "radius must be"),
        (lambda laps: LapCircle(laps=laps), [0], "laps must be a whole number, 1 or more"),
        (lambda ramp: LapCircle(ramp=ramp), [20.0], r"ramp must lie in \[0, 15.1\] s"),
    ],
)
def test_what_cannot_be_is_refused(make, values, allowed):
    for value in values:
        with pytest.raises(ValueError, match=allowed):
            make(value)
