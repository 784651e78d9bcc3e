"""Trajectories against their definitions and each other's derivatives."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from softrobot_env.robots import ARM, centerline
from softrobot_env.trajectories import CurveSweep, EqualForceCurve, Polyline, Step

CURVE = EqualForceCurve(0.5)
SWEEP = CurveSweep(CURVE, half_length=0.5, speed=0.1)
CORNERS = Polyline(
    ((0.24, 0.0, 0.42), (0.24, 0.0, 0.30), (0.35, 0.0, 0.30)), times=(0.0, 5.0, 10.0)
)
JUMP = Step((0.1, 0.0, 0.4), (0.2, 0.0, 0.3))

#: Trajectory -> times [s] at which its position or velocity jumps.
KINKS = {"sweep": (SWEEP, (0.0, 10.0)), "polyline": (CORNERS, (0.0, 5.0, 10.0))}
KINKS["step"] = (JUMP, (0.0,))


def smooth_times(kinks, margin):
    t = np.linspace(-1, 14, 601) + 1e-3 / 3
    return t[np.min(np.abs(t[:, None] - np.array(kinks)), axis=1) > margin]


def tip_by_quadrature(a):
    """Tip of the beam with curvature a (3, 2, 1) on its thirds, by adaptive quadrature."""
    third = 0.5 / 3

    def angle(s):
        return a * sum(min(s, k * third) for k in (1, 2, 3))

    split = {"points": [third, 2 * third], "epsabs": 1e-13, "limit": 200}
    x = quad(lambda s: np.sin(angle(s)), 0, 0.5, **split)[0]
    z = quad(lambda s: np.cos(angle(s)), 0, 0.5, **split)[0]
    return np.array([x, 0.0, z])


@pytest.mark.parametrize("name", KINKS)
def test_velocity_is_the_derivative_of_position(name):
    trajectory, kinks = KINKS[name]
    h = 1e-4
    t = smooth_times(kinks, 2 * h)
    difference = (trajectory.position(t + h) - trajectory.position(t - h)) / (2 * h)
    # h^2 / 6 times the third derivative (below 1e-2 m/s3) and the rounding 1e-16 / h are below
    # 1e-10; the arc-length table's interpolation in steps of 0.04 errs by 0.04^4 / 384.
    np.testing.assert_allclose(trajectory.velocity(t), difference, atol=1e-8)


@pytest.mark.parametrize("name", KINKS)
def test_acceleration_is_the_derivative_of_velocity(name):
    trajectory, kinks = KINKS[name]
    h = 1e-4
    t = smooth_times(kinks, 2 * h)
    difference = (trajectory.velocity(t + h) - trajectory.velocity(t - h)) / (2 * h)
    # The largest acceleration is v^2 / radius = 0.01 / 0.4 m/s2.
    np.testing.assert_allclose(trajectory.acceleration(t), difference, atol=1e-6 * 0.025)


@pytest.mark.parametrize("name", KINKS)
def test_constant_outside_the_motion(name):
    trajectory, kinks = KINKS[name]
    for inside, outside in ((kinks[0], [-1e3, -1.0, -1e-9]), (kinks[-1], [20.0, 1e3])):
        outside = np.array(outside)
        expected = trajectory.position(outside[:1])[0]
        np.testing.assert_array_equal(trajectory.position(outside) - expected, 0.0)
        np.testing.assert_array_equal(trajectory.velocity(outside), 0.0)
        np.testing.assert_array_equal(trajectory.acceleration(outside), 0.0)
        if name != "step":
            gap = trajectory.position(np.array([inside]))[0] - expected
            np.testing.assert_allclose(gap, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", KINKS)
@pytest.mark.parametrize("n", [0, 1, 5])
def test_shapes(name, n):
    trajectory, _ = KINKS[name]
    t = np.linspace(0, 10, n)
    for quantity in (trajectory.position, trajectory.velocity, trajectory.acceleration):
        value = quantity(t)
        assert value.shape == (n, 3)
        assert value.dtype == np.float64
        assert value.flags.writeable
    path = trajectory.path()
    assert path.ndim == 2
    assert path.shape[1] == 3


@pytest.mark.parametrize("name", KINKS)
def test_path_runs_from_start_to_end(name):
    trajectory, kinks = KINKS[name]
    path = trajectory.path()
    ends = trajectory.position(np.array([kinks[0] - 1.0, kinks[-1] + 1.0]))
    np.testing.assert_allclose(path[[0, -1]], ends, atol=1e-12)


def test_just_after_a_kink_counts():
    np.testing.assert_array_equal(JUMP.position(np.array([0.0]))[0], JUMP.target)
    at_kinks = CORNERS.velocity(np.array([0.0, 5.0, 10.0]))
    np.testing.assert_allclose(
        at_kinks, [[0, 0, -0.024], [0.022, 0, 0], [0, 0, 0]], rtol=1e-12, atol=1e-16
    )
    speeds = np.linalg.norm(SWEEP.velocity(np.array([0.0, 10.0])), axis=1)
    np.testing.assert_allclose(speeds, [0.1, 0.0], rtol=1e-12)


def test_polyline_passes_its_waypoints():
    np.testing.assert_allclose(CORNERS.position(np.array(CORNERS.times)), CORNERS.waypoints)
    middle = CORNERS.position(np.array([2.5, 7.5]))
    np.testing.assert_allclose(middle, [[0.24, 0, 0.36], [0.295, 0, 0.30]])


@pytest.mark.parametrize("times", [(0.0, 5.0), (0.0, 5.0, 5.0), (0.0, 5.0, 4.0)])
def test_polyline_needs_one_increasing_time_per_waypoint(times):
    with pytest.raises(ValueError, match="one increasing time per waypoint"):
        Polyline(CORNERS.waypoints, times)


# ---------------------------------------------------------------- the equal-force curve


@pytest.mark.parametrize("a", [-1.7, -0.6, 0.0, 0.6, 1.276, 2.0])
def test_curve_is_the_tip_of_the_bent_arm(a):
    tip = CURVE.derivative(np.array([a]), 0)[0]
    np.testing.assert_allclose(tip, tip_by_quadrature(a), atol=1e-12)
    shape = centerline(ARM, a * np.array([3, 3, 2, 2, 1, 1]))
    np.testing.assert_allclose(tip, shape[-1], atol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_curve_derivatives(order):
    a, h = np.linspace(-1.9, 1.9, 77), 1e-5
    below, above = CURVE.derivative(a - h, order - 1), CURVE.derivative(a + h, order - 1)
    # h^2 / 6 times a derivative below 1 m, and rounding 1e-16 / h.
    np.testing.assert_allclose(CURVE.derivative(a, order), (above - below) / (2 * h), atol=1e-9)


def test_curve_lies_near_the_circle_of_the_audit():
    """Within 1.2 mm of the circle about (0, 0.1) with radius 0.4 m."""
    points = CURVE.derivative(np.linspace(-1.6714, 1.6714, 401), 0)
    radius = np.hypot(points[:, 0], points[:, 2] - 0.1)
    assert np.max(np.abs(radius - 0.4)) <= 1.2e-3


@pytest.mark.parametrize("start", [-1.0, 0.0, 0.6])
@pytest.mark.parametrize("distance", [0.001, 0.05, 0.2, 0.25])
def test_parameter_at_distance(start, distance):
    a = CURVE.parameter_at_distance(start, distance)
    gap = tip_by_quadrature(a) - tip_by_quadrature(start)
    assert a > start
    assert np.linalg.norm(gap) == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("distance", [0.0, -0.05, 0.4, np.nan, np.inf])
def test_distance_out_of_reach(distance):
    with pytest.raises(ValueError, match=r"step width must lie in \(0, \d+\] mm"):
        CURVE.parameter_at_distance(0.6, distance)


# ---------------------------------------------------------------- the sweep


@pytest.mark.parametrize("t", [0.5, 2.5, 4.99, 5.0, 7.5, 9.9])
def test_sweep_has_run_the_right_arc_length(t):
    """Arc length from the straight pose, by adaptive quadrature of the curve's speed."""
    x, _, z = SWEEP.position(np.array([t]))[0]
    a = brentq(lambda a: np.arctan2(*tip_by_quadrature(a)[[0, 2]]) - np.arctan2(x, z), -2, 2)
    np.testing.assert_allclose(tip_by_quadrature(a), [x, 0, z], atol=1e-10)
    arc = quad(lambda p: np.linalg.norm(CURVE.derivative(np.array([p]), 1)), 0, a)[0]
    assert arc == pytest.approx(0.1 * t - 0.5, abs=1e-8)


def test_sweep_keeps_its_speed():
    speed = np.linalg.norm(SWEEP.velocity(np.linspace(0, 9.999, 500)), axis=1)
    np.testing.assert_allclose(speed, 0.1, rtol=1e-12)


def test_sweep_is_mirror_symmetric():
    t = np.linspace(0, 5, 101)
    there, back = SWEEP.position(t), SWEEP.position(10 - t)
    np.testing.assert_allclose(there, back * [-1, 1, 1], atol=1e-12)


def test_acceleration_is_normal_to_the_path():
    t = np.linspace(0.01, 9.99, 200)
    along = np.sum(SWEEP.velocity(t) * SWEEP.acceleration(t), axis=1)
    np.testing.assert_allclose(along, 0.0, atol=1e-16)


@pytest.mark.parametrize(
    "changes",
    [{"half_length": 1.0}, {"half_length": -0.5}, {"speed": 0.0}, {"speed": -0.1}],
    ids=str,
)
def test_sweeps_that_cannot_be(changes):
    valid = {"half_length": 0.5, "speed": 0.1}
    with pytest.raises(ValueError, match="a sweep needs"):
        CurveSweep(EqualForceCurve(0.5), **(valid | changes))
