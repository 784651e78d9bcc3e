"""Tasks of the test rig."""

import numpy as np
import pytest

from softrobot_env.robots import RIG, WORKSPACE
from softrobot_env.tasks import RIG_TASKS, SetPoints, make_task
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


# ---------------------------------------------------------------- trajectories


def test_triangle_is_the_audits():
    """Corners 87.5 mm, middles of the sides 52.5 mm from the centre, corners 151.6 mm apart."""
    run = RoundedTriangle(period=1.0, approach=10.0)
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


@pytest.mark.parametrize("run", [RoundedTriangle(), RoundedTriangle(approach=0.0), LapCircle()])
def test_positions_lie_on_the_path(run):
    path = run.path()
    position = run.position(np.linspace(0, run.end_time, 300))
    gap = np.linalg.norm(position[:, None] - path, axis=2).min(axis=1)
    assert np.median(gap) < 2e-3
