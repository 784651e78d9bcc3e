"""The accuracy benchmark: its independent truths, its rows, and that models agree.

The whole run is too long for a test; its parts are run on few models and resolutions.
"""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.evaluation.models.runs import distance
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK
from softrobot_env.robots.actuation import TendonMap
from studies.accuracy import pyelastica_rod, spiral, study, tension_step
from studies.accuracy.cases import BENDING, BOUND, COSSERAT, DISTRIBUTED, LUMPED, Row
from studies.accuracy.planar import (
    beam_row,
    chain_row,
    guided_arm,
    scalar_cases,
    static_cases,
    tendon,
    tip_force,
    tip_moment,
)
from studies.truths import shearable_rod
from studies.truths.analytic import Section, bent_rod, elastica, rayleigh_frequency

pytestmark = pytest.mark.slow  # a study; the quick suite has what it stands on

THREE = (LUMPED, DISTRIBUTED, COSSERAT)


def weight(robot):
    return robot.mass_per_length * robot.gravity[0], robot.mass_per_length * robot.gravity[2]


# ------------------------------------------------------------- exact rods


@pytest.mark.parametrize(
    ("robot", "k", "deflection"),
    [  # mm, section 3 of the audit
        (CANTILEVER_WEAK, 0.75, 392.73),
        (CANTILEVER_WEAK, 1.0, 392.02),
        (CANTILEVER_STIFF, 0.75, 14.050),
        (CANTILEVER_STIFF, 1.0, 13.713),
    ],
)
def test_rod_with_shear_deflects_as_in_the_audit(robot, k, deflection):
    rod = bent_rod(robot.length, shearable_rod.section(robot, k), weight=weight(robot))
    assert -1e3 * rod.tip[0] == pytest.approx(deflection, abs=0.006)


@pytest.mark.parametrize("load", [{"force": (3.0, -1.0)}, {"moment": 1.0}])
def test_rod_of_large_shear_stiffness_is_the_elastica(load):
    robot = CANTILEVER_WEAK
    thin = Section(robot.bending_stiffness, 1e9, 1e9)
    rod = bent_rod(robot.length, thin, weight=weight(robot), **load)
    slender = elastica(robot.length, robot.bending_stiffness, weight=weight(robot), **load)
    assert np.allclose(rod.tip, slender.tip, atol=1e-7)


@pytest.mark.parametrize(
    ("robot", "k", "frequency"),
    [  # Hz, section 3 of the audit
        (CANTILEVER_WEAK, 0.75, 0.6539),
        (CANTILEVER_WEAK, 1.0, 0.6547),
        (CANTILEVER_STIFF, 0.75, 5.084),
        (CANTILEVER_STIFF, 1.0, 5.151),
    ],
)
def test_timoshenko_frequency_is_that_of_the_audit(robot, k, frequency):
    assert shearable_rod.bending_frequency(robot, k) == pytest.approx(frequency, rel=2e-4)


def test_frequency_without_shear_is_rayleighs():
    robot = CANTILEVER_STIFF
    beam = robot.length, robot.bending_stiffness, robot.mass_per_length
    rayleigh = rayleigh_frequency(*beam, robot.density * robot.second_moment)
    assert shearable_rod.bending_frequency(robot, None) == pytest.approx(rayleigh, rel=1e-9)


def test_tendons_in_channels_bend_to_constant_curvature_and_compress():
    tension = TendonMap(ARM).tension(np.array([5.0, -8.0, 11.0]))
    tip = shearable_rod.tendon_tip(ARM, shearable_rod.section(ARM, None), tension)
    assert np.allclose(tip, ConstantCurvatureStatics(ARM).tip(np.array([5.0, -8.0, 11.0])))
    # Equal tensions on both sides of the longest pair compress the arm by 2 T / EA.
    both = np.array([0, 0, 0, 0, 3.0, 3.0])
    short = shearable_rod.tendon_tip(ARM, shearable_rod.section(ARM, 0.75), both)
    strain = 2 * 3.0 / (ARM.youngs_modulus * ARM.area)
    assert np.allclose(short, [0, ARM.length * (1 - strain)])


