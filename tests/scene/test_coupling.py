"""Springs between the pieces: the chain errs by their length to the fourth, at ends the third.

The truths know no mesh: the elastica, rods in space from their tips, and the beam's frequencies.
"""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES, place_hinges
from softrobot_env.scene.springs import excess_stiffness
from softrobot_env.scene.tangent import StaticForces
from studies.truths.analytic import Section, bent_rod
from studies.truths.spatial_rod import dead_loads, followed_rod

ROD = RobotParams("rod", 0.4, 0.005, 0.0, 70e6, 1200.0, 0.01, 6, gravity=(0.0, 0.0, 0.0))
LENGTH, EI = ROD.length, ROD.bending_stiffness
TWISTING = {"bending": "spatial", "torsion": True}


def order(errors):
    """Of errors at doubled resolution."""
    return np.log2(np.array(errors[:-1]) / errors[1:])


def tip(robot, pieces, loads=(), **options):
    built = build_scene(SceneConfig(robot, pieces=pieces, loads=tuple(loads), **options))
    u = np.ones(built.n_inputs)
    return built.tip(built.equilibrium(u, load_steps=5, check_stability=False))


# --- the rule -----------------------------------------------------------------------------------


def test_chains_that_twist_are_coupled_unless_another_rule_is_wanted():
    assert SceneConfig(ROD).hinge_rule == SceneConfig(ROD, bending="spatial").hinge_rule
    assert SceneConfig(ROD).hinge_rule == "balanced2"
    assert SceneConfig(ROD, **TWISTING).hinge_rule == "coupled2"
    assert SceneConfig(ROD, rule="gauss2", **TWISTING).hinge_rule == "gauss2"
    gauss, coupled = (place_hinges(LENGTH, 6, rule) for rule in ("gauss2", "coupled2"))
    np.testing.assert_array_equal(gauss.stations, coupled.stations)
    assert coupled.coupled and not gauss.coupled


@pytest.mark.parametrize("pieces", [3, 4, 7, 20])
def test_moments_that_vary_linearly_turn_and_lift_the_end_as_without_springs(pieces):
    """Without axial force the Gauss points make no error of second order, nor may the springs."""
    compliance = np.linalg.inv(np.eye(pieces) + excess_stiffness(pieces))
    place = np.arange(pieces) + 0.5
    for moment in (np.ones(pieces), place):
        found = compliance @ moment
        assert found.sum() == pytest.approx(moment.sum(), rel=1e-12)
        assert place @ found == pytest.approx(place @ moment, rel=1e-12)


# --- statics ------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.4])
def test_elastica_under_a_force_aslant_is_of_third_order_and_more(angle):
    """From across the straight rod to pulling along it and, bent by a moment, pressing on it."""
    force = 4 * EI / LENGTH**2 * np.array([np.cos(angle), np.sin(angle)])
    moment = 1.0 * EI / LENGTH
    truth = bent_rod(LENGTH, Section(EI), force=tuple(force), moment=moment).tip
    load = Load("load", LENGTH, (force[0], 0.0, force[1]), (0.0, moment, 0.0))
    found = {}
    for rule in ("gauss2", "coupled2"):
        tips = [tip(ROD, n, [load], rule=rule)[[0, 2]] for n in (6, 12, 24)]
        found[rule] = [np.linalg.norm(x - truth) for x in tips]
    np.testing.assert_allclose(order(found["gauss2"]), 2, atol=0.3)
    assert np.all(order(found["coupled2"]) > 3)
    assert found["coupled2"][0] < found["gauss2"][0] / 2


@pytest.mark.parametrize("poisson_ratio", [1e-9, 0.4])
def test_wrenches_in_the_middle_and_at_the_tip_in_space(poisson_ratio):
    """Loads of all directions, also along the rod; seeds that nothing was chosen with."""
    rod = replace(ROD, poisson_ratio=poisson_ratio)
    section, stations = (
        Section(EI, torsion=rod.torsional_stiffness),
        np.array([0.0, LENGTH / 2, LENGTH]),
    )
    rng = np.random.default_rng(2024)
    errors = []
    for _ in range(4):
        force, moment = rng.standard_normal((2, 2, 3)) * [[[EI / LENGTH**2]], [[EI / LENGTH / 2]]]
        follow = [
            Load(name, station, tuple(f), tuple(m), True)
            for name, station, f, m in zip(
                ("middle", "tip"), stations[1:].tolist(), force, moment, strict=True
            )
        ]
        shape = followed_rod(LENGTH, section, follow, stations)
        dead = dead_loads(follow, shape)
        errors.append([np.linalg.norm(tip(rod, n, dead, **TWISTING) - shape.tip) for n in (6, 12)])
    coarse, fine = np.mean(errors, axis=0)
    assert coarse < 0.15e-3
    # What stays of second order is p (EI - GJ) times twist.
    assert np.log2(coarse / fine) > (2.6 if poisson_ratio < 0.1 else 1.8)


