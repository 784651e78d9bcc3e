"""Beam models and chains of robots with sections, routes, discs and bases against exact rods."""

from dataclasses import replace
from itertools import pairwise as pairs
from math import cos, pi, sin

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import HELICAL, PULLED, ROD, TAPERED, TWO, VIA, WINDING, tendon

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.plant import SteppedModel
from softrobot_env.robots import Base, Disc, RobotParams, Section
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import linearize, slowest
from studies.truths.tendon_rod import guided_rod, hanging_rod, strains, tendon_helix, tendon_rod
from studies.truths.varying_beam import bending_frequencies

SHEAR = 0.75
THREE = tuple((k, 2 * pi * k / 3) for k in range(3))
#: A base that shares no axis with the world.
SLANTED = Base((0.1, -0.2, 0.6), (0.3, -0.5, -0.8), 0.7)
DISCS = (Disc.uniform(0.15, 0.06, 0.03, 0.01), Disc.uniform(0.3, 0.02, 0.02, 0.006))
#: Everything at once, 12 pieces.
ALL = replace(
    TWO,
    gravity=(0.0, 0.0, -9.81),
    discs=DISCS,
    tendons=(
        *TWO.tendons,
        tendon("winding", (0.008, 0.002), 0.4, turns=-0.3),
        tendon("guided", (0.0, 0.008), 0.4, guides=(0.1, 0.2, 0.3), turns=0.25),
    ),
)


def spatial(robot, pieces=None, **options):
    return build_scene(SceneConfig(robot, pieces, bending="spatial", torsion=True, **options))


#: Models with shear and extension, and without.
BEAMS = {
    "pcc": (lambda robot, n, **options: PCC(robot, n, axes="torsion", **options), None),
    "cosserat": (CosseratRod, SHEAR),
}
MODELS = BEAMS | {"chain": (spatial, None)}


def error(model, robot, tension, shear=None):
    """Largest distance [m] of places along the robot."""
    stations = robot.length * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    exact = tendon_rod(robot, tension, stations, shear).position
    found = model.positions(model.equilibrium(np.array(tension)), stations)
    return np.linalg.norm(found - exact, axis=1).max()


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("name", PULLED)
def test_pulled_robots_bend_as_the_exact_rod_and_to_second_order(name, kind):
    (robot, tension), (make, shear) = PULLED[name], MODELS[kind]
    pieces, bound = ((6, 24), 5e-4) if kind == "chain" else ((12, 48), 1.5e-3)
    coarse, fine = (error(make(robot, n), robot, tension, shear) for n in pieces)
    assert coarse < bound * robot.length
    assert fine < max(coarse / 12, 1e-9)


def test_a_uniform_rod_with_its_exact_stiffness_has_no_error_in_two_sections():
    # Constant curvature up to the ends of both tendons: PCC is the exact rod.
    robot, tension = PULLED["two sections"]
    assert error(PCC(robot, 2, axes="torsion"), robot, tension) < 1e-9


@pytest.mark.parametrize("shear", [None, SHEAR])
def test_a_helical_tendon_bends_the_exact_rod_into_a_helix(shear):
    stations = np.linspace(0, 0.4, 9)
    helix = tendon_helix(HELICAL, 4.0, stations, shear).position
    found = tendon_rod(HELICAL, [4.0], stations, shear).position
    assert_allclose(found, helix, atol=1e-9)


