"""Routes of tendons through a robot."""

from math import pi

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.routed_robots import VIA, tendon

from softrobot_env.robots.loads import refuse_torsion

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
    s = np.concatenate(
        [
            (k + 0.5) / 2000 * size + start
            for start, size in ((0, 0.1), (0.1, 0.2))
            for k in [np.arange(2000)]
        ]
    )
    weight = np.repeat([0.1 / 2000, 0.2 / 2000], 2000)
    length = weight @ np.sqrt(1 + np.sum(SPIRAL.slope(s) ** 2, axis=1))
    assert SPIRAL.straight_length == pytest.approx(length, rel=1e-7)
    assert SPIRAL.mean_square() == pytest.approx(
        weight @ np.sum(SPIRAL.at(s) ** 2, axis=1) / 0.3, rel=1e-6
    )


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
        ({"guides": (0.15,), "turns": 1.0}, False),  # each guide half a turn on: no lever
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
