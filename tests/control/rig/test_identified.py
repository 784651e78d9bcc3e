"""What is identified of a rig for its controllers: stiffness, backlash, recordings of a twin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from softrobot_env.identification import excitation
from softrobot_env.identification.excitation import Excitation, plan
from softrobot_env.identification.visits import nominal_lengths, visits_of
from softrobot_env.learned.network import Scaling, initial_network
from softrobot_env.robots import ARM, EQUIVALENT, EQUIVALENT_RIG, RIG, ROBOTS
from softrobot_env.robots.twin import nominal_twin, rig3d_twin
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.rig.inverse import PIECES, PIECES_SOFTER, TOTAL
from softrobot_env.thesis.rig.parameters import (
    IdentifiedParameters,
    identified,
    parameters_of,
    record,
    turned,
)
from softrobot_env.thesis.rig.servo_flexible import FlexibleServoConstraints
from softrobot_env.thesis.rig.three_tendons import mean_curvature

FEW = Excitation(kinds=("visits",), points=10)


def test_few_pieces_stand_as_the_chain_does():
    """Least squares of what holds the same outputs, by the statics of the simulated rig."""
    robot = turned(RIG, 1.08, 0.0)
    points = 0.1 * np.sqrt(np.linspace(0.1, 1, 12))[:, None] * AROUND
    lengths = nominal_lengths(turned(RIG, 0.9, 0.0), points, TOTAL)
    env = RigEnv("triangle", twin=nominal_twin(robot))
    outputs = [env.reset(options={"start_length": s})[0]["tip_position"] for s in lengths]

    def off(stiffness):
        model = FlexibleServoConstraints(turned(robot, stiffness, 0.0), PIECES)
        pulled = [pulled_in(model, point) - s for point, s in zip(outputs, lengths, strict=True)]
        return np.std(pulled, axis=0).max()

    stiffness = np.linspace(0.96, 1.0, 5)
    quadratic = np.polyfit(stiffness, [off(x) ** 2 for x in stiffness], 2)
    assert -quadratic[1] / (2 * quadratic[0]) == pytest.approx(PIECES_SOFTER, abs=0.005)


AROUND = np.stack([f(2.4 * np.arange(12)) for f in (np.cos, np.sin)], axis=1)


def pulled_in(model, point):
    """Lengths (3,) [m] that hold an output."""
    q, reduced = model.statics(point)
    tension = model.tendons.with_total(reduced, TOTAL)
    return model.tendons.pulled(tension, mean_curvature(q))


def test_too_few_visits_are_refused():
    pulls_too = replace(FEW, kinds=("pulls", "visits"), levels=2, rest=0.8)
    with pytest.raises(ValueError, match="need 200 points or more that were visited, got 10"):
        identified(record(None, 0, pulls_too))


def some_identified():
    box = Scaling(-np.ones(2), np.ones(2)), Scaling(-np.ones(3), np.ones(3))
    return IdentifiedParameters(
        initial_network((4,), *box, np.random.default_rng(0)), 1.07, 0.12, 0.9, 1.3e-4, 3
    )


def test_identified_parameters_can_be_kept(tmp_path):
    identified = some_identified()
    identified.save(tmp_path / "rig.npz", RIG, {})
    loaded = IdentifiedParameters.load(RIG, tmp_path / "rig.npz")
    point = np.array([0.3, -0.2])
    np.testing.assert_array_equal(loaded.statics(point), identified.statics(point))
    assert (loaded.stiffness, loaded.turn) == (1.07, 0.12)
    assert (loaded.damping, loaded.backlash, loaded.twin) == (0.9, 1.3e-4, 3)
    with pytest.raises(ValueError, match="has not been trained for robot 'arm'"):
        IdentifiedParameters.load(ARM, tmp_path / "rig.npz")


@pytest.mark.parametrize(
    "changed",
    [
        {"gravity": (0.0, 0.0, 9.81)},
        {"tendons": tuple(replace(t, stiffness=500.0) for t in RIG.tendons)},
        {"tendons": tuple(replace(t, pretension=0.6) for t in RIG.tendons)},
        {"head": replace(RIG.head, mass=0.06)},
        {"head": replace(RIG.head, centre=0.02)},
        {"head": replace(RIG.head, output=0.03)},
        {"anisotropy": 0.01},
        {"precurvature": (0.1, 0.0)},
    ],
)
def test_what_is_identified_of_a_rig_with_other_statics_is_refused(tmp_path, changed):
    some_identified().save(tmp_path / "rig.npz", RIG, {})
    with pytest.raises(ValueError, match="with other parameters"):
        IdentifiedParameters.load(replace(RIG, **changed), tmp_path / "rig.npz")


def decay(robot):
    """Rate [1/s] at which a rig without errors calms down, of c + exp(-rate t) (a cos + b sin)."""
    steps = Excitation(kinds=("steps",), amplitude=0.2)
    record_ = record(nominal_twin(robot), 0, steps)
    commands = np.abs(record_.commands).max(axis=1)
    begin = int(np.flatnonzero((commands[1:] == 0) & (commands[:-1] > 0))[0]) + 1
    rows = slice(begin + 8, begin + 80)
    time, tip = record_.times[rows, None] - record_.times[begin], record_.markers[rows, 0, :2]

    def missing(parameters):
        rate, frequency = parameters
        wave = np.exp((1j * frequency - rate) * time)
        parts = np.hstack([np.ones_like(time), wave.real, wave.imag])
        return (tip - parts @ np.linalg.lstsq(parts, tip)[0]).ravel()

    return least_squares(missing, (2.2, 10.0), x_scale=(2.2, 10.0)).x[0]


def test_the_rig_calms_down_as_one_piece_of_its_inertia_and_damping():
    """Small motions of one piece: c / (2 M), with M(0) of the audit.

    A beam needs `EQUIVALENT` times its damping for that, as it needs of its stiffness.
    """
    rate = 3.77e-3 / (2 * 8.41e-4)
    assert decay(EQUIVALENT_RIG) == pytest.approx(rate, rel=0.1)
    assert decay(turned(RIG, EQUIVALENT, 0.0, 1.0)) < 0.85 * rate


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "rubs"), [(3, 3.0), (17, 1.0)])
def test_a_rig_is_identified_for_its_controllers(seed, rubs):
    """Of a twin with backlash, noise and a delay, also with three times the friction of others."""
    twin = rig3d_twin(seed)
    tendons = tuple(replace(t, friction=rubs * t.friction) for t in twin.robot.tendons)
    twin = replace(twin, robot=replace(twin.robot, tendons=tendons))
    found = parameters_of(identified(record(twin)), seed)
    stiffness = twin.robot.youngs_modulus / RIG.youngs_modulus
    lag = np.mean(twin.backlash) / 2 + np.mean([t.friction / t.stiffness for t in tendons])
    turns = [
        np.angle(complex(*a.offset) / complex(*b.offset))
        for a, b in zip(tendons, RIG.tendons, strict=True)
    ]
    assert found.twin == seed
    assert found.stiffness == pytest.approx(PIECES_SOFTER * stiffness, rel=0.03)
    assert found.turn == pytest.approx(np.mean(turns), abs=0.003)
    assert found.damping == pytest.approx(
        stiffness * twin.robot.damping_time / RIG.damping_time, rel=0.03
    )
    assert found.backlash == pytest.approx(lag, rel=0.1)


def test_visits_find_the_equilibria():
    """Those that the environment's own statics find, but for the end of the swaying."""
    twin = nominal_twin(EQUIVALENT_RIG)
    found = visits_of(record(twin, 0, FEW), RIG)
    assert len(found.lengths) == FEW.points
    env = RigEnv("triangle", twin=twin)
    for point, length in zip(found.measured, found.lengths, strict=True):
        at_rest, _ = env.reset(options={"start_length": length})
        assert np.linalg.norm(point - at_rest["tip_position"]) < 0.4e-3


def test_dither_takes_out_the_backlash_of_the_servos(monkeypatch):
    ideal = nominal_twin(EQUIVALENT_RIG)
    loose = replace(ideal, backlash=(0.3e-3,) * 3)
    truth, off = visits_of(record(ideal, 0, FEW), RIG).measured, {}
    for dither in (0.02, 0.0):
        monkeypatch.setattr(excitation, "_DITHER", dither)
        found = visits_of(record(loose, 0, FEW), RIG).measured
        off[dither] = np.linalg.norm(found - truth, axis=1).max()
    assert off[0.02] < 0.2e-3 < 0.6e-3 < off[0.0]


def test_visits_keep_within_a_radius_and_are_of_rigs_alone():
    near = visits_of(record(None, 0, replace(FEW, radius=0.05)), RIG)
    assert 0.04 < np.hypot(*near.measured.T).max() < 0.055
    with pytest.raises(ValueError, match="three"):
        plan(ROBOTS["ftdcr_v4"], FEW, 0.02)