@pytest.mark.parametrize("kind", BEAMS)
def test_routed_tendons_pull_along_the_gradient_of_their_length(kind):
    model = MODELS[kind][0](ALL, 6)
    rng = np.random.default_rng(3)
    q = model.rest() + 0.05 * model.data.scale * rng.standard_normal(model.n)
    zero, step = np.zeros(model.n), 1e-6
    free = model.residual(q, zero, zero)
    for k in range(4):
        pull = free - model.residual(q, zero, zero, np.eye(4)[k])
        way = model.data.scale * rng.standard_normal(model.n)
        longer = model.tendon_length(q + step * way) - model.tendon_length(q - step * way)
        assert pull @ way == pytest.approx(-longer[k] / (2 * step), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("kind", BEAMS)
@pytest.mark.parametrize("robot", [HELICAL, VIA, ALL], ids=lambda robot: robot.name)
def test_tendons_are_as_long_as_their_routes_in_the_straight_robot(robot, kind):
    model = MODELS[kind][0](robot, 12)
    expected = [t.straight_length for t in robot.tendons]
    assert_allclose(model.tendon_length(model.rest()), expected, rtol=1e-7)


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


def test_driven_by_length_the_chain_and_pcc_agree():
    pulled = np.array([0.003, 0.001, 0.0, 0.0])
    tendons = tuple(replace(t, pretension=1.0) for t in ALL.tendons)  # all of them stay taut
    robot = replace(ALL, tendons=tendons, gravity=(0.0, 0.0, 0.0))
    chain = spatial(robot, actuation="length")
    model = PCC(robot, axes="torsion", drive="length")
    found = chain.tip(chain.equilibrium(pulled)), model.tip(model.equilibrium(pulled))
    assert np.linalg.norm(found[0] - found[1]) < 1e-3 * ALL.length


# ---------------------------------------------------------------- dynamics


@pytest.mark.parametrize(
    "robot",
    [
        TWO,
        TAPERED,
        replace(TWO, discs=DISCS),
        replace(ROD, discs=(DISCS[0], Disc(0.4, 0.03, (1e-5,) * 3))),
    ],
    ids=["two sections", "tapered", "discs on two sections", "discs"],
)
def test_frequencies_are_those_of_the_exact_beam(robot):
    def own(model):
        return model.linearize(model.start()).frequencies()

    robot = replace(robot, tendons=())
    exact = bending_frequencies(robot, 3)
    chain = linearize(build_scene(SceneConfig(robot)).model).frequencies()[:3] / (2 * pi)
    assert_allclose(chain, exact, rtol=2e-3)
    assert chain[0] == pytest.approx(exact[0], rel=5e-4)
    assert slowest(robot, winding=False) == pytest.approx(2 * pi * exact[0], rel=0.15)
    pcc = own(PCC(robot, 24, axes="planar", inertia="distributed"))[:2]
    assert_allclose(pcc, exact[:2], rtol=3e-3)
    lumped = own(PCC(robot, 24, axes="planar"))[0]
    assert lumped == pytest.approx(exact[0], rel=3e-3)
    # Shear, which the exact beam has not, is a share of (radius / length)^2.
    cosserat = own(CosseratRod(robot, 24))[:4:2]
    assert np.all(np.abs(cosserat / exact[:2] - 1) < [4e-3, 2e-2])


def test_all_models_move_alike():
    robot = replace(ALL, base=SLANTED)
    u = np.array([2.0, 1.0, 0.5, 0.5])
    chain = spatial(robot, accuracy=1e-5)
    truth = chain.tip(chain.simulate(0.2, u, samples=0.1).q)[1:]
    assert np.linalg.norm(truth[1] - truth[0]) > 0.02
    for model in (PCC(robot, axes="torsion", inertia="distributed"), CosseratRod(robot)):
        found = model.tip(model.simulate(0.2, u, samples=0.1, tolerance=1e-4).q)[1:]
        # Cosserat's rod is shorter by what its tendons and its weight compress it.
        off = np.linalg.norm(found - truth, axis=1).max()
        assert off < (0.002 if isinstance(model, PCC) else 0.01) * robot.length


def test_the_own_integrator_moves_all_of_it_as_runge_kutta():
    robot = replace(ALL, base=SLANTED)
    u = np.array([1.0, 0.5, 0.5, 0.5])
    own = spatial(robot, accuracy=1e-5, pieces=4)
    other = spatial(robot, integrator="RK4", timestep=1e-4, pieces=4)
    found, truth = (built.tip(built.simulate(0.1, u, samples=0.05).q) for built in (own, other))
    assert_allclose(found, truth, atol=2e-5)


@pytest.mark.parametrize("kind", BEAMS)
def test_sections_with_damping_times_of_their_own_lose_energy_in_each(kind):
    make = MODELS[kind][0]
    bare = replace(TWO, tendons=())

    def power(*times):
        robot = bare.with_sections(
            *(replace(s, damping_time=t) for s, t in zip(TWO.sections, times, strict=True))
        )
        model = make(robot, 8)
        rng = np.random.default_rng(2)
        v = model.data.scale * rng.standard_normal(model.n)
        zero = np.zeros(model.n)
        return v @ (
            model.residual(model.rest(), v, zero) - model.residual(model.rest(), zero, zero)
        )

    # Gyroscopic forces do no work at rest, so the power is linear in both.
    still, first, second, both = power(0, 0), power(1, 0), power(0, 1), power(1, 1)
    assert min(first - still, second - still) > 0
    within = 1e-9 if kind == "pcc" else 0.02  # a segment lies in both sections
    assert both - still == pytest.approx(first + second - 2 * still, rel=within)


# ---------------------------------------------------------------- bases


@pytest.mark.parametrize("kind", MODELS)
def test_a_turned_base_is_a_turned_gravity(kind):
    turned, axes = replace(ALL, base=SLANTED), SLANTED.axes
    load = Load("load", 0.3, (0.05, 0.02, -0.03), (0.001, 0.0, 0.002))
    seen = replace(load, force=tuple(axes.T @ load.force), moment=tuple(axes.T @ load.moment))
    upright, make = replace(ALL, gravity=turned.own_gravity), MODELS[kind][0]
    one, other = make(turned, 6, loads=(load,)), make(upright, 6, loads=(seen,))
    u = np.array([2.0, 1.0, 0.5, 0.5, 1.0])
    q = one.equilibrium(u)
    assert_allclose(q, other.equilibrium(u), atol=1e-9 if kind == "chain" else 1e-7)
    places, offsets = [0.0, 0.1, 0.25, 0.4], np.full((4, 2), 0.01)
    expected = other.positions(q, places, offsets) @ axes.T + SLANTED.position
    assert_allclose(one.positions(q, places, offsets), expected, atol=1e-12)
    assert_allclose(one.tip(q), axes @ other.tip(q) + SLANTED.position, atol=1e-12)
    v = np.random.default_rng(0).standard_normal(len(one.start().v))
    speed = other.velocities(q, v, places) @ axes.T
    assert_allclose(one.velocities(q, v, places), speed, atol=1e-9)
    if kind != "chain":
        # About the world's origin the momentum also has that of the centre of mass.
        linear, angular = other.momentum(q, v).reshape(2, 3) @ axes.T
        angular = angular + np.cross(SLANTED.position, linear)
        assert_allclose(one.momentum(q, v), [*linear, *angular], atol=1e-9)


def test_a_plants_tip_is_measured_in_the_world():
    base = Base((0.2, 0.0, 0.5), (0.6, 0.0, -0.8))
    plain = replace(TWO, tendons=TWO.tendons[:1])
    plants = [
        SteppedModel(robot, lambda r, loads: PCC(r, axes="planar", loads=loads))
        for robot in (plain, replace(plain, base=base))
    ]
    q = plants[0].bent(np.linspace(1.0, 4.0, 12))
    here, there = (plant.measure(q, np.zeros_like(q)) for plant in plants)
    assert_allclose(here.curvature, np.linspace(1.0, 4.0, 12), rtol=1e-8)
    x, z = here.tip_position
    expected = base.axes @ [x, 0, z] + base.position
    assert_allclose(there.tip_position, expected[[0, 2]], atol=1e-12)
    assert_allclose(there.curvature, here.curvature)


def test_a_hanging_planar_robot_is_stretched_by_its_weight():
    frequency = {}
    for direction in ((0, 0, 1), (0, 0, -1)):
        robot = replace(ROD, gravity=ALL.gravity, base=Base(direction=direction))
        frequency[direction] = slowest(robot, winding=False)
    assert frequency[0, 0, -1] > 1.2 * frequency[0, 0, 1]


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ANCF(TWO), "ANCF needs a backbone of one section.*'two'"),
        (lambda: ANCF(HELICAL), r"ANCF knows no channels that are not straight \(helical\)"),
        (lambda: ANCF(replace(ROD, discs=DISCS)), "ANCF knows no discs"),
        (lambda: CosseratRod(TAPERED, grid="thesis"), "the grid 'thesis' needs a backbone of one"),
        (lambda: CosseratRod(TWO, clamped=False), "the grid 'thesis' needs a backbone of one"),
        (lambda: PCC(HELICAL), r"axes 'spatial' cannot twist; remove tendon 'helical' \(winds"),
        (lambda: PCC(HELICAL, axes="planar"), r"remove tendon 'helical' \(offset y\)"),
        (lambda: PCC(TWO, 1), "a piece for each of 2 sections"),
        (
            lambda: build_scene(SceneConfig(HELICAL)),
            r"bending='planar' cannot twist; remove tendon 'helical' \(winds",
        ),
        (
            lambda: build_scene(SceneConfig(HELICAL, bending="spatial")),
            r"torsion=False cannot twist; remove tendon 'helical'",
        ),
        (lambda: spatial(TWO, 1), "need a piece for each of 2 sections, got 1"),
        (lambda: spatial(TWO, (3, 3, 3)), r"need pieces of 2 sections, got \(3, 3, 3\)"),
        (lambda: spatial(TWO, (3, 0)), "pieces"),
        (
            lambda: spatial(replace(TWO, tendons=(tendon("t", (0.01, 0.0), 0.3),)), (2, 2)),
            "'t' ends inside a piece.*nearest ends at 0.325 m.*or end a section there",
        ),
        (
            lambda: build_scene(
                SceneConfig(replace(ROD, gravity=ALL.gravity, base=Base(direction=(0, 1, 0))))
            ),
            r"gravity \(y\)",
        ),
    ],
)
def test_what_a_model_cannot_do_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.slow  # compiling the models takes long
def test_ancf_has_guides_at_any_offset_and_a_base():
    route = ((0.4, 0.002, 0.0),)
    slender = replace(
        ROD,
        poisson_ratio=0.0,
        tendons=(tendon("g", (0.01, 0.0), 0.4, guides=(0.1, 0.2, 0.3), route=route),),
        base=SLANTED,
    )
    tips = [
        model.tip(model.equilibrium(np.array([0.5])))
        for model in (ANCF(slender, 16), CosseratRod(slender, 32))
    ]
    # The continuum differs from a rod by a share of its strain.
    assert np.linalg.norm(tips[0] - tips[1]) < 1e-3 * slender.length


