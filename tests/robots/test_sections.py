"""Robots of several sections, their properties along the arc, discs and bases."""

import pickle
from dataclasses import fields, replace
from math import pi

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from support.routed_robots import ROD, TAPERED, TWO, VIA, tendon

from softrobot_env.robots import ARM, RIG, Base, Disc, RobotParams, Section
from softrobot_env.robots.loads import refuse_torsion


@pytest.mark.parametrize("robot", [ARM, RIG, ROD], ids=lambda robot: robot.name)
def test_one_section_that_does_not_taper_is_the_uniform_robot(robot):
    names = {field.name for field in fields(Section)} - {"bending_friction"}  # it has none
    section = Section(**{name: getattr(robot, name) for name in names})
    for one in (section, replace(section, outer_radius=(robot.outer_radius,) * 2)):
        assert robot.with_sections(one) == robot
    assert robot.backbone.sections == (section,)


def test_lengths_and_pieces_of_sections_add_up():
    assert (TWO.length, TWO.pieces) == (pytest.approx(0.4), 12)
    assert TWO.youngs_modulus is None
    assert replace(TWO, gravity=(0, 0, -9.81)).sections == TWO.sections
    assert pickle.loads(pickle.dumps(TWO)) == TWO


def test_properties_are_those_of_the_section_at_a_place():
    backbone, s = TWO.backbone, np.array([0.1, 0.25, 0.26, 0.4])
    outer = np.array([0.014, 0.014, 0.010, 0.010])
    modulus, density = np.array([8e5, 8e5, 5e5, 5e5]), np.array([1100, 1100, 1000, 1000])
    assert_allclose(backbone.bending(s), modulus * pi / 4 * outer**4, rtol=1e-14)
    assert_allclose(backbone.mass(s), density * pi * outer**2, rtol=1e-14)
    assert_allclose(backbone.damping_time(s), [0.03, 0.03, 0.02, 0.02])
    assert TWO.curvature_limit == pytest.approx(1 / 0.014)


def test_mass_of_a_cone_is_that_of_a_frustum():
    volume = pi * 0.4 / 3 * (0.012**2 + 0.012 * 0.006 + 0.006**2)
    assert pytest.approx(1100 * volume, rel=1e-14) == TAPERED.mass


def test_pieces_in_series_yield_as_much_as_the_cone():
    # Under a moment of 1 N m a cone turns by 4 / (3 pi E c) (1 / r1^3 - 1 / r0^3), c the taper.
    taper = (0.012 - 0.006) / 0.4
    turn = 4 / (3 * pi * 1e6 * taper) * (0.006**-3 - 0.012**-3)
    edges = np.array([0.0, 0.11, 0.4])
    pieces = TAPERED.backbone.in_series(TAPERED.backbone.bending, edges)
    assert np.sum(np.diff(edges) / pieces) == pytest.approx(turn, rel=1e-9)


@pytest.mark.parametrize(
    ("pieces", "ends"),
    [
        (2, [0, 0.25, 0.4]),
        (3, [0, 0.125, 0.25, 0.4]),
        ((1, 3), [0, 0.25, 0.3, 0.35, 0.4]),
        ([2, 1], [0, 0.125, 0.25, 0.4]),
    ],
)
def test_a_sections_end_is_a_pieces_end(pieces, ends):
    assert_allclose(TWO.backbone.cut(pieces), ends, rtol=1e-12)


def test_multiples_of_the_own_pieces_divide_them():
    for factor in (1, 2, 5):
        own = TWO.backbone.cut(TWO.pieces)
        assert_allclose(TWO.backbone.cut(factor * TWO.pieces)[::factor], own, rtol=1e-14)


@pytest.mark.parametrize("name", ["youngs_modulus", "density", "damping_time"])
def test_vary_multiplies_every_section(name):
    varied = TWO.vary(**{name: 0.5})
    for one, other in zip(varied.sections, TWO.sections, strict=True):
        assert one == replace(other, **{name: getattr(other, name) / 2})
    assert varied.tendons == TWO.tendons


def test_vary_scales_routes():
    varied = TWO.vary(tendon_radius=0.5, tendon_friction=1.0)
    s = np.linspace(0, 0.25, 5)
    for one, other in zip(varied.tendons, TWO.tendons, strict=True):
        assert_allclose(one.at(s), other.at(s) / 2)
        assert one.friction == 1.0
    assert varied.sections == TWO.sections


UNIFORM = (
    *("area", "second_moment", "bending_stiffness", "torsional_stiffness"),
    *("mass_per_length", "first_frequency"),
)


@pytest.mark.parametrize("name", UNIFORM)
def test_what_only_uniform_robots_have_is_refused_by_name(name):
    assert getattr(ARM, name)
    for robot in (TWO, TAPERED):
        with pytest.raises(ValueError, match=f"needs a backbone of one section.*{robot.name!r}"):
            getattr(robot, name)


def test_a_robot_needs_sections_or_the_numbers_of_one():
    with pytest.raises(ValueError, match="length must be from 1e-06 to 1000 m, got None"):
        RobotParams("empty")


@pytest.mark.parametrize("pieces", [1, (3,), (1, 2, 3)])
def test_pieces_that_do_not_fit_the_sections(pieces):
    with pytest.raises(ValueError, match="2 sections"):
        TWO.backbone.cut(pieces)


# ---------------------------------------------------------------- discs and bases


