"""Chains at rest against closed forms: in space, with loads that follow, in a plane, rubbing."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from support.chains import EI, KINDS, LENGTH, ROBOT, SIMPLE_RULES, chain
from support.postures import posed

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.robots import ARM, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles, posture
from softrobot_env.scene.config import SceneConfig, visible
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.statics import EquilibriumError, equilibrium
from softrobot_env.scene.tangent import RubbingForces
from softrobot_env.scene.timestep import linearize
from studies.truths.analytic import arc_tip, elastica, section, torsion_angle, torsion_frequency
from studies.truths.spatial_rod import helix

SPATIAL = [kind for kind in KINDS if kind != "planar"]


def turned(vector, azimuth):
    """(3,) rotated about +z."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ vector


def joint_angles_of(built):
    return joint_angles(built.model, built.model.qpos0)


def move_of(model, angles):
    """Change (nv,) of the joints that turns the stations of the straight chain by angles."""
    move = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, move, 1.0, model.qpos0, posture(model, angles))
    return move


def loaded(kind, *, pieces=6, load_steps=1, **load):
    """Scene and its data in equilibrium under a load on the tip."""
    built = chain(kind, pieces=pieces, loads=(Load("load", LENGTH, **load),))
    return built, posed(built.model, equilibrium(built.model, np.ones(1), load_steps=load_steps))


def tip(kind, **options):
    return loaded(kind, **options)[1].site("tip").xpos.copy()


# --- the compiled chain -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", SIMPLE_RULES)
def test_joints_have_the_beams_compliance_about_every_axis(kind, rule):
    built = chain(kind, rule=rule)
    linear, robot = linearize(built.model), KINDS[kind][0]
    # About each axis the joints are springs in series: unit moments on all of them.
    axes = np.eye(joint_angles_of(built).shape[1])
    truth = [EI, EI, robot.torsional_stiffness]  # +x, +y and about the axis
    for axis, stiffness in zip(axes, truth, strict=False):
        move = move_of(built.model, 1e-9 * built.layout.weights[:, None] * axis)
        energy = move @ linear.stiffness @ move
        assert energy == pytest.approx(1e-18 * LENGTH * stiffness, rel=1e-6)
        np.testing.assert_allclose(
            linear.damping @ move, robot.damping_time * linear.stiffness @ move, rtol=1e-12
        )


@pytest.mark.parametrize("kind", SPATIAL)
def test_angles_are_signed_as_documented(kind):
    built = chain(kind)
    n, k = joint_angles_of(built).shape
    for column in range(k):
        angles = np.zeros((n, k))
        angles[:, column] = 0.05
        tip = posed(built.model, posture(built.model, angles)).site("tip")
        if column == 2:  # +x of the tip turns towards +y
            assert tip.xmat.reshape(3, 3)[1, 0] == pytest.approx(np.sin(0.05 * n))
        else:
            assert tip.xpos[column] > 0.05
            np.testing.assert_allclose(tip.xpos[1 - column], 0, atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_posture_and_joint_angles_are_inverse(kind):
    built = chain(kind)
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, joint_angles_of(built).shape)
    np.testing.assert_allclose(
        joint_angles(built.model, posture(built.model, angles)), angles, atol=1e-14
    )


# --- statics ----------------------------------------------------------------------------------


def azimuth_error(kind, pieces):
    """Largest distance [m] between turned-back tips under a lateral force in several azimuths."""
    force = np.array([4.0, 0.0, 0.0])
    straight = tip(kind, pieces=pieces, force=force)
    return max(
        np.linalg.norm(turned(tip(kind, pieces=pieces, force=turned(force, a)), -a) - straight)
        for a in np.radians([30, 45, 90])
    )


def test_ball_joints_bend_alike_in_all_azimuths():
    assert azimuth_error("ball", 3) < 1e-9


@pytest.mark.parametrize("kind", ["universal", "three_hinges"])
def test_hinges_bend_alike_in_all_azimuths_to_fourth_order(kind):
    coarse, fine = azimuth_error(kind, 3), azimuth_error(kind, 6)
    # Of the deflection of 0.35 m, theta^2 / 12 would be missing without `scene.springs`, with
    # theta = 2 rad / 6 stations between the axes.
    assert coarse < 0.05 * 0.35 * (2 / 6) ** 2 / 12
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("kind", SPATIAL)
@pytest.mark.parametrize("azimuth", [0.0, 90.0])
def test_in_a_plane_it_is_the_planar_chain(kind, azimuth):
    load = {"force": (3.0, 0.0, -1.0), "moment": (0.0, 0.1, 0.0)}
    truth, angle = tip("planar", **load), np.radians(azimuth)
    found = tip(kind, **{name: turned(vector, angle) for name, vector in load.items()})
    np.testing.assert_allclose(found, turned(truth, angle), atol=1e-9)