# ---------------------------------------------------------------- guides and weight


def guided(turns):
    """A rod with uneven discs."""
    guides = (0.07, 0.12, 0.2, 0.26, 0.33)
    one = tendon("guided", (0.008, -0.003), 0.4, guides=guides, turns=turns)
    return replace(ROD, tendons=(one,))


HEAVY = replace(HELICAL, gravity=(0.5, 0.3, -1.0))


@pytest.mark.parametrize(
    ("robot", "exact"),
    [
        (guided(0.0), guided_rod),
        (guided(-0.5), guided_rod),
        pytest.param(HEAVY, hanging_rod, marks=pytest.mark.slow),  # takes ten seconds
    ],
    ids=["guides", "winding guides", "weight"],
)
def test_exact_rods_with_guides_or_weight_are_the_limit_of_pcc(robot, exact):
    tip = exact(robot, [3.0], [robot.length]).tip
    models = [PCC(robot, pieces, axes="torsion") for pieces in (20, 40)]
    tips = [model.tip(model.equilibrium(np.array([3.0]))) for model in models]
    off = np.linalg.norm(tips - tip, axis=1) / robot.length
    assert off[1] < off[0] / 3 < 1e-3
    assert np.linalg.norm(tip - [0, 0, robot.length]) > 0.09


@pytest.mark.slow
def test_exact_rods_with_weight_have_those_without_as_their_limit():
    light = replace(HEAVY, gravity=(0.0, 0.0, 0.0))
    one, other = (f(light, [3.0], [0.2, 0.4]) for f in (hanging_rod, tendon_rod))
    assert_allclose(one.position, other.position, atol=1e-8)


@pytest.mark.parametrize("turns", [0.0, -0.5])
def test_a_rod_with_pieces_between_its_guides_is_exact_at_once(turns):
    robot = guided(turns)
    exact = guided_rod(robot, [3.0], [robot.length], 0.75).tip
    model = CosseratRod(robot)
    assert model.pieces == CosseratRod.fewest(robot) == 12
    tip = model.tip(model.equilibrium(np.array([3.0])))
    assert np.linalg.norm(tip - exact) < 2e-3 * robot.length
    even = CosseratRod(robot, 11)  # too few for that
    assert_allclose(np.diff(even.edges), robot.length / 11)
    more = CosseratRod(robot, 29)
    assert np.isin(np.round(robot.tendons[0].stations, 9), np.round(more.edges, 9)).all()
