"""The rig in the accuracy benchmark: its truths against closed forms, its models against truths."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import airy

from softrobot_env.evaluation.models.runs import Limit, converged, distance
from softrobot_env.robots import RIG
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.thesis.rig.spatial_piece import make_rig_piece
from studies.accuracy.cases import BENDING, COSSERAT, DISTRIBUTED, DURATION, timed_row
from studies.accuracy.rig import (
    MOTIONS,
    STATIC,
    STEP,
    PieceMotion,
    beam_statics,
    chain_motion,
    chain_statics,
    piece_statics,
    sample_times,
    static_truth,
)
from studies.truths.analytic import arc_tip
from studies.truths.rig_column import column_tip, tensions
from studies.truths.rig_piece import acceleration
from studies.truths.rig_ritz_rod import RigRod

pytestmark = pytest.mark.slow  # a study; the quick suite has what it stands on

L, HEAD, G = RIG.length, RIG.head, 9.81
RADIUS, C = 5.5e-3, RIG.tendons[0].stiffness
WEIGHTLESS = replace(RIG, gravity=(0.0, 0.0, 0.0))
SLACK = np.array(STATIC["rig_slack"])


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
        piece_statics(WEIGHTLESS)(lengths),
    ):
        np.testing.assert_allclose(tip, [x, 0, z], atol=1e-10)


@pytest.mark.parametrize("case", STATIC)
def test_two_independent_truths_agree(case):
    """Initial values in the plane of bending, and polynomials in space."""
    assert distance(rod_tip(STATIC[case]), static_truth(case, BENDING).tips) < 1e-8


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


def test_lengths_that_pull_nowhere_are_refused():
    with pytest.raises(ValueError, match="no side"):
        column_tip(RIG, np.zeros(3), None)


@pytest.mark.parametrize("size", [0.0, 0.3, 0.7])
def test_rod_of_one_term_moves_as_the_closed_form(size):
    """Two derivations of the equations of motion, with coordinates (mu, nu) and (beta, gamma)."""
    rng = np.random.default_rng(3)
    y, v = size * rng.normal(size=2), 4 * rng.normal(size=2)
    pulled = np.array([8e-3, -20e-3, 3e-3])
    out = np.empty(2)
    force = tensions(RIG, pulled, np.array([y[1], -y[0]]))
    acceleration(make_rig_piece(RIG, "distributed"), y, v, force, out)
    found = RigRod(RIG, 1).acceleration(*(np.array([x[1], -x[0]]) for x in (y, v)), pulled)
    np.testing.assert_allclose(found, [out[1], -out[0]], rtol=1e-4)


# ------------------------------------------------------------- models at rest


def test_slack_tendon_carries_nothing_however_far_it_is_let_out():
    further = SLACK - np.array([0, 0, 0.02])
    for solve in (rod_tip, piece_statics(), chain_statics("balanced2", 4)):
        np.testing.assert_allclose(solve(SLACK), solve(further), atol=1e-10)
    rod = RigRod(RIG, 3)
    tension = rod.tension(rod.equilibrium(SLACK), SLACK)
    assert tension[2] == 0
    assert np.all(tension[:2] > 1)


def test_turning_the_lengths_turns_the_tip():
    pulled, third = np.array([12e-3, 6e-3, -3e-3]), 2 * np.pi / 3
    turn = np.array([[np.cos(third), -np.sin(third)], [np.sin(third), np.cos(third)]])
    for solve in (rod_tip, beam_statics(DISTRIBUTED, 2)):
        tip, turned = solve(pulled), solve(np.roll(pulled, 1))
        np.testing.assert_allclose(turned[:2], turn @ tip[:2], atol=1e-9)
        assert turned[2] == pytest.approx(tip[2], abs=1e-9)


def test_head_as_a_load_is_the_head_of_the_closed_form():
    pulled = np.array(STATIC["rig_general"])
    loaded = beam_statics(DISTRIBUTED, 1)(pulled)
    np.testing.assert_allclose(loaded, piece_statics()(pulled), atol=1e-8)


@pytest.mark.parametrize("case", ["rig_pull_20mm", "rig_slack"])
def test_pcc_and_chain_converge_with_second_order(case):
    exact, pulled = static_truth(case, BENDING).tips, np.array(STATIC[case])
    for family, sizes in (
        (lambda n: beam_statics(DISTRIBUTED, n), (2, 4, 8)),
        # Of 4 joints, the springs of scene.springs are of fourth order beside it.
        (lambda n: chain_statics("midpoint", n), (8, 16, 32)),
    ):
        errors = [distance(family(n)(pulled), exact) for n in sizes]
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        np.testing.assert_allclose(orders, 2, atol=0.12)


def test_cosserat_rod_converges_to_the_column_with_shear_and_extension():
    pulled = np.array(STATIC["rig_pull_10mm"])
    tips = {n: beam_statics(COSSERAT, n)(pulled) for n in (3, 6, 12)}
    limit = converged(tips, 1)
    with_shear, without = (column_tip(RIG, pulled, k) for k in (0.75, None))
    assert distance(tips[12], with_shear) < distance(tips[6], with_shear) / 2
    assert distance(limit, with_shear) < 0.5e-3
    assert distance(limit, without) > 2e-3


# ------------------------------------------------------------- motions, rows, tables


@pytest.fixture(scope="module")
def step_truth():
    return Limit(RigRod(RIG, 3).motion(MOTIONS[STEP], sample_times(), 1e-4), 0.0, "three terms")


def test_step_starts_straight_and_ends_in_the_equilibrium(step_truth):
    np.testing.assert_allclose(step_truth.tips[0], [0, 0, RIG.reach], atol=1e-12)
    rest = rod_tip(STATIC["rig_pull_10mm"], terms=3)
    np.testing.assert_allclose(step_truth.tips[-1], rest, atol=1e-4)


def test_chain_moves_as_the_rod(step_truth):
    chains = [chain_motion(STEP, "midpoint", n, 10, "implicitfast") for n in (4, 8)]
    rows = [timed_row(STEP, BENDING, step_truth, chain) for chain in chains]
    assert rows[0].e_max < 3e-3
    assert rows[1].e_mean < rows[0].e_mean / 3


def test_diverged_chain_is_no_result():
    with pytest.warns(TimestepWarning, match="expect divergence"):
        motion = chain_motion(STEP, "midpoint", 4, 1, "RK4")
    with pytest.raises(RuntimeError, match="midpoint with 4 joints diverged at t = "):
        motion()


def test_closed_form_moves_as_the_rod_of_one_term():
    motion = PieceMotion(STEP, 1e-6)
    rod = RigRod(RIG, 1).motion(MOTIONS[STEP], sample_times(), 1e-6)
    assert distance(motion(), rod) < 1e-5
    assert motion.settings.timestep < DURATION / 20