def test_a_spiral_at_rest_stays_at_rest():
    robot = replace(ROD, precurvature=(3.0, 1.0))
    built = build_scene(SceneConfig(robot, **TWISTING))
    forces = StaticForces(built.model)
    q = built.model.qpos_spring
    planar = [
        built.model.joint(k).name.startswith(("hinge", "side")) for k in range(built.model.njnt)
    ]
    force = forces.force(q, np.zeros(0))
    linear = forces.tangent() @ np.full(built.model.nv, 1e-3)
    assert np.abs(force[planar]).max() < 0.05 * np.abs(linear).max()


def test_loads_guides_and_ends_of_tendons_are_between_the_pieces_that_are_coupled():
    def coupled(robot, *stations):
        loads = tuple(Load(f"load{k}", s) for k, s in enumerate(stations))
        built = build_scene(SceneConfig(robot, pieces=9, rule="coupled2", loads=loads))
        names = [built.model.tendon(k).name for k in range(built.model.ntendon)]
        return {tuple(map(int, n[12:].split("_"))) for n in names if n.startswith("couple_hinge")}

    whole = coupled(ROD)
    assert whole == {(i, j) for i in range(9) for j in (i + 1, i + 2, i + 3) if j < 9}
    assert coupled(ROD, LENGTH) == whole
    third = LENGTH / 3
    assert coupled(ROD, third) == {(i, j) for i, j in whole if j < 3 or i >= 3}
    # Inside a piece: it is not coupled; two pieces alone are not either.
    assert coupled(ROD, 3.5 / 9 * LENGTH) == {(i, j) for i, j in whole if j < 3 or i >= 4}
    assert coupled(ROD, third, 5 / 9 * LENGTH) == {(i, j) for i, j in whole if j < 3 or i >= 5}
    tendon = Tendon("t", (0.01, 0.0), 2 * third, 0, 50.0)
    assert coupled(replace(ROD, tendons=(tendon,))) == {(i, j) for i, j in whole if j < 6 or i >= 6}
    guides = tuple(np.linspace(0, LENGTH, 10)[1:-1].tolist())
    assert not coupled(replace(ROD, tendons=(replace(tendon, end=LENGTH, guides=guides),)))


# ---------------------------------------------------------------- hinges as quadrature
#: Highest degree of a polynomial each rule integrates exactly: one more than the number of nodes
#: for Gauss rules of one, three and five (2 m - 1), one for the others by symmetry.
DEGREE = {"midpoint": 1, "gauss2": 3, "balanced2": 1, "chord2": 1, "gauss3": 5, "coupled2": 3}


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_hinges_share_out_the_whole_length_inside_their_pieces(rule, pieces):
    layout = place_hinges(0.4, pieces, rule)
    assert len(layout.stations) == len(layout.weights) == pieces * len(RULES[rule])
    assert np.all(np.diff(layout.stations) > 0)
    assert layout.weights.sum() == pytest.approx(0.4, rel=1e-14)
    np.testing.assert_allclose(layout.sizes, 0.4 / pieces, rtol=1e-13)
    np.testing.assert_array_equal(np.floor(layout.stations / (0.4 / pieces)), layout.piece)
    # Mirrored, a robot is the same robot.
    np.testing.assert_allclose(layout.stations, 0.4 - layout.stations[::-1], atol=1e-15)
    np.testing.assert_allclose(layout.weights, layout.weights[::-1], rtol=1e-14)


def test_hinges_stand_where_the_rules_names_say():
    # balanced2 at the first and last fifth, chord2 at a third of the piece from its middle.
    np.testing.assert_allclose(place_hinges(1.0, 1, "balanced2").stations, [1 / 5, 4 / 5])
    np.testing.assert_allclose(place_hinges(1.0, 1, "chord2").stations, [1 / 6, 5 / 6])


@pytest.mark.parametrize("rule", RULES)
def test_rule_is_exact_up_to_its_degree_and_no_further(rule):
    layout = place_hinges(1.0, 1, rule)
    for degree in range(DEGREE[rule] + 1):
        integral = layout.weights @ layout.stations**degree
        assert integral == pytest.approx(1 / (degree + 1), rel=1e-13)
    beyond = DEGREE[rule] + 1
    error = abs(layout.weights @ layout.stations**beyond - 1 / (beyond + 1))
    assert error > 1e-5
