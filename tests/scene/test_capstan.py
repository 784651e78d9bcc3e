"""Friction in proportion to tension, along a tendon's way: at rest and in motion."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from softrobot_env.robots import CANTILEVER_WEAK, Drive, Load, Tendon
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.robots.twin import nominal_twin
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import is_swapped
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration.zones import Zones
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.tangent import RubbingForces
from studies.drive import energies
from studies.truths.capstan import HangingRod

LENGTH, DISTANCE, PULL = CANTILEVER_WEAK.length, 0.02, 40.0
MIDDLE = np.array([LENGTH / 2])
BENDING = float(CANTILEVER_WEAK.backbone.bending(MIDDLE)[0])
WEIGHT = 9.81 * float(CANTILEVER_WEAK.backbone.mass(MIDDLE)[0])
LOAD = (-0.1, 0.2)

#: Tension [N]: pulled, let go by a quarter, and pulled again, less far.
LOOP = PULL * np.concatenate(
    [np.linspace(0, 1, 21)[1:], np.linspace(1, 0.75, 21)[1:], np.linspace(0.75, 0.95, 21)[1:]]
)


def rod(coefficient, gravity=0.0, loaded=False, **changes):
    """Hangs, with one tendon; 24 stations."""
    tendons = (Tendon("t", (DISTANCE, 0.0), LENGTH, 0, PULL, friction_coefficient=coefficient),)
    robot = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, gravity), tendons=tendons, **changes)
    loads = (Load("tip", LENGTH, (LOAD[0], 0.0, LOAD[1]), (0.0, 0.0, 0.0)),) if loaded else ()
    return build_scene(SceneConfig(robot, pieces=12, loads=loads))


# ---------------------------------------------------------------- the truth itself


def test_the_exact_rod_without_weight_is_the_formula():
    mu, exact = 0.2, HangingRod(LENGTH, BENDING, DISTANCE, 0.2)
    found = exact.tip_angles(LOOP)
    way = mu * DISTANCE * LENGTH / BENDING
    assert found[:20] == pytest.approx(np.log1p(way * LOOP[:20]) / mu, abs=1e-9)
    # Let go, tension is T0 / (1 - mu r T0 s / EI) up to where it was that before.
    s = np.linspace(0, LENGTH, 100_001)
    for tension, angle in zip(LOOP[20:40], found[20:40], strict=True):
        along = way * s / LENGTH
        grown = tension / np.maximum(1 - along * tension, 1e-9)
        before = PULL / (1 + along * PULL)
        kappa = DISTANCE * np.minimum(grown, before) / BENDING
        assert angle == pytest.approx(np.trapezoid(kappa, s), abs=1e-8)


def test_the_exact_rod_refuses_what_it_does_not_solve():
    sideways = HangingRod(LENGTH, BENDING, DISTANCE, 0.2, load=(1.0, -1.0))
    with pytest.raises(ValueError, match="slides"):
        sideways.tip_angles(LOOP)


# ---------------------------------------------------------------- loops


@cache
def exact_loop(coefficient, loaded):
    loads = {"weight": WEIGHT, "load": LOAD} if loaded else {}
    return HangingRod(LENGTH, BENDING, DISTANCE, coefficient, **loads).tip_angles(LOOP)


def worst_of(found, coefficient, loaded):
    """Largest error of tip angles in a loop, over its width where it was let go."""
    exact = exact_loop(coefficient, loaded)
    width = exact[39] - np.interp(LOOP[39], LOOP[:20], exact[:20])
    return np.abs(found - exact).max() / width


@pytest.mark.parametrize(
    ("coefficient", "loaded"), [(0.05, False), (0.2, False), (0.2, True), (0.4, False)]
)
def test_hysteresis_of_equilibria(coefficient, loaded):
    model = rod(coefficient, 9.81 if loaded else 0.0, loaded=loaded).model
    loads = np.ones(model.nu - 1)
    q = equilibrium(model, np.append(0.0, loads))
    rubbing, found = RubbingForces(model, q), []
    for tension in LOOP:
        q = equilibrium(model, np.append(tension, loads), q, rubbing=rubbing)
        found.append(q.sum())
    assert worst_of(found, coefficient, loaded) < 0.01


def test_equilibria_hold_what_sticks():
    """Also what is left inside of a reversal, however often they are found again."""
    model = rod(0.2).model
    q = equilibrium(model, np.zeros(1))
    rubbing = RubbingForces(model, q)
    q = equilibrium(model, np.array([PULL]), q, rubbing=rubbing)
    once = equilibrium(model, np.array([0.9 * PULL]), q, rubbing=rubbing)
    for _ in range(100):
        again = equilibrium(model, np.array([0.9 * PULL]), once, rubbing=rubbing)
    assert np.abs(again - once).max() < 1e-9


def test_hysteresis_of_slow_motion():
    scene = rod(0.2, density=10.0)  # so that it swings fast
    corners = np.array([0.0, PULL, 0.75 * PULL, 0.95 * PULL])
    times = np.array([0.0, 20.0, 25.0, 29.0])
    asked = np.interp(np.arange(60), [-1, 19, 39, 59], times)

    def pull(t):
        return np.array([np.interp(t, times, corners)])

    motion = scene.simulate(29.0, pull, samples=np.append(0.0, asked))
    assert worst_of(motion.q[1:].sum(axis=1), 0.2, False) < 0.01


def test_nothing_creeps_while_held():
    scene = rod(0.2, 9.81)

    def pull(t):
        return PULL * np.array([np.interp(t, [0.0, 2.0, 3.0], [0.0, 1.0, 0.8])])

    motion = scene.simulate(70.0, pull, samples=1.0)
    tips = np.array([scene.tip(q) for q in motion.q[10:]])
    assert np.abs(tips - tips[0]).max() < 1e-6 * LENGTH


# ---------------------------------------------------------------- turning


def middles(segments=24):
    """Shares of a path up to the middles of its segments."""
    return (np.arange(segments) + 0.5) / segments


def turned(tendon, posture=None, **options):
    """Angles [rad] by which a tendon has turned up to each of its segments, and the chain's data.

    In the straight rod, or in the posture that a function of the model gives.
    """
    tendons = (replace(tendon, friction_coefficient=1.0),)
    robot = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0), tendons=tendons)
    model = build_scene(SceneConfig(robot, **{"pieces": 12} | options)).model
    data = mujoco.MjData(model)
    if posture is not None:
        data.qpos[:] = posture(model)
    mujoco.mj_kinematics(model, data)
    feed, *zones = Zones(model).exponents(data)
    return feed + np.cumsum(zones), data


def line(**changes):
    return Tendon("t", (DISTANCE, 0.0), LENGTH, 0, PULL, **changes)


def angles_between(ways):
    """Sum [rad] along directions (n, 3)."""
    sines = np.linalg.norm(np.cross(ways[1:], ways[:-1]), axis=1)
    return np.arctan2(sines, (ways[1:] * ways[:-1]).sum(axis=1)).sum()


@pytest.mark.parametrize("channels", ["linear", "exact"])
@pytest.mark.parametrize("angle", [0.7, -0.7, 3.0])
def test_turning_in_an_arc(channels, angle):
    found, _ = turned(line(), lambda model: np.full(24, angle / 24), channels=channels)
    assert np.exp(-0.3 * found) == pytest.approx(np.exp(-0.3 * abs(angle) * middles()), rel=1e-8)


def test_turning_in_an_arc_to_the_side():
    """By 0.6 and 0.8 rad: the hinges of a station have any order."""
    sides = np.ravel([(0.6, 0.8)[:: -1 if is_swapped(k) else 1] for k in range(24)]) / 24
    found, _ = turned(line(), lambda _: sides, bending="spatial")
    assert found == pytest.approx(middles(), abs=1e-8)


@pytest.mark.parametrize("winding", [False, True])
def test_turning_along_via_points_is_that_of_their_kinks(winding):
    route = ((0.2, 0.01, 0.01), (0.35, 0.03, -0.01), (LENGTH, 0.0, 0.02))
    if not winding:
        route = tuple((s, x, 0.0) for s, x, _ in route)
    points = np.array([(0.0, DISTANCE, 0.0), *route])
    exact = angles_between(np.diff(points[:, [1, 2, 0]], axis=0))
    found, _ = turned(line(route=route), bending="spatial", torsion=winding)
    assert found[-1] == pytest.approx(exact, abs=1e-8)


def test_turning_along_a_helix():
    """By r w^2 L / sqrt(1 + r^2 w^2) in the straight rod."""
    rate = 2 * np.pi / LENGTH
    exact = DISTANCE * rate**2 * LENGTH / np.hypot(1.0, DISTANCE * rate)
    for pieces in (6, 12):
        found, _ = turned(line(turns=1.0), bending="spatial", torsion=True, pieces=pieces)
        assert found == pytest.approx(exact * middles(len(found)), rel=1e-8)


@pytest.mark.parametrize("bending", ["planar", "spatial"])
def test_turning_at_guides(bending):
    """From the base's axis to the first span, and from span to span."""

    def posture(model):
        return np.random.default_rng(3).normal(0, 0.1, model.nq)

    found, data = turned(line(guides=(0.1, 0.25, 0.4)), posture, bending=bending)
    places = np.array([data.site(f"t_guide{i}").xpos for i in range(5)])
    ways = np.vstack([[0.0, 0.0, 1.0], np.diff(places, axis=0)])
    for zone, angle in enumerate(found):
        assert angle == pytest.approx(angles_between(ways[: zone + 2]), abs=1e-8)


