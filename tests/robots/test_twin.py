"""Twins: ranges of what is drawn, reproducibility, and the modulus that stands for one piece."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.postures import posed

from softrobot_env.robots import EQUIVALENT, EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import nominal_twin, rig3d_twin
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium
from softrobot_env.thesis.rig.parameters import nominal_lengths

#: Way [m] of the output by a curvature [1/m].
BENT = RIG.length * (RIG.length / 2 + 0.022)


@cache
def twins():
    return [rig3d_twin(seed) for seed in range(300)]


def drawn(read):
    """What `read` says of all twins, (300, ...)."""
    return np.array([read(twin) for twin in twins()])


def azimuths(twin):
    """(3,) [deg] by which the tendons are turned."""
    ideal = np.array([complex(*t.offset) for t in RIG.tendons])
    real = np.array([complex(*t.offset) for t in twin.robot.tendons])
    return np.degrees(np.angle(real / ideal))


def damping(twin):
    """Moment per bending rate over that of the equivalent rig [1]."""
    ideal = EQUIVALENT_RIG.damping_time * EQUIVALENT_RIG.youngs_modulus
    return twin.robot.damping_time * twin.robot.youngs_modulus / ideal


def test_the_nominal_twin_is_the_robot():
    twin = nominal_twin(RIG)
    assert twin.robot is RIG
    assert not any((*twin.servo_offset, *twin.backlash, twin.camera_noise, twin.camera_delay))
    assert twin.servo_speed == pytest.approx(0.131, rel=1e-2)
    assert twin.seed is None


def test_a_seed_is_a_rig():
    assert rig3d_twin(7) == twins()[7] == rig3d_twin(np.int64(7))
    assert twins()[7].seed == 7
    assert len({twin.robot.youngs_modulus for twin in twins()}) == len(twins())


#: What is read of a twin, and the range that it fills.
RANGES = {
    "azimuth": (azimuths, 4.0, 10.0),
    "radius": (lambda t: [np.hypot(*x.offset) / 5.5e-3 for x in t.robot.tendons], 0.97, 1.03),
    "friction": (lambda t: [x.friction for x in t.robot.tendons], 0.035, 0.065),
    "damping": (damping, 0.8, 1.2),
    "anisotropy": (lambda t: t.robot.anisotropy, 0.0, 0.05),
    "stiff": (lambda t: t.robot.stiff_azimuth, 0.0, np.pi),
    "offset": (lambda t: t.servo_offset, -0.3e-3, 0.3e-3),
    "backlash": (lambda t: t.backlash, 0.1e-3, 0.3e-3),
    "bend": (lambda t: BENT * np.array(t.robot.precurvature), -2.1e-3, 2.1e-3),
}


@pytest.mark.parametrize("name", RANGES)
def test_errors_fill_their_ranges(name):
    read, low, high = RANGES[name]
    values = drawn(read)
    assert np.all((low <= values) & (values <= high))
    width = high - low
    assert np.min(values) < low + 0.1 * width
    assert np.max(values) > high - 0.1 * width
    assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.06 * width)


def test_modulus_is_spread_about_nine_tenths_of_the_equivalent():
    factor = drawn(lambda t: t.robot.youngs_modulus) / (EQUIVALENT * RIG.youngs_modulus)
    assert np.median(factor) == pytest.approx(0.9, abs=0.01)
    assert np.std(np.log(factor)) == pytest.approx(0.05, abs=0.006)


def test_tendons_share_most_of_their_turn():
    turn = drawn(azimuths)
    assert np.max(np.ptp(turn, axis=1)) <= 2.0
    assert np.std(turn.mean(axis=1)) > 0.8


def test_nothing_else_differs():
    varied = ("name", "youngs_modulus", "damping_time", "anisotropy", "stiff_azimuth")
    known = {name: getattr(RIG, name) for name in (*varied, "precurvature", "sensors")}
    for twin in twins()[:20]:
        tendons = tuple(
            replace(t, offset=ideal.offset, friction=0.0)
            for t, ideal in zip(twin.robot.tendons, RIG.tendons, strict=True)
        )
        assert replace(twin.robot, tendons=tendons, **known) == RIG
        assert twin.camera_noise == 0.3e-3
        assert twin.camera_delay == pytest.approx(1 / 90)


def reached(robot, pulled):
    """(2,) [m], where the tip of a fine chain stands at pulled-in lengths."""
    config = SceneConfig(robot, pieces=8, actuation="length", bending="spatial")
    model = build_scene(config).model
    return posed(model, equilibrium(model, pulled)).site("tip").xpos[:2]


@pytest.mark.parametrize("distance", [0.06, 0.12])
def test_the_equivalent_rig_stands_where_the_one_piece_model_says(distance):
    turn = np.exp(2j * np.pi * np.array([0.0, 0.15, 0.5]))
    z = distance * np.stack([turn.real, turn.imag], axis=1)
    lengths = nominal_lengths(RIG, z)
    for target, pulled in zip(z, lengths, strict=True):
        assert np.linalg.norm(reached(EQUIVALENT_RIG, pulled) - target) < 0.02 * distance
        assert np.linalg.norm(reached(RIG, pulled) - target) > 0.1 * distance


@pytest.mark.parametrize("seed", [-1, 1.5, "1", None, True])
def test_bad_seeds_are_named(seed):
    with pytest.raises(ValueError, match="seed of a twin"):
        rig3d_twin(seed)


def test_sensors_err_as_their_own_specimen():
    (design,) = RIG.sensors
    for seed in (0, 5):
        assert rig3d_twin(seed).robot.sensors == (design.with_imperfections(1.0, seed),)
