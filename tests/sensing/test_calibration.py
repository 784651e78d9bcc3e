"""Calibration and estimates against what is known of made-up sensors."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.robots import RIG, Sensor
from softrobot_env.sensing.array import SensorArray
from softrobot_env.sensing.calibration import (
    AngleErrors,
    Calibration,
    Range,
    curvatures,
    fit,
)
from softrobot_env.sensing.estimation import BendFilter, calibrate
from studies.sensing import read


def test_least_squares_finds_a_polynomial_and_refuses_too_few():
    at = np.linspace(0, 100, 40)
    found = fit(at, np.radians(60 - 0.5 * at + 1e-3 * at**2), 2)
    np.testing.assert_allclose(np.degrees(found(at)), 60 - 0.5 * at + 1e-3 * at**2, atol=1e-9)
    with pytest.raises(ValueError, match="3 samples cannot determine 4 coefficients"):
        fit(at[:3], at[:3], 3)
    scale = Range.of(np.array([0.3, 1.1, 0.5]))
    np.testing.assert_allclose(scale.relative(np.array([0.3, 0.7, 1.1])), [0, 50, 100])
    errors = AngleErrors.of(np.array([1.0, -3.0]))
    assert errors == (2.0, 1.0, 3.0)


def test_many_sensors_are_calibrated_each_by_itself_and_go_on_straight():
    """Quadratics come back inside what was read, and their tangents beyond."""
    light = np.linspace(0.2, 1.0, 50)[:, None] * [1.0, 0.8]
    bend, slope = [2.0, 3.0], [1.5, 1.0]
    found = Calibration.fitted(light, bend - slope * light**2, order=2)
    inside = np.array([[0.3, 0.3], [0.9, 0.7]])
    np.testing.assert_allclose(found(inside), bend - slope * inside**2, atol=1e-12)
    ends, step = np.array([1.0, 0.8]), 0.05
    tangent = -2 * np.array(slope) * ends
    expected = bend - slope * ends**2 + step * tangent
    np.testing.assert_allclose(found(ends + step), expected, atol=1e-12)


def test_curvatures_come_back_from_angles_of_arcs():
    kappa, length = np.array([4.0, -2.0, 7.0, 1.0]), 0.03
    angles = (kappa[1:] + kappa[:-1]) / 2 * length  # corrected (4.6)
    np.testing.assert_allclose(curvatures(angles, length, kappa[0]), kappa, atol=1e-12)
    wrong = curvatures(angles, length, kappa[0] + 1)
    np.testing.assert_allclose(wrong - kappa, [1, -1, 1, -1], atol=1e-12)


def test_an_ideal_sensor_is_read_back_by_its_polynomial():
    ideal = Sensor("ideal", "planar", 0.0, 0.03)
    wave = np.radians(15) * (1 - np.cos(np.linspace(0, 2 * np.pi, 400)))
    light = read(ideal, np.stack([wave, wave], axis=1), 50.0)
    relative = Range.of(light).relative(light)
    assert AngleErrors.of(fit(relative, 2 * wave, 5)(relative) - 2 * wave).mean < np.radians(0.3)


@pytest.fixture(scope="module")
def session():
    """Readings of a drifting specimen in a robot whose bend is known in terms of its tip."""
    rng, count = np.random.default_rng(3), 160
    radius, angle = 0.12 * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    tips = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = radius[:, None] ** 2
    bend = tips * (3.1 + 20 * square + 2000 * square**2) + [0.01, -0.02]
    sensor = replace(RIG.sensors[0].with_imperfections(1.0, 9), drift=0.03)
    bank, shape = SensorArray([sensor], np.array([0.0, 0.12]), 5.0), np.zeros((1, 1, 3))
    bank.start(np.array([0]), [[sensor]], [1], shape)
    readings = np.empty((count, 4))
    for row, pair in zip(readings, bend, strict=True):
        shape[0, 0, :2] = 2 * pair / 0.12
        bank.look(shape)
        row[:] = bank.reading[0]
    known = np.arange(count) < 110
    return calibrate(readings, tips, known, RIG.sensors[0]), readings, tips, known


def test_the_model_finds_tips_that_it_was_not_calibrated_with(session):
    model, readings, tips, known = session
    tracker = BendFilter(model)
    found = model.tip(np.array([tracker.update(reading, 5.0) for reading in readings]))
    error = np.linalg.norm(found - tips, axis=1)[~known]
    assert np.sqrt((error**2).mean()) < 0.55e-3


def test_bend_and_tip_are_inverse(session):
    model, tips = session[0], session[2]
    np.testing.assert_allclose(model.tip(model.bend(tips)), tips, atol=1e-9)


def test_too_few_postures_are_refused(session):
    _, readings, tips, known = session
    with pytest.raises(ValueError, match="14 postures do not determine a specimen"):
        calibrate(readings, tips, known & (np.arange(len(tips)) < 14), RIG.sensors[0])