def test_a_feed_line_turns_as_it_says():
    found, _ = turned(line(feed_line=FeedLine(2.5, 0.1)))
    assert found == pytest.approx(np.full(24, 0.25), abs=1e-12)


# ---------------------------------------------------------------- both ends


@pytest.mark.parametrize(
    "servo", [{}, {"gain": 2e4, "velocity_gain": 200.0, "reflected_mass": 0.5}]
)
def test_a_tendon_that_is_wound_up_pulls_its_anchor_by_the_capstans_share(servo):
    """By servos of any force, and by motors that move with the chain."""
    tendon = line(stiffness=5e3, friction_coefficient=0.2)
    robot = replace(CANTILEVER_WEAK, tendons=(tendon,), gravity=(0.0, 0.0, 0.0))
    robot = replace(robot, drive=Drive("length", speed=0.02, **servo))
    scene = build_scene(SceneConfig(robot, pieces=12, actuation="length"))
    servos = Servos.of(nominal_twin(robot), scene.config.control_period)
    simulation = Simulation(scene)
    simulation.drive_by(servos)
    simulation.reset(scene.model.qpos0, np.zeros(1))
    servos.command[:] = 0.02
    while simulation.time < 0.8:
        assert simulation.advance()
    tension = simulation.data.actuator_force[0]
    turned = 0.2 * simulation.posture.sum() * 47 / 48  # up to the middle of the last segment
    assert tension > 1.0
    assert 1 - simulation.tension_lost[0] / tension == pytest.approx(np.exp(-turned), rel=5e-3)


# ---------------------------------------------------------------- energy


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")  # fast modes
@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(12, 1012), marks=pytest.mark.slow)]
)
def test_friction_adds_no_energy(seeds):
    for seed in seeds:
        energy = energies(seed)
        assert np.diff(energy).max() < 1e-5 * np.ptp(energy), seed
