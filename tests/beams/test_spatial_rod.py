"""The exact rods in space against each other and against those in the plane."""

import numpy as np
import pytest

from softrobot_env.robots.loads import Load
from studies.truths.analytic import Section, arc_tip, bent_rod
from studies.truths.spatial_rod import (
    SpatialSection,
    dead_loads,
    followed_rod,
    helix,
)

LENGTH = 0.4
SECTION = SpatialSection(0.02, 0.013)
STATIONS = np.linspace(0, LENGTH, 9)


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("moment", [(0.1, -0.2, 0.15), (0, 0.3, 0), (0, 0, 0.2), (0, 0, 0)])
def test_a_helix_is_a_rod_under_a_moment(moment, follows):
    shape = helix(LENGTH, SECTION, moment, STATIONS, follows)
    seen = moment if follows else shape.frame[-1].T @ moment
    truth = followed_rod(LENGTH, SECTION, [Load("m", LENGTH, moment=tuple(seen))], STATIONS)
    np.testing.assert_allclose(shape.position, truth.position, atol=1e-11)
    np.testing.assert_allclose(shape.frame, truth.frame, atol=1e-9)


def test_a_moment_across_bends_to_a_circle():
    moment = 2 * np.pi * SECTION.bending / LENGTH
    for share in (0.5, 1.0):
        x, z = arc_tip(LENGTH, share * moment / SECTION.bending)
        tip = helix(LENGTH, SECTION, (0, share * moment, 0), STATIONS).tip
        np.testing.assert_allclose(tip, [x, 0, z], atol=1e-15)


@pytest.mark.parametrize("section", [SECTION, SpatialSection(0.02, 0.013, 30.0, 80.0)])
def test_dead_loads_hold_the_planar_rod_of_the_boundary_value_problem(section):
    unit = section.bending / LENGTH**2
    load = Load("f", LENGTH, force=(2.5 * unit, 0.0, -1.0 * unit), moment=(0, 0.3 * unit, 0))
    shape = followed_rod(LENGTH, section, [load], STATIONS)
    (dead,) = dead_loads([load], shape)
    flat = Section(section.bending, section.shear, section.axial)
    truth = bent_rod(LENGTH, flat, force=(dead.force[0], dead.force[2]), moment=dead.moment[1])
    np.testing.assert_allclose(shape.tip[[0, 2]], truth.tip, atol=1e-8)


def test_forces_and_moments_balance_in_space():
    """About the clamp, in the world; the section there carries what the curvature says."""
    loads = [
        Load("a", LENGTH, force=(0.3, -0.2, 0.1), moment=(0.05, 0.02, -0.04)),
        Load("b", 0.15, force=(-0.1, 0.25, 0.2), moment=(-0.03, 0.06, 0.02)),
    ]
    step = 1e-5
    stations = np.array([0.0, step, 0.15, LENGTH])
    shape = followed_rod(LENGTH, SECTION, loads, stations)
    dead = dead_loads(loads, shape)
    places = [shape.position[3], shape.position[2]]
    total = sum(np.cross(x, d.force) + d.moment for x, d in zip(places, dead, strict=True))
    turn = shape.frame[1] - shape.frame[1].T
    curvature = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / 2 / step
    carried = np.array([SECTION.bending, SECTION.bending, SECTION.torsion]) * curvature
    np.testing.assert_allclose(carried, total, atol=1e-4 * np.linalg.norm(total))


@pytest.mark.parametrize("section", [SECTION, SpatialSection(0.02, 0.013, 30.0, 80.0)])
def test_a_weight_seen_from_the_tip_is_that_of_the_boundary_value_problem(section):
    unit = section.bending / LENGTH**3
    weight = np.array([4.0 * unit, 0.0, 2.0 * unit])
    shape = followed_rod(LENGTH, section, [], STATIONS, weight)
    world = shape.frame[-1] @ weight
    flat = Section(section.bending, section.shear, section.axial)
    truth = bent_rod(LENGTH, flat, weight=(world[0], world[2]))
    assert np.linalg.norm(shape.tip - [0, 0, LENGTH]) > 0.2 * LENGTH
    np.testing.assert_allclose(shape.tip[[0, 2]], truth.tip, atol=1e-8)