@pytest.mark.parametrize("kind", ["ball", "three_hinges"])
def test_a_world_moment_converges_to_the_helix(kind):
    """With Poisson's ratio barely off zero the rod is the same, its joints are three hinges."""
    robot = replace(ROBOT, poisson_ratio=0.0 if kind == "ball" else 1e-9)
    moment, errors = (0.5, 0.9, 1.2), []
    truth = helix(LENGTH, section(robot, None), moment, [LENGTH]).tip
    load = Load("load", LENGTH, moment=moment)
    for pieces in (6, 12):
        model = chain(kind, robot, pieces=pieces, loads=(load,)).model
        q = equilibrium(model, np.ones(1), load_steps=4)
        errors.append(np.linalg.norm(posed(model, q).site("tip").xpos - truth))
    assert errors[1] < 0.2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)


@pytest.mark.parametrize("kind", ["ball", "three_hinges"])
def test_end_torque_twists_by_its_length_over_gj(kind):
    built, data = loaded(kind, moment=(0.0, 0.0, 0.05))
    twist = torsion_angle(KINDS[kind][0], 0.05)
    angles = joint_angles(built.model, data.qpos)
    assert angles[:, 2].sum() == pytest.approx(twist, rel=1e-9)
    np.testing.assert_allclose(angles[:, :2], 0, atol=1e-12)
    frame = data.site("tip").xmat.reshape(3, 3)
    assert np.arctan2(frame[1, 0], frame[0, 0]) == pytest.approx(twist, rel=1e-9)


def test_equilibria_follow_the_branch_from_straight():
    """Compressed at twice its buckling load, the rod yields to the side it is pushed to.

    The truth is the planar chain, loaded in steps by hand.
    """
    planar = build_scene(SceneConfig(ROBOT, loads=(Load("load", LENGTH, force=(0.3, 0, -5.0)),)))
    q = None
    for share in np.arange(1, 41) / 40:
        q = equilibrium(planar.model, np.array([share]), q)
    truth = posed(planar.model, q).site("tip").xpos
    assert truth[0] > 0.3
    direction = np.radians(25)
    force = turned(np.array([0.3, 0.0, -5.0]), direction)
    for steps in (1, 10):
        np.testing.assert_allclose(
            tip("ball", force=force, load_steps=steps), turned(truth, direction), atol=1e-9
        )
    # Newton's method at once ends on the other side, where the rod would not stay in space.
    model = loaded("ball", force=(-force[0], -force[1], -5.0))[0].model
    other = equilibrium(model, np.ones(1))
    built = chain("ball", pieces=6, loads=(Load("load", LENGTH, force=force),))
    with pytest.raises(EquilibriumError, match="check_stability=False"):
        equilibrium(built.model, np.ones(1), guess=other)


# --- follower loads ---------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_follower_turns_with_the_cross_section(kind):
    """The equilibrium is that of the dead load which is turned as the tip is."""

    def at_rest(guess=None, **load):
        model = build(loads=(Load("load", LENGTH, **load),)).model
        return posed(model, equilibrium(model, np.ones(1), guess))

    build = partial(chain, kind)
    force, moment = (0.8, 0.0 if kind == "planar" else 0.6, -0.5), (0.05, 0.0, 0.02)
    if kind in ("planar", "universal"):  # without torsion none is taken about z, as it would turn
        moment = (0.0, 0.0, 0.0)
    data = at_rest(force=force, moment=moment, follows=True)
    frame = data.site("tip").xmat.reshape(3, 3)
    assert np.linalg.norm(frame @ force - force) > 0.3
    found = at_rest(data.qpos, force=tuple(frame @ force), moment=tuple(frame @ moment))
    np.testing.assert_allclose(found.qpos, data.qpos, atol=1e-9)


# --- tendons ----------------------------------------------------------------------------------


def test_a_planar_chain_takes_the_lateral_offset_of_a_tendon_as_it_did():
    """Only the offset in the bending plane has a moment arm there."""
    robot = replace(ROBOT, tendons=(Tendon("t", (0.02, 0.015), LENGTH, 0, 80.0),))
    model = build_scene(SceneConfig(robot)).model
    assert model.tendon_num[0] == model.nq
    np.testing.assert_array_equal(model.wrap_prm, -0.02)


# --- dynamics ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ball", "three_hinges"])
def test_torsional_frequency_is_the_rods(kind):
    """sqrt(GJ / (rho 2 I)) / (4 L), the quarter wave of a rod clamped at one end."""
    truth, errors = torsion_frequency(KINDS[kind][0]), []
    for pieces in (6, 12):
        built = chain(kind, pieces=pieces)
        linear, n = linearize(built.model), len(built.layout.stations)
        # In the straight pose torsion is uncoupled: take its block alone.
        turns = np.multiply.outer(1e-3 * np.eye(n), [0.0, 0.0, 1.0])
        twist = np.array([move_of(built.model, turn) / 1e-3 for turn in turns])
        mass, stiffness = (twist @ m @ twist.T for m in (linear.mass, linear.stiffness))
        first = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min())
        errors.append(abs(first / (2 * np.pi) / truth - 1))
    assert errors[0] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


