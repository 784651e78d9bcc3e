"""Hinge rules as quadrature rules."""

import numpy as np
import pytest

from softrobot_env.scene.quadrature import RULES, place_hinges

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
    for rule, nodes in {"midpoint": 1, "gauss2": 2, "gauss3": 3}.items():
        layout, (x, w) = place_hinges(2.0, 1, rule), np.polynomial.legendre.leggauss(nodes)
        np.testing.assert_allclose(layout.stations, 1 + x, atol=1e-15)
        np.testing.assert_allclose(layout.weights, w, rtol=1e-14)
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


@pytest.mark.parametrize("rule", RULES)
def test_integration_error_falls_with_the_rules_order(rule):
    def error(pieces):
        layout = place_hinges(2.0, pieces, rule)
        return abs(layout.weights @ np.exp(layout.stations) - (np.exp(2) - 1))

    order = np.log2(error(4) / error(8))
    assert order == pytest.approx(DEGREE[rule] + 1, abs=0.1)


@pytest.mark.parametrize("pieces", [0, -1, 2.5, float("nan"), float("inf")])
def test_number_of_pieces_has_to_be_a_positive_whole_number(pieces):
    with pytest.raises(ValueError, match="piece"):
        place_hinges(0.5, pieces, "midpoint")


def test_unknown_rule_names_the_known_ones():
    with pytest.raises(ValueError, match="midpoint, gauss2, balanced2, chord2, gauss3, coupled2"):
        place_hinges(0.5, 2, "simpson")
