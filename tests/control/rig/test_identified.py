"""What is identified of a rig for its controllers: stiffness, backlash, recordings of a twin."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.control.rig.identified import IdentifiedParameters, turned
from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.envs.rig import RigEnv
from softrobot_env.identification import visits
from softrobot_env.identification.backlash import backlash_of, visit_sides
from softrobot_env.identification.decay import damping_of, rates_of_decay, visit_decays
from softrobot_env.identification.parameters import NEEDED, Recording, identify
from softrobot_env.identification.slow_rig import RigStatics
from softrobot_env.identification.stiffness import calibrate
from softrobot_env.identification.visits import Visit, disk_points, measure, nominal_lengths
from softrobot_env.learned.network import Scaling, initial_network
from softrobot_env.robots import ARM, EQUIVALENT, EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import nominal_twin, rig3d_twin


def test_calibration_finds_the_turn_and_the_stiffness():
    """Of one piece, which stands as several pieces of 1.2 times its stiffness do."""
    points = disk_points(60, 0.11)
    rig = RigStatics(turned(RIG, 0.9, 0.12), friction=0.0, noise=0.0)
    lengths = nominal_lengths(RIG, points, TOTAL)
    stiffness, turn = calibrate(RIG, lengths, rig(lengths))
    assert turn == pytest.approx(0.12, abs=1e-3)
    assert stiffness == pytest.approx(0.9 * EQUIVALENT, rel=0.04)


def test_too_little_data_are_refused():
    with pytest.raises(ValueError, match="three lengths"):
        calibrate(RIG, np.zeros((2, 3)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match=f"need {NEEDED} points"):
        identify(Recording(SimpleNamespace(lengths=np.zeros((20, 3))), np.zeros((3, 2, 2)), None))


def some_learnt():
    box = Scaling(-np.ones(2), np.ones(2)), Scaling(-np.ones(3), np.ones(3))
    return IdentifiedParameters(
        initial_network((4,), *box, np.random.default_rng(0)), 1.07, 0.12, 0.9, 1.3e-4, 3
    )


def test_identified_parameters_can_be_kept(tmp_path):
    learnt = some_learnt()
    learnt.save(tmp_path / "rig.npz", RIG, {})
    loaded = IdentifiedParameters.load(RIG, tmp_path / "rig.npz")
    point = np.array([0.3, -0.2])
    np.testing.assert_array_equal(loaded.statics(point), learnt.statics(point))
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
def test_what_is_learnt_of_a_rig_with_other_statics_is_refused(tmp_path, changed):
    some_learnt().save(tmp_path / "rig.npz", RIG, {})
    with pytest.raises(ValueError, match="as it was then"):
        IdentifiedParameters.load(replace(RIG, **changed), tmp_path / "rig.npz")


def test_the_backlash_of_servos_and_friction_is_measured():
    """Half of 0.2 mm, and 0.05 N over 980 N/m."""
    robot = replace(EQUIVALENT_RIG, tendons=tuple(replace(t, friction=0.05) for t in RIG.tendons))
    loose = replace(nominal_twin(robot), backlash=(0.2e-3,) * 3)

    def statics(outputs):
        return nominal_lengths(RIG, outputs, TOTAL)

    assert backlash_of(visit_sides(loose, count=1), statics) == pytest.approx(0.151e-3, rel=0.05)
    assert abs(backlash_of(visit_sides(nominal_twin(robot), count=1), statics) - 0.051e-3) < 5e-6


def test_play_needs_the_outputs_of_a_visit():
    with pytest.raises(ValueError, match=r"need outputs \(3 k, 2, 2\)"):
        backlash_of(np.zeros((4, 2, 2)), lambda z: z)


def test_the_rig_calms_down_as_one_piece_of_its_inertia_and_damping():
    """Small motions of one piece: c / (2 M), with M(0) of the audit.

    A beam needs `EQUIVALENT` times its damping for that, as it needs of its stiffness.
    """
    rate = 3.77e-3 / (2 * 8.41e-4)
    np.testing.assert_allclose(rates_of_decay(visit_decays(None)), rate, rtol=0.1)
    printed = nominal_twin(turned(RIG, EQUIVALENT, 0.0, 1.0))
    assert np.all(rates_of_decay(visit_decays(printed)) < 0.85 * rate)


@pytest.mark.slow
def test_damping_is_measured_in_spite_of_friction():
    """Of a twin with play, noise and a delay, and three times the friction of others."""
    twin = rig3d_twin(3)
    tendons = tuple(replace(t, friction=3 * t.friction) for t in twin.robot.tendons)
    twin = replace(twin, robot=replace(twin.robot, tendons=tendons))
    stiffness = twin.robot.youngs_modulus / RIG.youngs_modulus
    truth = stiffness * twin.robot.damping_time / RIG.damping_time
    damping, friction = damping_of(visit_decays(twin), turned(RIG, stiffness, 0.12, 1.0))
    assert damping == pytest.approx(truth, rel=0.03)
    assert friction == pytest.approx(np.mean([t.friction for t in twin.robot.tendons]), abs=0.01)
    assert truth / EQUIVALENT > 1.15


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:robot 'rig'")  # it also tries rigs that hardly calm down
def test_an_implausible_decay_is_refused():
    time = 0.02 * np.arange(1, 81)[:, None]
    wave = 0.06 * np.exp(0.5 * time) * np.cos(10 * time)
    with pytest.raises(ValueError, match="no damping up to"):
        damping_of(np.tile(wave, (1, 1, 2)), turned(RIG, 1.0, 0.0))


def test_measured_outputs_are_the_equilibria():
    """Those that the environment's own statics find, but for the end of the swaying."""
    twin = nominal_twin(EQUIVALENT_RIG)
    lengths = nominal_lengths(RIG, np.array([[0.05, 0.02], [-0.03, 0.07], [0.0, -0.1]]), TOTAL)
    found = measure(twin, lengths)
    env = RigEnv("triangle", twin=twin)
    for point, length in zip(found, lengths, strict=True):
        at_rest, _ = env.reset(options={"start_length": length})
        assert np.linalg.norm(point - at_rest["tip_position"]) < 0.4e-3


