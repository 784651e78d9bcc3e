"""The study of sensors: grips and series against the audit, shapes against geometry."""

import numpy as np
import pytest

from softrobot_env.robots import Sensor
from softrobot_env.sensing.calibration import Range, fit
from studies import sensing
from studies.sensing import Row


def test_a_simulated_finger_wraps_as_the_audit_says(monkeypatch):
    """52 degrees of the second sensor round 60 mm, and sensors read it while it presses."""
    monkeypatch.setattr(sensing, "_CLOSING", 0.5)
    monkeypatch.setattr(sensing, "_HELD", 0.2)
    grip = sensing._gripped("60 mm", 20.0)
    held = slice(27, 33)
    size = np.diff(grip.edges)
    bends = np.degrees((grip.strain[held, :, 0] * size).reshape(6, 3, -1).sum(axis=2))
    np.testing.assert_allclose(bends[:, 1], 52.1, atol=1.5)
    assert (bends[:, 0] < 45).all()  # straight where it leaves its clamp
    assert (grip.touch[held, 1] > 0.1).all() and not grip.touch[0, 1:3].any()
    light, turns = sensing._finger_read(grip, 1)
    noise = 6 * 5e-3 * np.sqrt(2)
    np.testing.assert_allclose(np.degrees(turns[held]), bends, atol=np.degrees(noise))
    assert (light[held] < 0.7).all()


def test_shapes_of_constant_curvature_are_arcs():
    points = sensing._chain(np.full(9, 20.0), np.full(9, 0.01))
    np.testing.assert_allclose(np.hypot(points[:, 0] - 0.05, points[:, 1]), 0.05, atol=1e-12)


@pytest.mark.parametrize(("gap", "low", "high"), [(10, 2.0, 4.0), (20, 5.5, 9.5), (25, 9.5, 13.5)])
def test_unequal_angles_err_as_the_audit_says(gap, low, high):
    """2.9 degrees at 10 of difference, 6 to 9 at 20, 10 to 13 at 25; an ideal sensor."""
    ideal = Sensor("ideal", "planar", 0.0, 0.03, noise=0.0)
    even = np.radians(np.linspace(0, 30, 121))
    light = sensing.read(ideal, np.stack([even, even], axis=1), 50.0)
    scale = Range.of(light)
    found = fit(scale.relative(light), 2 * even, 5)
    least = np.radians(np.linspace(0, 30 - gap, 41))
    apart = np.stack([least, least + np.radians(gap)], axis=1)
    error = found(scale.relative(sensing.read(ideal, apart, 50.0))) - apart.sum(axis=1)
    assert low < np.degrees(np.abs(error).max()) < high


def test_a_goal_is_judged_and_no_goal_is_not():
    assert Row("", "error", 1.0, "mm", "check", goal=1.5).met is True
    assert Row("", "error", 2.0, "mm", "check", goal=1.5).met is False
    assert Row("", "error", 2.0, "mm", "check").met is None
