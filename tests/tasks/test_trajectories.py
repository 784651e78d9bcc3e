"""Trajectories against their definitions and each other's derivatives."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from softrobot_env.robots import ARM, centerline
from softrobot_env.tasks.smooth_paths import SmoothRun, circle, figure_eight, random_path
from softrobot_env.tasks.trajectories import CurveSweep, EqualForceCurve, Polyline, Step
from softrobot_env.thesis.trajectories import LapCircle, RoundedTriangle

CURVE = EqualForceCurve(0.5)
SWEEP = CurveSweep(CURVE, half_length=0.5, speed=0.1)
CORNERS = Polyline(
    ((0.24, 0.0, 0.42), (0.24, 0.0, 0.30), (0.35, 0.0, 0.30)), times=(0.0, 5.0, 10.0)
)
JUMP = Step((0.1, 0.0, 0.4), (0.2, 0.0, 0.3))

#: Trajectory -> times [s] at which its position or velocity jumps.
KINKS = {"sweep": (SWEEP, (0.0, 10.0)), "polyline": (CORNERS, (0.0, 5.0, 10.0))}
KINKS["step"] = (JUMP, (0.0,))

START, ALONG, ACROSS = (0.3, 0.0, 0.3), (0.06, 0.0, -0.08), (-0.024, 0.0, -0.018)
CIRCLE = SmoothRun(circle(START, (0.33, 0.0, 0.26)), speed=0.4, laps=2)  # radius 50 mm
EIGHT = SmoothRun(figure_eight(START, ALONG, ACROSS), speed=0.3)
RANDOM = SmoothRun(random_path(3, START, ALONG, ACROSS), speed=0.2, ramp=0.3)
SMOOTH = {"circle": CIRCLE, "eight": EIGHT, "random": RANDOM}

#: Smooth trajectory -> times [s] at which its formula changes, from its begin to its end.
RUNS = {n: (r, (0.0, r.ramp, r.end_time - r.ramp, r.end_time)) for n, r in SMOOTH.items()} | {
    "triangle": (RoundedTriangle(period=1.0), (0, 10, 12, 15, 17)),
    "no laps": (RoundedTriangle(period=5.0, laps=0, approach=3.0), (0, 3, 13, 23)),
    "no approach": (RoundedTriangle(b1=0.05, period=2.0, laps=1, approach=0.0), (0, 4, 6, 10)),
    "lap": (LapCircle(ramp=2.0), (0, 10, 12, *(10 + 4.8 * np.pi + np.array([0, 2, 12])))),
    "laps": (
        LapCircle(radius=0.09, speed=0.9, approach=2.0, ramp=0.1, laps=3),
        (0, 2, 2.1, *(2 + 0.6 * np.pi + np.array([0, 0.1, 2.1]))),
    ),
}
ALL = KINKS | RUNS


def tip_by_quadrature(a):
    """Tip of the beam with curvature a (3, 2, 1) on its thirds, by adaptive quadrature."""
    third = 0.5 / 3

    def angle(s):
        return a * sum(min(s, k * third) for k in (1, 2, 3))

    split = {"points": [third, 2 * third], "epsabs": 1e-13, "limit": 200}
    x = quad(lambda s: np.sin(angle(s)), 0, 0.5, **split)[0]
    z = quad(lambda s: np.cos(angle(s)), 0, 0.5, **split)[0]
    return np.array([x, 0.0, z])


@pytest.mark.parametrize("name", ALL)
def test_constant_outside_the_motion(name):
    trajectory, kinks = ALL[name]
    for inside, outside in ((kinks[0], [-1e3, -1.0, -1e-9]), (kinks[-1], [1e-9, 5.0, 1e3])):
        outside = inside + np.array(outside)
        expected = trajectory.position(outside[:1])[0]
        np.testing.assert_array_equal(trajectory.position(outside) - expected, 0.0)
        np.testing.assert_array_equal(trajectory.velocity(outside), 0.0)
        np.testing.assert_array_equal(trajectory.acceleration(outside), 0.0)
        if name != "step":
            gap = trajectory.position(np.array([inside]))[0] - expected
            np.testing.assert_allclose(gap, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("n", [0, 1, 5])
def test_shapes(name, n):
    trajectory, _ = ALL[name]
    t = np.linspace(0, 10, n)
    for quantity in (trajectory.position, trajectory.velocity, trajectory.acceleration):
        value = quantity(t)
        assert value.shape == (n, 3)
        assert value.dtype == np.float64
        assert value.flags.writeable
    path = trajectory.path()
    assert path.ndim == 2
    assert path.shape[1] == 3


@pytest.mark.parametrize("name", [name for name in ALL if not name.startswith("lap")])
def test_path_runs_from_start_to_end(name):
    trajectory, kinks = ALL[name]
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


# ---------------------------------------------------------------- the equal-force curve


@pytest.mark.parametrize("a", [-1.7, -0.6, 0.0, 0.6, 1.276, 2.0])
def test_curve_is_the_tip_of_the_bent_arm(a):
    tip = CURVE.derivative(np.array([a]), 0)[0]
    np.testing.assert_allclose(tip, tip_by_quadrature(a), atol=1e-12)
    shape = centerline(ARM, a * np.array([3, 3, 2, 2, 1, 1]))
    np.testing.assert_allclose(tip, shape[-1], atol=1e-12)


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


# ---------------------------------------------------------------- smooth runs of closed paths


#: Weights of the central difference of sixth order at 1, 2 and 3 steps.
WEIGHTS = (3 / 4, -3 / 20, 1 / 60)


def difference(function, t, h):
    """Derivative (n, 3) of a function of time to sixth order."""
    steps = enumerate(WEIGHTS, start=1)
    return sum(w * (function(t + k * h) - function(t - k * h)) for k, w in steps) / h


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_derivatives_converge_to_sixth_order(name, quantity):
    """Away from the joints, where higher derivatives jump.

    The sweep's arc-length table errs by some 1e-9; all others by rounding.
    """
    (run, joints), h = ALL[name], 4e-3
    exact = {"position": run.velocity, "velocity": run.acceleration}[quantity]
    t = np.linspace(joints[0] - 1, joints[-1] + 4, 1777)
    t = t[np.min(np.abs(t[:, None] - np.array(joints)), axis=1) > 3 * h]
    errors = [
        np.abs(difference(getattr(run, quantity), t, step) - exact(t)).max() for step in (h, h / 2)
    ]
    assert errors[1] < 1e-6
    # Terms of eighth order change the ratio 2^6 by a few percent, and so does rounding.
    least = 2e-9 if name == "sweep" else 1e-10
    assert errors[1] < least or errors[0] / errors[1] == pytest.approx(64, rel=0.1)


@pytest.mark.parametrize("name", RUNS)
def test_runs_go_on_smoothly_and_begin_and_end_at_rest(name):
    run, joints = RUNS[name]
    joints, gap = np.array(joints), 1e-9
    for quantity in (run.position, run.velocity, run.acceleration):
        np.testing.assert_allclose(quantity(joints + gap), quantity(joints - gap), atol=1e-6)
    for quantity in (run.velocity, run.acceleration):
        np.testing.assert_allclose(quantity(joints[[0, -1]] + [gap, -gap]), 0.0, atol=1e-8)


@pytest.mark.parametrize("name", SMOOTH)
def test_the_speed_is_that_where_the_path_is_fastest(name):
    run = SMOOTH[name]
    speed = np.linalg.norm(run.velocity(np.linspace(0, run.end_time, 20_001)), axis=1)
    assert speed.max() <= run.speed * (1 + 1e-9)
    assert speed.max() == pytest.approx(run.speed, rel=1e-4)


def test_circle_has_its_radius_and_length():
    t = np.linspace(0, CIRCLE.end_time, 2001)
    steady = t[(t > CIRCLE.ramp) & (t < CIRCLE.end_time - CIRCLE.ramp)]
    gap = CIRCLE.position(t) - [0.33, 0.0, 0.26]
    np.testing.assert_allclose(np.linalg.norm(gap, axis=1), 0.05, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(CIRCLE.velocity(steady), axis=1), 0.4, rtol=1e-12)
    way = quad(
        lambda t: np.linalg.norm(CIRCLE.velocity(np.array([t]))), 0, CIRCLE.end_time, limit=200
    )[0]
    assert way == pytest.approx(2 * 2 * np.pi * 0.05, rel=1e-7)


def test_circle_turns_from_up_to_right():
    run = SmoothRun(circle((0.0, 0.0, 0.1), (0.0, 0.0, 0.0)), speed=0.1)
    quarter = np.array([run.end_time / 2 - np.pi / 2 / run.rate])
    np.testing.assert_allclose(run.position(quarter), [[0.1, 0.0, 0.0]], atol=1e-15)


def test_figure_eight_by_its_definition():
    phase = np.linspace(0, 2 * np.pi, 101)
    expected = START + np.outer(np.sin(phase), ALONG) + np.outer(np.sin(2 * phase), ACROSS)
    np.testing.assert_allclose(EIGHT.curve.derivative(phase, 0), expected, atol=1e-15)
    # Orthogonal axes of 100 and 30 mm: fastest at the crossing.
    assert EIGHT.curve.top_rate == pytest.approx(np.hypot(0.1, 2 * 0.03), rel=1e-12)
    crossing = EIGHT.position(np.array([EIGHT.end_time / 2]))
    np.testing.assert_allclose(crossing, [START], atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_random_paths_just_fill_their_ellipse(seed):
    path = random_path(seed, START, ALONG, ACROSS)
    gap = path.derivative(np.linspace(0, 2 * np.pi, 5001), 0) - START
    along, across = gap @ ALONG / 0.1**2, gap @ ACROSS / 0.03**2
    assert np.hypot(along, across).max() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(gap[[0, -1]], 0.0, atol=1e-14)


def test_mirrored_paths():
    phase = np.linspace(0, 6, 31)
    path = RANDOM.curve
    expected = path.derivative(phase, 0) * [-1, 1, 1]
    np.testing.assert_allclose(path.mirrored().derivative(phase, 0), expected, atol=1e-15)