def test_dither_takes_out_the_backlash_of_the_servos():
    ideal = nominal_twin(EQUIVALENT_RIG)
    loose = replace(ideal, backlash=(0.3e-3,) * 3)
    points = np.array([[0.0, 0.0], [0.07, 0.0], [0.11, 0.03], [0.07, 0.0]])
    lengths = nominal_lengths(RIG, points, TOTAL)
    truth = measure(ideal, lengths)[1:]
    off = {}
    for dither in (0.0, 0.6e-3):
        found = measure(loose, lengths, visit=Visit(dither=dither))[1:]
        off[dither] = np.linalg.norm(found - truth, axis=1).max()
    assert off[0.6e-3] < 0.2e-3 < 0.6e-3 < off[0.0]


def test_long_visits_are_cut_into_runs(monkeypatch):
    """Each from the straight pose, with nothing left of the run before."""
    lengths = nominal_lengths(RIG, disk_points(4, 0.05), TOTAL)
    quick = Visit(move=0.2, rest=0.1, pictures=2)
    apart = [measure(None, part, visit=quick) for part in np.split(lengths, 2)]
    monkeypatch.setattr(visits, "LONGEST", 2.5 * visits.visit_duration(quick, 1))
    np.testing.assert_array_equal(measure(None, lengths, visit=quick), np.concatenate(apart))


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        (np.zeros((2, 2)), "shape"),
        (np.full((2, 3), 0.031), "0.03 m"),
        (np.full((2, 3), np.nan), "0.03 m"),
    ],
)
def test_measurements_that_cannot_be_made_are_refused(lengths, message):
    with pytest.raises(ValueError, match=message):
        measure(None, lengths)


def test_twins_are_trained_for_one_artifact_only(tmp_path, capsys):
    assert main(["train", "lqi", "--twin", "1", "--out", str(tmp_path)]) != 0
    assert "--twin: only with rig_nn" in capsys.readouterr().err
