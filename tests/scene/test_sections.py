"""Chains of robots with sections, routes, discs and bases against exact rods."""

from dataclasses import replace
from itertools import pairwise as pairs
from math import cos, pi, sin

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import HELICAL, PULLED, ROD, TAPERED, TWO, WINDING, tendon

from softrobot_env.robots import Base, Disc, RobotParams, Section
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import linearize, slowest
from studies.truths.tendon_rod import guided_rod, strains, tendon_rod
from studies.truths.varying_beam import bending_frequencies

#: A base that shares no axis with the world.
SLANTED = Base((0.1, -0.2, 0.6), (0.3, -0.5, -0.8), 0.7)
THREE = tuple((k, 2 * pi * k / 3) for k in range(3))
GRAVITY = (0.0, 0.0, -9.81)
ALL = replace(
    TWO,
    gravity=GRAVITY,
    discs=(Disc.uniform(0.25, 0.01, 0.02, 0.004),),
    tendons=(
        *TWO.tendons,
        tendon("winding", (0.008, 0.002), 0.4, turns=-0.3),
        tendon("guided", (0.0, 0.008), 0.4, guides=(0.1, 0.2, 0.3), turns=0.25),
    ),
)


def spatial(robot, **options):
    return build_scene(SceneConfig(robot, bending="spatial", torsion=True, **options))


# ---------------------------------------------------------------- statics


@pytest.mark.parametrize("name", PULLED)
def test_pulled_robots_bend_as_the_exact_rod(name):
    robot, tension = PULLED[name]
    built = spatial(robot)
    tip = tendon_rod(robot, tension, [robot.length]).tip
    off = np.linalg.norm(built.tip(built.equilibrium(np.array(tension))) - tip)
    assert off < 5e-4 * robot.length
    assert off < 5e-3 * np.linalg.norm(tip - [0, 0, robot.length])