def test_dense_guides_act_as_a_channel():
    tension = TendonMap(ARM).tension(np.array([0.0, 0.0, 20.0]))
    for k in (None, 0.75):
        rod = shearable_rod.section(ARM, k)
        channel = shearable_rod.tendon_tip(ARM, rod, tension)
        gaps = [
            distance(shearable_rod.tendon_tip(_with_guides(m), rod, tension), channel)
            for m in (24, 48)
        ]
        assert gaps[1] < 1e-3
        assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.05)


def _with_guides(per_metre):
    def guides(end):
        return tuple(i / per_metre for i in range(1, round(end * per_metre)))

    return replace(ARM, tendons=tuple(replace(t, guides=guides(t.end)) for t in ARM.tendons))


def test_unequal_guides_are_refused():
    first, *others = guided_arm().tendons
    shifted = replace(first, guides=(0.05,))
    robot = replace(ARM, tendons=(shifted, *others))
    with pytest.raises(ValueError, match="same guides"):
        shearable_rod.tendon_tip(robot, shearable_rod.section(robot, None), np.ones(6))


# ------------------------------------------------------------- rows


def test_chains_end_pieces_where_tendons_end():
    assert study.hinge_numbers(CANTILEVER_WEAK, "gauss3") == (6, 12, 24, 48)
    assert study.hinge_numbers(ARM, "gauss3", quick=True) == (9, 18)
    assert study.hinge_numbers(ARM, "balanced2", quick=True) == (6, 12)


def test_error_is_the_distance_to_the_truth():
    row, _ = study.chain_static_row(tip_moment(1e-9), "midpoint", 6)
    # An unloaded rod is straight in every model: 1e-9 Nm deflects it by 5e-10 m.
    assert row.e_max < 1e-11


@pytest.fixture(scope="module")
def few(request):
    """The benchmark with the models that are compiled fastest, without references of hours."""
    patch = pytest.MonkeyPatch()
    request.addfinalizer(patch.undo)
    patch.setattr(study, "CONTESTANTS", THREE)
    patch.setattr(study, "TOLERANCES", (1e-3,))
    patch.setattr(study, "FINE_TOLERANCES", ())
    return patch


@pytest.fixture(scope="module")
def static(few):
    return [row for case in static_cases() for row in study._static_rows(case, True, 1)]


@pytest.fixture(scope="module")
def motions(few):
    limits = {
        (tension_step.CASE, c.physics.name): study.case_limit(tension_step.CASE, c, True)
        for c in (DISTRIBUTED, COSSERAT)
    }
    found = []
    for contestant in THREE:
        limit = limits[tension_step.CASE, contestant.physics.name]
        found += study._beam_rows(tension_step.CASE, contestant, limit, True)
    truth = limits[tension_step.CASE, BENDING.name]
    found += study._chain_rows(tension_step.CASE, "balanced2", truth, True)
    return found + study.dynamic_rows(tension_step.CASE, limits, True)


def test_more_pieces_are_more_accurate_in_every_static_case(static):
    groups = {}
    for row in static:
        if row.kind == "static":
            groups.setdefault((row.case, row.model), []).append(row)
    for (case, model), (coarse, fine) in groups.items():
        exact = coarse.e_max < 1e-9  # constant curvature under moments and channels
        # Pieces of half the guides' distance cannot do better: both halves bend alike.
        if exact or (model.startswith("pcc") and case == "tendon_guided"):
            assert fine.e_max < max(1e-9, 1.01 * coarse.e_max), (case, model)
        else:
            assert fine.e_max < coarse.e_max / 2, (case, model)


def test_smaller_tolerance_and_more_pieces_reduce_the_error_of_a_motion(motions):
    cosserat = [r for r in motions if (r.kind, r.model) == ("dynamic", "cosserat")]
    adaptive = {r.n: r for r in cosserat if r.tolerance == 1e-3}
    assert adaptive[12].e_mean < adaptive[6].e_mean / 3
    euler = {round(1e4 * r.timestep): r for r in cosserat if r.integrator == "implicit_euler"}
    assert euler[25].e_time < euler[100].e_time / 3