def test_a_uniform_disc_has_the_inertia_of_a_cylinder():
    disc = Disc.uniform(0.1, mass=0.2, radius=0.03, thickness=0.01)
    lateral = 0.2 * (3 * 0.03**2 + 0.01**2) / 12
    assert_allclose(disc.inertia, (lateral, lateral, 0.2 * 0.03**2 / 2))


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -2, 0), (0.3, -0.5, -0.8), (1e-9, 0, -1)]
)
@pytest.mark.parametrize("roll", [0.0, 0.7])
def test_a_bases_axes_are_a_rotation_that_leads_to_its_direction(direction, roll):
    axes = Base(direction=direction, roll=roll).axes
    assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert_allclose(axes[:, 2], np.array(direction) / np.linalg.norm(direction), atol=1e-15)


def test_the_smallest_turn_leads_to_a_bases_direction():
    direction = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    axes = Base(direction=tuple(direction)).axes
    assert np.trace(axes) == pytest.approx(1 + 2 * direction[2])  # 1 + 2 cos of the angle
    rolled = Base(direction=tuple(direction), roll=0.4).axes
    assert_allclose(rolled[:, 0], np.cos(0.4) * axes[:, 0] + np.sin(0.4) * axes[:, 1])


@pytest.mark.parametrize("direction", [(0, 0, -1), (0.6, 0, -0.8), (1, 0, 0)])
def test_planar_robots_stay_in_their_plane(direction):
    assert_allclose(Base(direction=direction).axes[:, 1], [0, 1, 0], atol=0)


def test_gravity_stays_in_the_world():
    hanging = replace(ROD, gravity=(1.0, 0.0, -9.81), base=Base(direction=(0, 0, -1)))
    assert_allclose(hanging.own_gravity, (-1.0, 0.0, 9.81))


# ---------------------------------------------------------------- routes of tendons
STRAIGHT = tendon("straight", (0.01, 0.002), 0.3)
HELIX = tendon("helix", (0.01, 0.0), 0.3, turns=-1.5)
TO_ONE_SIDE = ((0.1, 0.006, 0.0), (0.3, 0.002, 0.0))
SPIRAL = tendon("spiral", (0.01, 0.0), 0.3, turns=0.8, route=TO_ONE_SIDE)
ROUTES = (STRAIGHT, HELIX, SPIRAL, VIA.tendons[0])


def test_a_helix_keeps_its_distance_and_turns_at_a_constant_rate():
    s = np.linspace(0, 0.3, 13)
    angle = -1.5 * 2 * pi * s / 0.3
    assert_allclose(HELIX.at(s), 0.01 * np.column_stack([np.cos(angle), np.sin(angle)]), atol=1e-17)
    assert HELIX.straight_length == pytest.approx(np.hypot(0.3, 1.5 * 2 * pi * 0.01), rel=1e-14)


def test_between_via_points_a_route_is_a_straight_line():
    route = VIA.tendons[0]
    corners = np.array([(0.0, *route.offset), *route.route])
    for s, *place in corners:
        assert_allclose(route.at(s), place, atol=1e-17)
    middle = (corners[:-1] + corners[1:]) / 2
    assert_allclose(route.at(middle[:, 0]), middle[:, 1:], atol=1e-17)
    spans = np.diff(corners, axis=0)
    assert route.straight_length == pytest.approx(np.linalg.norm(spans, axis=1).sum(), rel=1e-13)


@pytest.mark.parametrize("route", ROUTES, ids=lambda t: t.name)
def test_slopes_are_derivatives(route):
    s, h = np.linspace(0.011, 0.283, 9), 1e-6
    difference = (route.at(s + h) - route.at(s - h)) / (2 * h)
    assert_allclose(route.slope(s), difference, atol=1e-8)


def test_length_and_mean_square_of_a_spiral_are_integrals():
    def integral(function):
        return quad(lambda s: function(np.array([s]))[0], 0, 0.3, points=[0.1], epsrel=1e-10)[0]

    length = integral(lambda s: np.sqrt(1 + np.sum(SPIRAL.slope(s) ** 2, axis=1)))
    assert SPIRAL.straight_length == pytest.approx(length, rel=1e-7)
    square = integral(lambda s: np.sum(SPIRAL.at(s) ** 2, axis=1)) / 0.3
    assert SPIRAL.mean_square() == pytest.approx(square, rel=1e-6)


def test_guides_make_straight_spans():
    guided = tendon("guided", (0.01, 0.0), 0.3, guides=(0.1, 0.2), turns=0.75)
    # Quarter turns: chords of sqrt(2) times the radius across, 0.1 m along.
    assert guided.straight_length == pytest.approx(3 * np.hypot(0.1, np.sqrt(2) * 0.01))


@pytest.mark.parametrize(
    ("options", "twists"),
    [
        ({}, False),
        ({"route": ((0.3, 0.002, 0.0),)}, False),
        ({"route": ((0.3, 0.0, 0.002),)}, True),
        ({"route": ((0.1, -0.01, 0.0), (0.3, 0.01, 0.0))}, False),
        ({"turns": 0.1}, True),
        ({"guides": (0.15,), "turns": 1.0}, False),  # each guide half a turn on: no moment arm
        ({"guides": (0.1,), "turns": 1.0}, True),
    ],
)
def test_what_winds_round_the_fibre_is_known(options, twists):
    route = tendon("t", (0.01, 0.0), 0.3, **options)
    assert route.twists is twists
    if twists:
        with pytest.raises(ValueError, match=r"tendon 't' \(winds round the fibre\)"):
            refuse_torsion("a model", "another", (), (route,))


def test_turning_a_route_turns_all_its_places():
    s = np.linspace(0, 0.3, 7)
    turned = SPIRAL.turned(pi / 2, 2.0).at(s)
    across = np.column_stack([-SPIRAL.at(s)[:, 1], SPIRAL.at(s)[:, 0]])
    assert_allclose(turned, 2 * across, atol=1e-17)
