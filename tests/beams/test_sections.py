"""Beam models of robots with sections, routes, discs and bases against exact rods."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import HELICAL, PULLED, ROD, TAPERED, TWO, VIA, tendon

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.plant import SteppedModel
from softrobot_env.robots import Base, Disc
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from studies.truths.tendon_rod import guided_rod, hanging_rod, tendon_helix, tendon_rod
from studies.truths.varying_beam import bending_frequencies

SHEAR = 0.75
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
#: Models with shear and extension, and without.
MODELS = {
    "pcc": (lambda robot, n, **options: PCC(robot, n, axes="torsion", **options), None),
    "cosserat": (CosseratRod, SHEAR),
}


def error(model, shear, tension):
    robot = model.robot
    exact = tendon_rod(robot, tension, [robot.length], shear).tip
    return np.linalg.norm(model.tip(model.equilibrium(np.array(tension))) - exact)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("name", PULLED)
def test_pulled_robots_bend_as_the_exact_rod_and_to_second_order(name, kind):
    (robot, tension), (make, shear) = PULLED[name], MODELS[kind]
    coarse, fine = (error(make(robot, n), shear, tension) for n in (12, 48))
    assert coarse < 1.5e-3 * robot.length
    assert fine < max(coarse / 12, 1e-9)


def test_a_uniform_rod_with_its_exact_stiffness_has_no_error_in_two_sections():
    # Constant curvature up to the ends of both tendons: PCC is the exact rod.
    robot, tension = PULLED["two sections"]
    assert error(PCC(robot, 2, axes="torsion"), None, tension) < 1e-9


@pytest.mark.parametrize("kind", MODELS)
def test_a_helical_tendon_bends_a_rod_into_a_helix(kind):
    make, shear = MODELS[kind]
    stations = np.linspace(0, 0.4, 9)
    exact = tendon_helix(HELICAL, 4.0, stations, shear)
    model = make(HELICAL, 24)
    found = model.positions(model.equilibrium(np.array([4.0])), stations)
    assert np.abs(found - exact.position).max() < 5e-4 * HELICAL.length


@pytest.mark.parametrize("kind", MODELS)
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


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("robot", [HELICAL, VIA, ALL], ids=lambda robot: robot.name)
def test_tendons_are_as_long_as_their_routes_in_the_straight_robot(robot, kind):
    model = MODELS[kind][0](robot, 12)
    expected = [t.straight_length for t in robot.tendons]
    assert_allclose(model.tendon_length(model.rest()), expected, rtol=1e-7)


def test_driven_by_length_the_chain_and_pcc_agree():
    pulled = np.array([0.003, 0.001, 0.0, 0.0])
    tendons = tuple(replace(t, pretension=1.0) for t in ALL.tendons)  # all of them stay taut
    robot = replace(ALL, tendons=tendons, gravity=(0.0, 0.0, 0.0))
    chain = build_scene(SceneConfig(robot, bending="spatial", torsion=True, actuation="length"))
    model = PCC(robot, axes="torsion", drive="length")
    found = chain.tip(chain.equilibrium(pulled)), model.tip(model.equilibrium(pulled))
    assert np.linalg.norm(found[0] - found[1]) < 1e-3 * ALL.length


# ---------------------------------------------------------------- dynamics


def _frequencies(model):
    space = model.linearize(model.start())
    squares = np.linalg.eigvals(np.linalg.solve(space.mass, space.stiffness)).real
    return np.sqrt(np.sort(squares)) / (2 * np.pi)


@pytest.mark.parametrize("robot", [TWO, TAPERED, replace(TWO, discs=DISCS)], ids=lambda r: r.name)
def test_frequencies_are_those_of_the_exact_beam(robot):
    robot = replace(robot, tendons=())
    exact = bending_frequencies(robot, 2)
    pcc = _frequencies(PCC(robot, 24, axes="planar", inertia="distributed"))[:2]
    assert_allclose(pcc, exact, rtol=3e-3)
    lumped = _frequencies(PCC(robot, 24, axes="planar"))[:1]
    assert_allclose(lumped, exact[:1], rtol=3e-3)
    # Shear, which the exact beam has not, is a share of (radius / length)^2.
    cosserat = _frequencies(CosseratRod(robot, 24))[:4:2]
    assert np.all(np.abs(cosserat / exact - 1) < [4e-3, 2e-2])


def test_all_models_move_alike():
    robot = replace(ALL, base=SLANTED)
    u = np.array([2.0, 1.0, 0.5, 0.5])
    chain = build_scene(SceneConfig(robot, bending="spatial", torsion=True, accuracy=1e-5))
    truth = chain.tip(chain.simulate(0.2, u, samples=0.1).q)[1:]
    assert np.linalg.norm(truth[1] - truth[0]) > 0.02
    for model in (PCC(robot, axes="torsion", inertia="distributed"), CosseratRod(robot)):
        found = model.tip(model.simulate(0.2, u, samples=0.1, tolerance=1e-4).q)[1:]
        # Cosserat's rod is shorter by what its tendons and its weight compress it.
        off = np.linalg.norm(found - truth, axis=1).max()
        assert off < (0.002 if isinstance(model, PCC) else 0.01) * robot.length


@pytest.mark.parametrize("kind", MODELS)
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
    upright = replace(ALL, gravity=turned.own_gravity)
    one, other = MODELS[kind][0](turned, 6, loads=[load]), MODELS[kind][0](upright, 6, loads=[seen])
    u, rng = np.array([2.0, 1.0, 0.5, 0.5, 1.0]), np.random.default_rng(0)
    q = one.equilibrium(u)
    assert_allclose(q, other.equilibrium(u), atol=1e-7)
    places = [0.1, 0.4]
    expected = other.positions(q, places) @ axes.T + SLANTED.position
    assert_allclose(one.positions(q, places), expected, atol=1e-12)
    v = one.data.scale * rng.standard_normal(one.n)
    assert_allclose(
        one.velocities(q, v, places), other.velocities(q, v, places) @ axes.T, atol=1e-9
    )
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


@pytest.mark.parametrize("turns", [0.0, -0.5])
def test_exact_rods_with_guides_are_the_limit_of_pcc(turns):
    robot, tips = guided(turns), []
    for pieces in (20, 40):
        model = PCC(robot, pieces, axes="torsion")
        tips.append(model.tip(model.equilibrium(np.array([3.0]))))
    exact = guided_rod(robot, [3.0], [robot.length]).tip
    off = [np.linalg.norm(tip - exact) / robot.length for tip in tips]
    assert off[1] < off[0] / 3 < 1e-3
    assert np.linalg.norm(exact - [0, 0, robot.length]) > 0.09


@pytest.mark.slow  # the exact one takes ten seconds
def test_exact_rods_with_weight_are_the_limit_of_pcc_and_of_rods_without():
    robot, tension = replace(HELICAL, gravity=(0.5, 0.3, -1.0)), [3.0]
    exact, off = hanging_rod(robot, tension, [0.4]).tip, []
    for pieces in (12, 24):
        model = PCC(robot, pieces, axes="torsion")
        tip = model.tip(model.equilibrium(np.array(tension)))
        off.append(np.linalg.norm(tip - exact) / 0.4)
    assert off[1] < off[0] / 3 < 1e-3
    light = replace(robot, gravity=(0.0, 0.0, 0.0))
    one, other = (f(light, tension, [0.2, 0.4]) for f in (hanging_rod, tendon_rod))
    np.testing.assert_allclose(one.position, other.position, atol=1e-8)


@pytest.mark.parametrize("turns", [0.0, -0.5])
def test_a_rod_with_pieces_between_its_guides_is_exact_at_once(turns):
    robot = guided(turns)
    exact = guided_rod(robot, [3.0], [robot.length], 0.75).tip
    model = CosseratRod(robot)
    assert model.pieces == CosseratRod.fewest(robot) == 12
    tip = model.tip(model.equilibrium(np.array([3.0])))
    assert np.linalg.norm(tip - exact) < 2e-3 * robot.length
    even = CosseratRod(robot, 11)  # too few for that
    np.testing.assert_allclose(np.diff(even.edges), robot.length / 11)
    more = CosseratRod(robot, 29)
    assert np.isin(np.round(robot.tendons[0].stations, 9), np.round(more.edges, 9)).all()