# ------------------------------------------------------------- agreement


def test_models_agree_with_the_statics_of_their_physics():
    for case, n in ((tip_force(3.0), 24), (tendon(20.0), 24)):
        for contestant in (DISTRIBUTED, COSSERAT):
            model = contestant.build(case.robot, n, case.loads)
            q = model.equilibrium(case.ctrl, load_steps=5, check_stability=False)
            gap = np.linalg.norm(model.tip(q)[[0, 2]] - case.truth(contestant.physics)[0])
            assert gap < BOUND * case.robot.length, (case.name, contestant.name)


def test_chain_and_pcc_have_the_same_limit_and_cosserat_rods_have_not(motions):
    rows = [row for row in motions if row.kind in ("agreement", "physics")]
    (same,) = (row for row in rows if row.kind == "agreement")
    assert same.met
    assert same.value < 1e-4
    (other,) = (row for row in rows if row.kind == "physics")
    assert other.value > 10 * same.value
    assert other.met is None


def test_slender_robots_keep_stiffness_and_mass():
    thin = study.slender(ARM)
    for name in ("bending_stiffness", "torsional_stiffness", "mass_per_length"):
        assert getattr(thin, name) == pytest.approx(getattr(ARM, name))
    axial = thin.youngs_modulus * thin.area / (ARM.youngs_modulus * ARM.area)
    assert axial == pytest.approx(900)


@pytest.mark.parametrize("case", scalar_cases(), ids=lambda case: case.name)
def test_frequencies_and_twist_agree_with_closed_forms(case):
    for contestant in (DISTRIBUTED, COSSERAT):
        assert beam_row(case, contestant, 12).e_relative < 0.006
    assert chain_row(case, "gauss2", 12, BENDING).e_relative < 0.001


def test_chain_spiral_is_that_of_many_pieces():
    tips = replace(spiral.beam_motion(DISTRIBUTED, 6), tolerance=1e-4)()
    chain = spiral.chain_motion("gauss2", 6, 5)()
    assert distance(tips, chain) < BOUND * spiral.ROBOT.length * 2.5
    assert chain[0] == pytest.approx([0, 0, spiral.ROBOT.length])


# ------------------------------------------------------------- goals, tables, figures


def spiral_row(model, n, time, case=spiral.CASE, **values):
    defaults = {"e_mean": 5e-5, "e_max": 1e-4, "wall_time": time, "physics": "bending"}
    return Row("dynamic", case, model, n, **(defaults | values))


def test_goals_take_the_fastest_run_that_is_accurate_enough(monkeypatch):
    monkeypatch.setattr(study, "right_hand_side_time", lambda n, _: 1e-6 * n)
    rows = [
        spiral_row("pcc/lumped", 2, 0.001, e_time=5e-4),
        spiral_row("pcc/lumped", 2, 0.030, e_time=5e-7),
        spiral_row("mujoco_chain/gauss2", 6, 0.003),
        spiral_row("mujoco_chain/gauss2", 2, 0.001, e_mean=3e-4),
        spiral_row("pyelastica", 7, 1.0, case=pyelastica_rod.CASE, e_max=1e-3),
        spiral_row("mujoco_chain/gauss2", 2, 0.02, case=pyelastica_rod.CASE, e_max=9e-4),
        spiral_row("cosserat", 7, 0.01, case=pyelastica_rod.CASE, e_max=9e-4),
        spiral_row("cosserat", 3, 0.001, case=pyelastica_rod.CASE, e_max=2e-3),
    ]
    found = [(row.value, row.met) for row in study.goal_rows(rows)]
    assert found == [
        (0.030, False),
        (0.001, True),
        (pytest.approx(5e-6), True),
        (pytest.approx(4), True),
        (pytest.approx(1000), True),
        (pytest.approx(50), True),
        (pytest.approx(100), None),  # beside the goal, which is the chain's
    ]


def test_absent_pyelastica_is_said(monkeypatch):
    monkeypatch.setattr(pyelastica_rod, "find_spec", lambda name: None)
    (row,) = pyelastica_rod.rows()
    assert row.kind == "note"
    assert "not installed" in row.reference
