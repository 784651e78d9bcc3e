"""The study of sensors: shapes of grips against geometry, series against the audit."""

import numpy as np
import pytest

from softrobot_env.benchmarks.sensing import finger, planar
from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.robots import Sensor
from softrobot_env.sensing.calibration import Range, fit


@pytest.mark.parametrize(("diameter", "turn"), [(0.048, 64), (0.060, 52), (0.094, 34)])
def test_a_wrapped_finger_turns_as_the_audit_says(diameter, turn):
    kappa = finger._enclosing(diameter)
    assert np.degrees(kappa[:30].sum() * 1e-3) == pytest.approx(turn, abs=0.7)


def test_a_fibre_round_the_oval_bends_between_the_ends_of_its_axes():
    """An ellipse has the curvatures a / b^2 and b / a^2 there; a fibre beside it less."""
    a, b = finger._OVAL
    bends = np.array([1 / (b**2 / a + finger._FIBRE), 1 / (a**2 / b + finger._FIBRE)])
    kappa = finger._enclosing((a, b))
    np.testing.assert_allclose([kappa.min(), kappa.max()], np.sort(bends), rtol=0.01)


def test_shapes_of_constant_curvature_are_arcs():
    points = finger._chain(np.full(9, 20.0), 0.01)
    np.testing.assert_allclose(np.hypot(points[:, 0] - 0.05, points[:, 1]), 0.05, atol=1e-12)


@pytest.mark.parametrize(("gap", "low", "high"), [(10, 2.0, 4.0), (20, 5.5, 9.5), (25, 9.5, 13.5)])
def test_unequal_angles_err_as_the_audit_says(gap, low, high):
    """2.9 degrees at 10 of difference, 6 to 9 at 20, 10 to 13 at 25; an ideal sensor."""
    ideal = Sensor("ideal", "planar", 0.0, 0.03, noise=0.0)
    even = np.radians(np.linspace(0, 30, 121))
    light = planar.read(ideal, np.stack([even, even], axis=1), 50.0)
    scale = Range.of(light)
    found = fit(scale.relative(light), 2 * even, 5)
    least = np.radians(np.linspace(0, 30 - gap, 41))
    apart = np.stack([least, least + np.radians(gap)], axis=1)
    error = found(scale.relative(planar.read(ideal, apart, 50.0))) - apart.sum(axis=1)
    assert low < np.degrees(np.abs(error).max()) < high


def test_a_goal_is_judged_and_no_goal_is_not():
    assert Row("", "error", 1.0, "mm", "check", goal=1.5).met is True
    assert Row("", "error", 2.0, "mm", "check", goal=1.5).met is False
    assert Row("", "error", 2.0, "mm", "check").met is None
