"""Statics of Cosserat rods down to a radius of 1/2000 of the length, against exact rods.

Loads that follow the sections have one equilibrium only, which `spatial_rod.followed_rod` finds
without solving an equation.
"""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.robots import CANTILEVER_STIFF, RobotParams
from softrobot_env.robots.loads import Load
from studies.truths.analytic import Section, bent_rod
from studies.truths.spatial_rod import SpatialSection, followed_rod, helix

LENGTH = 0.5
RATIOS = (0.05, 0.005, 0.0005)
PIECES = (12, 25, 50, 100)


def rod(ratio: float) -> RobotParams:
    """A weightless rod of solid section, its radius this share of its length."""
    return replace(
        CANTILEVER_STIFF,
        length=LENGTH,
        outer_radius=ratio * LENGTH,
        inner_radius=0.0,
        youngs_modulus=7e7,
        poisson_ratio=0.4,
        gravity=(0.0, 0.0, 0.0),
    )


def stiffness(robot: RobotParams) -> SpatialSection:
    shear = 0.75 * robot.youngs_modulus / 2 / (1 + robot.poisson_ratio) * robot.area
    axial = robot.youngs_modulus * robot.area
    return SpatialSection(robot.bending_stiffness, robot.torsional_stiffness, shear, axial)


def wrench(rng, name, station, robot, follows):
    """Random direction; up to 5 EI / L^2 and 4 EI / L, which bends by more than a half turn."""
    unit = robot.bending_stiffness / LENGTH
    force, moment = rng.normal(size=(2, 3))
    force *= rng.uniform(0, 5) * unit / LENGTH / np.linalg.norm(force)
    moment *= rng.uniform(0, 4) * unit / np.linalg.norm(moment)
    return Load(name, station, tuple(force), tuple(moment), follows=follows)


def random_case(rng):
    """A rod of any slenderness under a wrench at the tip and one in between."""
    robot = rod(10 ** rng.uniform(np.log10(5e-4), np.log10(0.05)))
    mid = rng.uniform(0.3, 0.9) * LENGTH
    places = (("tip", LENGTH), ("mid", mid))
    return robot, [wrench(rng, name, s, robot, rng.random() < 0.3) for name, s in places]


def tip(robot, pieces, loads):
    model = CosseratRod(robot, pieces, loads=loads)
    return model.tip(model.equilibrium(np.ones(len(loads)), check_stability=False))


def unsolved(count, pieces, seed):
    """Random cases without an equilibrium, with what was said; it must then be true."""
    rng, found = np.random.default_rng(seed), []
    for index in range(count):
        robot, loads = random_case(rng)
        try:
            assert np.all(np.isfinite(tip(robot, pieces, loads)))
        except Exception as error:
            found.append((index, str(error)))
    return found


@pytest.mark.parametrize("pieces", PIECES)
def test_random_wrenches_are_solved_at_any_slenderness(pieces):
    assert not unsolved(12, pieces, seed=101)


@pytest.mark.slow
@pytest.mark.parametrize("pieces", PIECES)
def test_two_hundred_random_wrenches_are_solved(pieces):
    assert not unsolved(200, pieces, seed=0)


@pytest.mark.parametrize("ratio", RATIOS)
def test_wrenches_in_space_give_the_exact_tip(ratio):
    rng, robot = np.random.default_rng(3), rod(ratio)
    for _ in range(4):
        loads = [wrench(rng, "tip", LENGTH, robot, True)]
        truth = followed_rod(LENGTH, stiffness(robot), loads, [LENGTH]).tip
        coarse, fine = (np.linalg.norm(tip(robot, n, loads) - truth) for n in (25, 50))
        assert fine < 1e-3 * LENGTH
        assert coarse / fine == pytest.approx(4, rel=0.15)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("follows", [False, True])
def test_a_moment_and_torsion_make_the_exact_helix(ratio, follows):
    robot = rod(ratio)
    moment = np.array([2.0, 4.0, -3.0]) * robot.bending_stiffness / LENGTH
    truth = helix(LENGTH, stiffness(robot), moment, [LENGTH], follows).tip
    load = Load("m", LENGTH, moment=tuple(moment), follows=follows)
    assert np.linalg.norm(tip(robot, 50, [load]) - truth) < 1e-3 * LENGTH


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("follows", [False, True])
def test_a_moment_closes_the_circle(ratio, follows):
    """The closed polygon of the segments returns to the clamp as the circle does."""
    robot = rod(ratio)
    moment = 2 * np.pi * robot.bending_stiffness / LENGTH
    load = Load("m", LENGTH, moment=(0.0, moment, 0.0), follows=follows)
    model = CosseratRod(robot, 50, loads=[load])
    q = model.equilibrium([1.0])
    assert np.linalg.norm(model.tip(q)) < 1e-6 * LENGTH
    top = model.positions(q, [LENGTH / 2])[0]
    assert np.linalg.norm(top - [LENGTH / np.pi, 0, 0]) < 1e-3 * LENGTH


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_force_bends_to_the_elastica(ratio):
    robot = rod(ratio)
    unit, exact = robot.bending_stiffness / LENGTH**2, stiffness(robot)
    dead = (5.0 * unit, 0.0, -3.0 * unit)
    section = Section(exact.bending, exact.shear, exact.axial)
    truth = bent_rod(LENGTH, section, force=(dead[0], dead[2])).tip
    found = tip(robot, 50, [Load("f", LENGTH, force=dead)])
    assert np.linalg.norm(found[[0, 2]] - truth) < 1e-3 * LENGTH
    follower = Load("f", LENGTH, force=(5.0 * unit, 0.0, 0.0), follows=True)
    truth = followed_rod(LENGTH, exact, [follower], [LENGTH]).tip
    assert np.linalg.norm(tip(robot, 50, [follower]) - truth) < 1e-3 * LENGTH


def test_steps_of_newtons_method_change_strains_as_they_say():
    """`moved` is the sum to first order, and the strains it leaves are linear in the step."""
    model = CosseratRod(rod(0.01), 5)
    rng = np.random.default_rng(2)
    q = model.moved(model.rest(), 0.3 * rng.normal(size=model.n))
    change = rng.normal(size=model.n)
    blocks = change.reshape(5, 7)[:, 3:]
    blocks -= (blocks * q.reshape(5, 7)[:, 3:]).sum(axis=1)[:, None] * q.reshape(5, 7)[:, 3:]
    small = 1e-5
    np.testing.assert_allclose(model.moved(q, small * change), q + small * change, atol=1e-8)

    def stretch(x):
        places = np.vstack([np.zeros(3), x.reshape(5, 7)[:, :3]])
        return np.linalg.norm(np.diff(places, axis=0), axis=1)

    assert model.constraint_drift(model.moved(q, change)) < 1e-14
    bend = np.zeros((5, 7))
    bend[:, 5] = 0.2 * np.arange(1, 6)  # quaternions turn about y, the vertices follow
    bend[:, 0] = 2 * np.cumsum(model.data.segments * bend[:, 5])
    bent = model.moved(model.rest(), bend.ravel())
    assert bent[-7] > 0.2 * LENGTH
    np.testing.assert_allclose(stretch(bent), model.data.segments, rtol=1e-14)


def test_a_rod_that_nothing_holds_has_no_equilibrium():
    load = Load("f", LENGTH, force=(1e-3, 0.0, 0.0))
    model = CosseratRod(rod(0.01), 4, loads=[load], clamped=False)
    with pytest.raises(RuntimeError, match=r"nothing holds the robot|no equilibrium"):
        model.equilibrium([1.0])