def strain_errors(robot, tension, **options):
    """Of the mean strains of thirds, over the largest of them."""
    built, fine = spatial(robot, **options), 24
    found = built.curvature(built.equilibrium(np.array(tension)))
    middles = (np.arange(3 * fine) + 0.5) * robot.length / (3 * fine)
    exact = np.array([strains(robot, np.array(tension), s, None)[1] for s in middles])
    exact = exact.reshape(3, fine, 3).mean(axis=1)
    return np.abs(found.reshape(3, -1, 3).mean(axis=1) - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("name", WINDING)
def test_winding_tendons_bend_and_twist_a_rod_by_the_exact_strains(name):
    robot, tension = WINDING[name]
    assert spatial(robot).config.exact_channels
    assert strain_errors(robot, tension) < 2e-3
    assert strain_errors(robot, tension, channels="linear") > 5e-3


def test_straight_tendons_resist_torsion_as_the_exact_rod():
    # A moment M twists by M / (GJ + T r^2); linear channels leave out the tendons' part.
    tendons = tuple(tendon(f"t{k}", (0.009 * cos(a), 0.009 * sin(a)), 0.4) for k, a in THREE)
    robot, load = replace(ROD, tendons=tendons), Load("torque", 0.4, moment=(0, 0, 1e-4))
    resisting = 3 * 10.0 * 0.009**2
    for channels, stiffness in (("exact", resisting), (None, 0.0)):
        built = spatial(robot, loads=(load,), channels=channels)
        q = built.equilibrium(np.array([10.0, 10.0, 10.0, 1.0]))
        exact = 1e-4 / (robot.torsional_stiffness + stiffness)
        assert_allclose(built.curvature(q)[:, 2], exact, rtol=1e-3)
    assert resisting > 0.1 * robot.torsional_stiffness


def test_channels_do_not_couple_pieces():
    assert spatial(ROD).config.hinge_rule == "coupled2"
    assert spatial(TWO).config.hinge_rule == "gauss2"
    assert not spatial(TWO).config.exact_channels


def test_a_winding_tendon_driven_by_length_pulls_as_its_stiffness_says():
    pulled = replace(HELICAL.tendons[0], pretension=2.0)
    built = spatial(replace(HELICAL, tendons=(pulled,)), actuation="length")
    data = mujoco.MjData(built.model)
    for q in (built.model.qpos0, built.equilibrium(np.array([2e-3]))):
        data.qpos[:], data.ctrl[:] = q, 2e-3
        mujoco.mj_forward(built.model, data)
        shorter = pulled.straight_length - built.tendon_length(q)[0]
        assert data.actuator_force[0] == pytest.approx(2.0 + 2e3 * (2e-3 - shorter), rel=1e-9)
    assert shorter > 1e-4


@pytest.mark.parametrize("turns", [0.0, 0.4])
def test_a_chain_whose_pieces_end_at_guides_bends_as_the_exact_rod(turns):
    guides = (0.06, 0.13, 0.21, 0.27, 0.34)
    edges = (0.0, *guides, 0.4)
    parts = [Section(b - a, 0.003, 4e7, 1100.0, 0.0, 1, poisson_ratio=0.3) for a, b in pairs(edges)]
    guided = tendon("guided", (0.009, 0.003), 0.4, guides=guides, turns=turns)
    robot = RobotParams("guided", sections=tuple(parts), tendons=(guided,))
    exact, off = guided_rod(robot, [0.7], [0.4]).tip, {}
    for rule in (None, "coupled2"):
        built = spatial(robot, rule=rule)
        off[rule] = np.linalg.norm(built.tip(built.equilibrium(np.array([0.7]))) - exact) / 0.4
    assert np.linalg.norm(exact - [0, 0, 0.4]) > 0.1
    assert off[None] < 0.002 and off[None] < off["coupled2"] / 3
    within = replace(ROD, tendons=(guided,))  # guides are no ends of its pieces
    assert spatial(within).config.hinge_rule == "coupled2"


# ---------------------------------------------------------------- dynamics


@pytest.mark.parametrize(
    "robot",
    [
        replace(TWO, tendons=()),
        replace(TAPERED, tendons=()),
        replace(ROD, discs=(Disc.uniform(0.15, 0.06, 0.03, 0.01), Disc(0.4, 0.03, (1e-5,) * 3))),
        replace(TWO, tendons=(), discs=(Disc.uniform(0.3, 0.02, 0.02, 0.006),)),
    ],
    ids=["two sections", "tapered", "discs", "discs on two sections"],
)
def test_frequencies_are_those_of_the_exact_beam(robot):
    exact = bending_frequencies(robot, 3)
    chain = linearize(build_scene(SceneConfig(robot)).model)
    found = chain.frequencies()[:3] / (2 * pi)
    assert_allclose(found, exact, rtol=2e-3)
    assert found[0] == pytest.approx(exact[0], rel=5e-4)
    assert slowest(robot, winding=False) == pytest.approx(2 * pi * exact[0], rel=0.15)


def test_the_own_integrator_moves_all_of_it_as_runge_kutta():
    robot = replace(ALL, base=SLANTED)
    u = np.array([1.0, 0.5, 0.5, 0.5])
    own = spatial(robot, accuracy=1e-5, pieces=4)
    other = spatial(robot, integrator="RK4", timestep=1e-4, pieces=4)
    found, truth = (built.tip(built.simulate(0.1, u, samples=0.05).q) for built in (own, other))
    assert_allclose(found, truth, atol=2e-5)


# ---------------------------------------------------------------- bases


def test_a_turned_base_is_a_turned_gravity():
    turned = replace(ALL, base=SLANTED)
    axes, u = SLANTED.axes, np.array([2.0, 1.0, 0.5, 0.5, 1.0])
    load = Load("load", 0.3, (0.05, 0.02, -0.03), (0.001, 0.0, 0.002))
    seen = replace(load, force=tuple(axes.T @ load.force), moment=tuple(axes.T @ load.moment))
    upright = replace(ALL, gravity=turned.own_gravity)
    one, other = spatial(turned, loads=(load,)), spatial(upright, loads=(seen,))
    q, p = one.equilibrium(u), other.equilibrium(u)
    assert_allclose(q, p, atol=1e-9)
    places, offsets = [0.0, 0.1, 0.25, 0.4], np.full((4, 2), 0.01)
    expected = other.positions(p, places, offsets) @ axes.T + SLANTED.position
    assert_allclose(one.positions(q, places, offsets), expected, atol=1e-9)
    assert_allclose(one.tip(q), axes @ other.tip(p) + SLANTED.position, atol=1e-9)
    v = np.random.default_rng(1).standard_normal(one.model.nv)
    speed = other.velocities(q, v, places) @ axes.T
    assert_allclose(one.velocities(q, v, places), speed, atol=1e-9)


def test_a_hanging_planar_robot_is_stretched_by_its_weight():
    frequency = {}
    for direction in ((0, 0, 1), (0, 0, -1)):
        robot = replace(ROD, gravity=GRAVITY, base=Base(direction=direction))
        frequency[direction] = slowest(robot, winding=False)
    assert frequency[0, 0, -1] > 1.2 * frequency[0, 0, 1]


# ---------------------------------------------------------------- what is built, what is refused


@pytest.mark.parametrize(
    ("robot", "options", "message"),
    [
        (HELICAL, {}, r"bending='planar' cannot twist; remove tendon 'helical' \(winds"),
        (HELICAL, {"bending": "spatial"}, r"torsion=False cannot twist; remove tendon 'helical'"),
        (TWO, {"pieces": 1}, "need a piece for each of 2 sections, got 1"),
        (TWO, {"pieces": (3, 3, 3)}, r"need pieces of 2 sections, got \(3, 3, 3\)"),
        (TWO, {"pieces": (3, 0)}, "pieces"),
        (
            replace(TWO, tendons=(tendon("t", (0.01, 0.0), 0.3),)),
            {"pieces": (2, 2)},
            "'t' ends inside a piece.*nearest ends at 0.325 m.*or end a section there",
        ),
        (
            replace(ROD, gravity=(0.0, 0.0, -9.81), base=Base(direction=(0, 1, 0))),
            {},
            r"gravity \(y\)",
        ),
    ],
)
def test_what_a_chain_cannot_do_is_refused_by_name(robot, options, message):
    with pytest.raises(ValueError, match=message):
        build_scene(SceneConfig(robot, **options))