# --- what reads a scene -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", SPATIAL)
def test_visible_scene_has_the_same_dynamics_and_room_behind_it(kind):
    robot, options = KINDS[kind]
    bare = SceneConfig(replace(robot, tendons=ARM.tendons), **options)
    plain, seen = build_scene(bare).model, build_scene(visible(bare)).model
    np.testing.assert_array_equal(linearize(seen).mass, linearize(plain).mass)
    assert seen.nskin == 1
    wall = np.flatnonzero(seen.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    # A robot bent towards +y by a quarter turn stays in front of the wall.
    assert seen.geom_pos[wall[0], 1] > robot.length


# --- planar chains against closed forms and the elastica --------------------------------------


FORCE = Load("load", LENGTH, force=(3.0, 0.0, -1.0))
MOMENT = Load("load", LENGTH, moment=(0.0, 1.0, 0.0))
WEIGHT = CANTILEVER_WEAK.mass_per_length * 9.81
PULL = np.array([10.0, -5.0, 20.0])

#: Robot, inputs and loads, and where its tip is (x, z) [m].
TIPS = {
    "weight": (CANTILEVER_WEAK, (), (), lambda: elastica(LENGTH, EI, weight=(-WEIGHT, 0.0)).tip),
    "force": (ROBOT, [1.0], (FORCE,), lambda: elastica(LENGTH, EI, force=(3.0, -1.0)).tip),
    "moment": (ROBOT, [1.0], (MOMENT,), lambda: arc_tip(LENGTH, 1.0 / EI)),
    "tendon": (
        ARM,
        TendonMap(ARM).tension(PULL),
        (),
        lambda: ConstantCurvatureStatics(ARM).tip(PULL),
    ),
}


# A hinge in the middle of each piece, or a pair of them, sees the curvature with an error of
# second order in the piece length, and so do straight links in the place of arcs. With g = 1/3
# the second-order term of the chords' shortening cancels; odd ones never occur. The order
# observed on finite chains is off by the next term, a few per cent here.
@pytest.mark.parametrize("rule", SIMPLE_RULES)
@pytest.mark.parametrize("case", TIPS)
def test_tip_error_is_of_the_rules_order(case, rule):
    robot, controls, loads, truth = TIPS[case]
    constant = case in ("moment", "tendon")
    order = 4 if constant and rule == "chord2" else 2
    errors = []
    for n in (18, 36) if rule == "gauss3" else (12, 24):  # ends of pieces are the tendons'
        config = SceneConfig(robot, pieces=n // len(RULES[rule]), rule=rule, loads=loads)
        built = build_scene(config)
        found = built.tip(built.equilibrium(np.array(controls, float)))[[0, 2]]
        errors.append(np.linalg.norm(found - truth()))
    found = np.log2(errors[0] / errors[1])
    assert found == pytest.approx(order, abs=0.15 if constant else 0.2)


@pytest.mark.parametrize("inputs", [(0, 0, 20), (10, -5, 20), (-40, 60, -30)])
def test_tendons_turn_every_hinge_by_the_exact_curvature(inputs):
    scene = build_scene(SceneConfig(ARM))
    reduced = np.array(inputs, float)
    posture = equilibrium(scene.model, TendonMap(ARM).tension(reduced))
    curvature = ConstantCurvatureStatics(ARM).curvature(reduced, scene.layout.stations)
    np.testing.assert_allclose(posture, curvature * scene.layout.weights, rtol=1e-9)


def test_no_equilibrium_is_reported(monkeypatch):
    """No load so bad is known; what remains is to forbid the path's steps."""
    monkeypatch.setattr("softrobot_env.core.continuation._STEPS", 1)
    with pytest.raises(EquilibriumError, match=r"no equilibrium beyond .* of the loads"):
        build_scene(SceneConfig(CANTILEVER_WEAK)).equilibrium()


@pytest.mark.parametrize("bending", ["planar", "spatial"])
def test_a_backbone_that_rubs_keeps_a_bend_within_its_friction(bending):
    """A moment M bends it to (M - f) / EI; released, it opens where EI k - M would be beyond f."""
    held, most = 0.5 * EI / LENGTH, 1.3 * EI / LENGTH
    robot = replace(ROBOT, bending_friction=held)
    load = Load("load", LENGTH, moment=(0.0, 1.0, 0.0))
    built = build_scene(SceneConfig(robot, pieces=6, bending=bending, loads=(load,)))
    q = built.equilibrium(np.zeros(1))
    rubbing = RubbingForces(built.model, q)
    for moment, bend in ((most, most - held), (most / 2, most - held), (0.0, held)):
        q = equilibrium(built.model, np.array([moment]), q, rubbing=rubbing)
        curvature = joint_angles(built.model, q)[:, 0] / built.layout.weights
        assert EI * curvature == pytest.approx(bend, abs=0.02 * EI / LENGTH)  # it gives by 0.01


def test_a_scene_with_a_backbone_that_rubs_is_not_for_our_integrator():
    robot = replace(ROBOT, bending_friction=1e-3)
    assert build_scene(SceneConfig(robot)).timestep.integrator != "extrapolation"
