"""What sensors read: light against formulas of the audit, imperfections one by one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from softrobot_env.robots import Sensor
from softrobot_env.robots.sensors import USUAL
from softrobot_env.sensing.array import SensorArray
from softrobot_env.sensing.optics import DARK, POLYNOMIAL, transmission

PLANAR = Sensor("planar", "planar", 0.0, 0.09, noise=0.0)
SPATIAL = Sensor("spatial", "spatial", 0.0, 0.12, noise=0.0)
PERIOD = 0.02


def shape(beta, gamma=0.0, count=1, cells=6):
    strain = np.zeros((count, cells, 3))
    strain[..., 0], strain[..., 1] = beta, gamma
    return strain


def bank(*sensors, length=0.12, count=1, start=None, period=PERIOD, seeds=None):
    made = SensorArray(sensors, np.linspace(0, length, 7), period, count)
    start = shape(0.0, count=count) if start is None else start
    made.start(np.arange(count), [sensors] * count, seeds or list(range(count)), start)
    return made


def test_two_equal_joints_give_the_current_of_the_thesis():
    def alpha(percent):
        return sum(b * percent**k for k, b in enumerate(POLYNOMIAL))

    bright = np.sqrt(DARK + (1 - DARK) * brentq(alpha, 90, 100) / 100)
    for degrees in (5.0, 15.0, 29.0):
        relative = brentq(lambda i, d=degrees: alpha(i) - 2 * d, 0, 100) / 100
        expected = np.sqrt(DARK + (1 - DARK) * relative) / bright
        assert transmission(np.radians(degrees)) == pytest.approx(expected, abs=2e-4)
        # Joints of the sensor turn by a third of the whole bend each.
        made = bank(PLANAR, length=0.09, start=shape(3 * np.radians(degrees) / 0.09))
        assert made.reading[0, 0] == pytest.approx(expected**2, abs=5e-4)


def test_no_light_passes_beyond_twice_the_acceptance_angle():
    angles = np.radians(np.linspace(0, 60, 601))
    light = transmission(angles)
    assert np.all(np.diff(light) <= 0) and np.all(light[angles >= np.radians(40)] == 0)


@pytest.mark.parametrize("bend", [(0.0, 0.0), (0.3, 0.0), (-0.2, 0.35)])
def test_spatial_light_by_rotating_fibres(bend):
    made = bank(SPATIAL, start=shape(*(2 * np.array(bend) / 0.12)))
    turn = Rotation.from_rotvec([-bend[1], bend[0], 0.0])
    for k, reading in enumerate(made.reading[0]):
        fibre = np.array([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2), 0]) * np.sin(np.radians(20))
        fibre[2] = np.cos(np.radians(20))
        psi = np.degrees(np.arccos(turn.apply(fibre)[2]))
        assert reading == pytest.approx(np.exp(1 - (psi / 20) ** 2), abs=1e-3)


def test_noise_is_of_the_size_that_the_thesis_measured():
    made, read = bank(replace(PLANAR, noise=1.4), length=0.09), []
    for _ in range(4000):
        made.look(shape(0.0))
        read.append(made.reading[0, 0])
    # 1.4 LSB of a span of 1930, besides the converter's steps of 1 / sqrt(12).
    steps = np.std(read) * 1930 / (1 - DARK)
    assert steps == pytest.approx(np.hypot(1.4, 12**-0.5), rel=0.05)


def test_tags_read_the_turn_towards_their_azimuth():
    tags = Sensor("tags", "tags", 0.0, 0.12, segments=2, azimuth=np.pi / 2, noise=0.0)
    made = bank(tags, start=shape(3.0, -4.0))
    np.testing.assert_allclose(made.reading[0], [-0.24, -0.24], atol=1e-12)


def test_samples_are_taken_at_their_rate_and_come_late():
    tags = Sensor("tags", "tags", 0.0, 0.12, segments=1, noise=0.0, rate=25.0, delay=0.06)
    made, seen = bank(tags), []
    for k in range(12):
        made.look(shape(1.0 + k))
        seen.append(made.reading[0, 0] / 0.12)
    # Sampled at instants 2, 4, ... (1-based), shown three instants later.
    np.testing.assert_allclose(seen, [0, 0, 0, 0, 2, 2, 4, 4, 6, 6, 8, 8], atol=1e-12)


def test_hysteresis_lags_by_its_share_of_the_mean_play():
    sensor = replace(SPATIAL, hysteresis=0.2)
    ideal, made = bank(SPATIAL), bank(sensor)

    def at(made, bend):
        made.look(shape(2 * bend / 0.12))
        return made.reading[0, 0]

    for bend in np.linspace(0, 0.4, 200):
        at(made, bend)
    up, lag = at(made, 0.2), 0.2 * np.radians([0.5, 1.5, 4.0]).mean()
    # Once all plays have turned round, the bend that is felt is too large by the lag.
    assert up == pytest.approx(at(ideal, 0.2 + lag), abs=2e-3)
    assert abs(up - at(ideal, 0.2)) > 5 * 2e-3


def test_warming_up_dims_the_light():
    made = bank(replace(SPATIAL, temperature=10.0), period=1.0)
    for _ in range(300):
        made.look(shape(0.0))
    assert made.reading[0] == pytest.approx(1 - 0.05 * (1 - np.exp(-1)), abs=1e-3)


def test_drift_is_slow_and_of_its_size():
    made = bank(*[replace(SPATIAL, drift=0.02)], count=400, period=1.0)
    first = made.reading.copy()
    made.look(shape(0.0, count=400))
    assert np.abs(made.reading - first).max() < 0.02 * 0.3
    for _ in range(600):
        made.look(shape(0.0, count=400))
    assert (made.reading - 1).std() == pytest.approx(0.02, rel=0.1)
    related = np.corrcoef((first - 1).ravel(), (made.reading - 1).ravel())[0, 1]
    assert related == pytest.approx(np.exp(-1), abs=0.08)


def test_contacts_let_light_in_and_stretch_costs_light():
    made = bank(replace(SPATIAL, stray=0.01))
    made.look(shape(0.0), touch=np.array([[5.0]]))
    assert made.reading[0] == pytest.approx(1.05, abs=1e-3)
    off = replace(PLANAR, stretch=2.0, offset=(0.0, 0.004))
    towards, away = (bank(off, length=0.09, start=shape(0.0, g)) for g in (5.0, -5.0))
    ratio = towards.reading[0, 0] / away.reading[0, 0]
    assert ratio == pytest.approx((1 + 2 * 5 * 0.004) / (1 - 2 * 5 * 0.004), rel=1e-3)


def test_specimens_differ_and_stay_themselves():
    built = [replace(SPATIAL, spread=0.05, specimen=k) for k in (1, 1, 2)]
    read = [bank(one, start=shape(2.0)).reading[0] for one in built]
    np.testing.assert_array_equal(read[0], read[1])
    assert np.abs(read[0] - read[2]).max() > 0.01
    assert SPATIAL.with_imperfections(5.0, 3).hysteresis == pytest.approx(5 * USUAL["hysteresis"])
    with pytest.raises(ValueError, match="hysteresis must be in"):
        SPATIAL.with_imperfections(9.0, 3)
    assert (
        SPATIAL.with_imperfections(0.0, 3) is SPATIAL
        and SPATIAL.with_imperfections(1.0, 3).specimen == 3
    )


def test_many_robots_are_as_one():
    sensors = (replace(SPATIAL, noise=None).with_imperfections(1.0, 4), replace(PLANAR, noise=None))
    together = bank(*sensors, count=3, seeds=[5, 6, 7])
    alone = bank(*sensors, seeds=[6])
    rng = np.random.default_rng(0)
    for _ in range(150):
        strain = rng.uniform(-3, 3, (3, 6, 3))
        together.look(strain)
        alone.look(strain[1:2])
        np.testing.assert_array_equal(together.reading[1], alone.reading[0])


@pytest.mark.parametrize(
    ("said", "reported"),
    [
        ({"begin": 0.1, "end": 0.1}, "begin must be below end"),
        ({"kind": "round"}, "kind must be one of 'planar', 'spatial', 'tags'"),
        ({"segments": 1}, "2 segments or more"),
        ({"hysteresis": 1.0}, "hysteresis must be in"),
        ({"acceptance": 2.0}, "acceptance must be an angle"),
    ],
)
def test_what_no_sensor_can_be(said, reported):
    with pytest.raises(ValueError, match=reported):
        Sensor(**{"name": "s", "kind": "planar", "begin": 0.0, "end": 0.1} | said)
