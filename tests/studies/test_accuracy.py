"""The accuracy study: its independent truths, its rows, and that models agree; rods in space, rig.

The whole run is too long for a test; its parts are run on few models and resolutions.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import airy

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.evaluation.models.runs import Limit, converged, distance
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RIG
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.config import TWISTING_RULE
from softrobot_env.scene.timestep import TimestepWarning
from studies.accuracy import cases, planar, pyelastica_rod, rig, space, spiral, study, tension_step
from studies.accuracy.space import HEADINGS, STEEL, TPU, beam_tip, cases_of, chain_tip
from studies.lab import select
from studies.truths.analytic import arc_tip, bent_rod, section
from studies.truths.rig_column import column_tip, tensions
from studies.truths.rig_piece import acceleration, distributed
from studies.truths.rig_ritz_rod import RigRod
from studies.truths.tendon_rod import guided_rod, tendon_rod
from studies.truths.varying_beam import bending_frequencies

pytestmark = pytest.mark.slow  # a study; the quick suite has what it stands on

THREE = (cases.LUMPED, cases.DISTRIBUTED, cases.COSSERAT)


def weight(robot):
    return robot.mass_per_length * robot.gravity[0], robot.mass_per_length * robot.gravity[2]


# ------------------------------------------------------------- exact rods


@pytest.mark.parametrize(
    ("robot", "k", "deflection", "frequency"),
    [  # mm and Hz, section 3 of the audit
        (CANTILEVER_WEAK, 0.75, 392.73, 0.6539),
        (CANTILEVER_WEAK, 1.0, 392.02, 0.6547),
        (CANTILEVER_STIFF, 0.75, 14.050, 5.084),
        (CANTILEVER_STIFF, 1.0, 13.713, 5.151),
    ],
)
def test_rod_with_shear_bends_and_swings_as_in_the_audit(robot, k, deflection, frequency):
    rod = bent_rod(robot.length, section(robot, k), weight=weight(robot))
    assert -1e3 * rod.tip[0] == pytest.approx(deflection, abs=0.006)
    assert bending_frequencies(robot, 1, k)[0] == pytest.approx(frequency, rel=2e-4)


def pulled_tip(rod, robot, tension, k):
    return rod(robot, tension, [robot.length], k).tip[[0, 2]]


def test_tendons_in_channels_bend_to_constant_curvature_and_compress():
    tension = TendonMap(ARM).tension(np.array([5.0, -8.0, 11.0]))
    tip = pulled_tip(tendon_rod, ARM, tension, None)
    assert np.allclose(tip, ConstantCurvatureStatics(ARM).tip(np.array([5.0, -8.0, 11.0])))
    # Equal tensions on both sides of the longest pair compress the arm by 2 T / EA.
    short = pulled_tip(tendon_rod, ARM, np.array([0, 0, 0, 0, 3.0, 3.0]), 0.75)
    strain = 2 * 3.0 / (ARM.youngs_modulus * ARM.area)
    assert np.allclose(short, [0, ARM.length * (1 - strain)])


@pytest.mark.parametrize("k", [None, 0.75])
def test_dense_guides_act_as_a_channel(k):
    tension = TendonMap(ARM).tension(np.array([0.0, 0.0, 20.0]))
    channel = pulled_tip(tendon_rod, ARM, tension, k)
    tips = (pulled_tip(guided_rod, _with_guides(m), tension, k) for m in (24, 48))
    gaps = [distance(tip, channel) for tip in tips]
    assert gaps[1] < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.05)


def _with_guides(per_metre):
    def guides(end):
        return tuple(i / per_metre for i in range(1, round(end * per_metre)))

    return replace(ARM, tendons=tuple(replace(t, guides=guides(t.end)) for t in ARM.tendons))


# ------------------------------------------------------------- rows


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
def motions(few):
    step = tension_step.CASE
    pair = cases.DISTRIBUTED, cases.COSSERAT
    limits = {(step, c.physics.name): study.case_limit(step, c, True) for c in pair}
    found = [row for one in THREE for row in study._beam_rows(step, one, limits, True)]
    found += study._chain_rows(step, "balanced2", limits, True)
    return found + study.dynamic_rows(step, limits, True)


def test_smaller_tolerance_and_more_pieces_reduce_the_error_of_a_motion(motions):
    cosserat = [r for r in motions if (r.kind, r.model) == ("dynamic", "cosserat")]
    adaptive = {r.n: r for r in cosserat if r.tolerance == 1e-3}
    assert adaptive[12].e_mean < adaptive[6].e_mean / 3
    euler = {round(1e4 * r.timestep): r for r in cosserat if r.integrator == "implicit_euler"}
    assert euler[25].e_time < euler[100].e_time / 3


# ------------------------------------------------------------- agreement


def test_models_agree_with_the_statics_of_their_physics():
    for case, n in ((planar.tip_force(3.0), 24), (planar.tendon(20.0), 24)):
        for contestant in (cases.DISTRIBUTED, cases.COSSERAT):
            model = contestant.build(case.robot, n, case.loads)
            q = model.equilibrium(case.ctrl, load_steps=5, check_stability=False)
            gap = np.linalg.norm(model.tip(q)[[0, 2]] - case.truth(contestant.physics).tips)
            assert gap < cases.BOUND * case.robot.length, (case.name, contestant.name)


def test_chain_and_pcc_have_the_same_limit_and_cosserat_rods_have_not(motions):
    (same,), (other,) = (select(motions, kind=kind) for kind in ("agreement", "physics"))
    assert same.met and same.value < 1e-4
    assert other.value > 10 * same.value and other.met is None


def test_slender_robots_keep_stiffness_and_mass():
    thin = study.slender(ARM)
    for name in ("bending_stiffness", "torsional_stiffness", "mass_per_length"):
        assert getattr(thin, name) == pytest.approx(getattr(ARM, name))
    assert thin.youngs_modulus * thin.area / (ARM.youngs_modulus * ARM.area) == pytest.approx(900)


def test_chain_spiral_is_that_of_many_pieces():
    tips = replace(spiral.beam_motion(cases.DISTRIBUTED, 6), tolerance=1e-4)()
    chain = spiral.chain_motion("gauss2", 6, 2e-3)()
    assert distance(tips, chain) < cases.BOUND * spiral.ROBOT.length * 2.5
    assert chain[0] == pytest.approx([0, 0, spiral.ROBOT.length])


# ------------------------------------------------------------- goals, tables, figures


def spiral_row(model, n, time, case=spiral.CASE, **values):
    defaults = {"e_mean": 5e-5, "e_max": 1e-4, "wall_time": time, "physics": "bending"}
    return cases.Row("dynamic", case, model, n, **(defaults | values))


def test_goals_take_the_fastest_run_that_is_accurate_enough(monkeypatch):
    monkeypatch.setattr(study, "evaluation_time", lambda model: 1e-6 * model.n / 2)
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


# ------------------------------------------------------------- rods in space


def off(found, case):
    return float(np.linalg.norm(found[0] - case.tip))


@pytest.mark.parametrize("robot", [TPU, STEEL], ids=lambda r: r.name)
@pytest.mark.parametrize("name", HEADINGS)
def test_the_chain_converges_to_every_exact_tip_by_second_order(name, robot):
    case = cases_of(name, robot, cases.BENDING, quick=True)[0]
    coarse, fine = (off(chain_tip(case, "gauss2", n), case) for n in (12, 24))
    assert np.linalg.norm(case.tip - [0, 0, robot.length]) > 0.05 * robot.length
    assert fine < 1.5e-3 * robot.length
    assert 3.0 < coarse / fine < 20.0


@pytest.mark.parametrize("name", ["wrenches", "helix_dead", "force_dead"])
def test_models_of_two_families_converge_to_the_same_exact_tips(name):
    for contestant in (cases.DISTRIBUTED, cases.COSSERAT):
        case = cases_of(name, STEEL, contestant.physics, quick=True)[-1]
        coarse, fine = (off(beam_tip(case, contestant, n), case) for n in (12, 24))
        assert fine < 2e-3 * STEEL.length and coarse / fine > 3.0


def test_the_default_chain_errs_little_and_in_no_direction_more_than_in_another(monkeypatch):
    """At 12 stations, on TPU: wrenches, and a sag along an axis and between two."""
    monkeypatch.setattr(space.cases, "CONTESTANTS", (None, cases.COSSERAT))
    wrench, *sags = (
        select(space.case_rows(name, TPU, quick=True), model=f"mujoco_chain/{TWISTING_RULE}", n=12)
        for name in ("wrenches", "sag_0deg", "sag_45deg")
    )
    assert wrench[0].e_mean < 0.25e-3
    along, across = (row.e_mean for (row,) in sags)
    assert 1 / 1.5 < across / along < 1.5


def test_what_is_not_solved_is_said_and_not_averaged(monkeypatch):
    def fail(*_, **__):
        raise EquilibriumError("none")

    monkeypatch.setattr(space, "beam_tip", fail)
    found = space.case_rows("circle", TPU, quick=True)
    lost = [row for row in found if row.model == "cosserat"]
    assert [row.kind for row in lost] == ["note"]
    assert lost[0].reference == "1 of 1 not solved: none" and lost[0].e_mean is None


# ------------------------------------------------------------- the rig

L, HEAD, G = RIG.length, RIG.head, 9.81
RADIUS, C = 5.5e-3, RIG.tendons[0].stiffness
WEIGHTLESS = replace(RIG, gravity=(0.0, 0.0, 0.0))
SLACK = np.array(rig.STATIC["rig_slack"])


def rod_tip(pulled, robot=RIG, terms=7):
    rod = RigRod(robot, terms)
    return rod.tip(rod.equilibrium(np.asarray(pulled)))


# ------------------------------------------------------------- truths


def airy_deflection(pulled):
    """Small deflection [m] of the output when one tendon is pulled, by Airy's functions.

    The angle obeys EI t'' = -(W + q (L - s)) t: with z = (W + q (L - s)) / (EI q^2)^(1/3) it is a
    combination of Ai(-z) and Bi(-z) that vanishes at the base. The end carries the moment of the
    head and of the tendons, c r (s - r t) and twice -c (r / 2)^2 t.
    """
    q, weight = RIG.mass_per_length * G, HEAD.mass * G
    scale = (RIG.bending_stiffness * q**2) ** (1 / 3)

    def parts(s):
        ai, dai, bi, dbi = airy(-(weight + q * (L - s)) / scale)
        return np.array([ai, bi]), np.array([dai, dbi]) * q / scale

    first, second = parts(0.0)[0]
    mix = np.array([second, -first])
    angle, turn = (float(x @ mix) for x in parts(L))
    held = 1.5 * C * RADIUS**2 - weight * HEAD.centre
    size = C * RADIUS * pulled / (RIG.bending_stiffness * turn + held * angle)
    aside = quad(lambda s: float(parts(s)[0] @ mix), 0, L)[0]
    return size * (aside + HEAD.output * angle)


def test_small_pull_deflects_as_the_linear_column():
    pulled = np.array([1e-6, 0, 0])
    expected = airy_deflection(1e-6)
    assert expected > 1e-6
    assert column_tip(RIG, pulled, None)[0] == pytest.approx(expected, rel=1e-6)
    assert rod_tip(pulled)[0] == pytest.approx(expected, rel=1e-6)


def test_without_weight_the_rig_is_an_arc():
    """EI t / L = c r (s - r t) - 2 c (r / 2)^2 t, all tendons taut."""
    pulled = 8e-3
    angle = C * RADIUS * pulled / (RIG.bending_stiffness / L + 1.5 * C * RADIUS**2)
    x, z = arc_tip(L, angle / L) + HEAD.output * np.array([np.sin(angle), np.cos(angle)])
    lengths = np.array([pulled, 0, 0])
    for tip in (
        rod_tip(lengths, WEIGHTLESS, terms=1),
        column_tip(WEIGHTLESS, lengths, None),
    ):
        np.testing.assert_allclose(tip, [x, 0, z], atol=1e-10)


@pytest.mark.parametrize("case", rig.STATIC)
def test_two_independent_truths_agree(case):
    """Initial values in the plane of bending, and polynomials in space."""
    assert distance(rod_tip(rig.STATIC[case]), rig.static_truth(case, cases.BENDING).tips) < 1e-8


def test_polynomials_converge_exponentially():
    exact = column_tip(RIG, SLACK, None)
    errors = [distance(rod_tip(SLACK, terms=terms), exact) for terms in (1, 3, 5, 7)]
    assert all(fine < coarse / 25 for coarse, fine in pairwise(errors))


def test_stiff_section_neither_shears_nor_stretches():
    """With the same EI on a thirtieth of the radius, shear and extension are 900 times less."""
    thin = replace(RIG, outer_radius=RIG.outer_radius / 30, youngs_modulus=30**4 * 6.0653e5)
    thin = replace(thin, youngs_modulus=thin.youngs_modulus * 18.3e-3 / thin.bending_stiffness)
    thin = replace(thin, density=30**2 * RIG.density)
    soft, stiff, exact = (
        column_tip(robot, SLACK, k) for robot, k in ((RIG, 0.75), (thin, 0.75), (RIG, None))
    )
    assert distance(soft, exact) > 0.01
    assert distance(stiff, exact) < distance(soft, exact) / 400


def test_shortened_fibre_slackens_the_tendons():
    straight = np.zeros(2)
    taut = tensions(RIG, np.full(3, 5e-3), straight)
    np.testing.assert_allclose(taut, 0.5 + C * 5e-3)
    np.testing.assert_allclose(tensions(RIG, np.full(3, 5e-3), straight, 1e-3), taut - C * 1e-3)


@pytest.mark.parametrize("size", [0.0, 0.3, 0.7])
def test_rod_of_one_term_moves_as_the_closed_form(size):
    """Two derivations of the equations of motion, with coordinates (mu, nu) and (beta, gamma)."""
    rng = np.random.default_rng(3)
    y, v = size * rng.normal(size=2), 4 * rng.normal(size=2)
    pulled = np.array([8e-3, -20e-3, 3e-3])
    out = np.empty(2)
    force = tensions(RIG, pulled, np.array([y[1], -y[0]]))
    acceleration(distributed(RIG), y, v, force, out)
    found = RigRod(RIG, 1).acceleration(*(np.array([x[1], -x[0]]) for x in (y, v)), pulled)
    np.testing.assert_allclose(found, [out[1], -out[0]], rtol=1e-4)


# ------------------------------------------------------------- models at rest


def test_head_as_a_load_is_the_head_of_the_rod_of_one_term():
    pulled = np.array(rig.STATIC["rig_general"])
    loaded = rig.beam_statics(cases.DISTRIBUTED, 1)(pulled)
    np.testing.assert_allclose(loaded, rod_tip(pulled, terms=1), atol=1e-8)


@pytest.mark.parametrize("case", ["rig_pull_20mm", "rig_slack"])
def test_pcc_and_chain_converge_with_second_order(case):
    exact, pulled = rig.static_truth(case, cases.BENDING).tips, np.array(rig.STATIC[case])
    for family, sizes in (
        (lambda n: rig.beam_statics(cases.DISTRIBUTED, n), (2, 4, 8)),
        # Of 4 joints, the springs of scene.springs are of fourth order beside it.
        (lambda n: rig.chain_statics("midpoint", n), (8, 16, 32)),
    ):
        errors = [distance(family(n)(pulled), exact) for n in sizes]
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.12)


def test_cosserat_rod_converges_to_the_column_with_shear_and_extension():
    pulled = np.array(rig.STATIC["rig_pull_10mm"])
    tips = {n: rig.beam_statics(cases.COSSERAT, n)(pulled) for n in (3, 6, 12)}
    limit = converged(tips, 1)
    with_shear, without = (column_tip(RIG, pulled, k) for k in (0.75, None))
    assert distance(tips[12], with_shear) < distance(tips[6], with_shear) / 2
    assert distance(limit, with_shear) < 0.5e-3
    assert distance(limit, without) > 2e-3


# ------------------------------------------------------------- motions, rows, tables


@pytest.fixture(scope="module")
def step_truth():
    return Limit(
        RigRod(RIG, 3).motion(rig.MOTIONS[rig.STEP], rig.sample_times(), 1e-4), 0.0, "three terms"
    )


def test_step_starts_straight_and_ends_in_the_equilibrium(step_truth):
    np.testing.assert_allclose(step_truth.tips[0], [0, 0, RIG.reach], atol=1e-12)
    rest = rod_tip(rig.STATIC["rig_pull_10mm"], terms=3)
    np.testing.assert_allclose(step_truth.tips[-1], rest, atol=1e-4)


def test_chain_moves_as_the_rod(step_truth):
    chains = [rig.chain_motion(rig.STEP, "midpoint", n, 2e-3) for n in (4, 8)]
    rows = [cases.timed_row(rig.STEP, cases.BENDING, step_truth, chain) for chain in chains]
    assert rows[0].e_max < 3e-3
    assert rows[1].e_mean < rows[0].e_mean / 3


def test_diverged_chain_is_no_result():
    with pytest.warns(TimestepWarning, match="expect divergence"):
        motion = rig.chain_motion(rig.STEP, "midpoint", 4, 0.02, "RK4")
    with pytest.raises(RuntimeError, match="midpoint with 4 joints diverged at t = "):
        motion()
