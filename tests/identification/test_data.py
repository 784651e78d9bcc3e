"""Data of the rig's quasi-static networks, and the rig with friction that gives them."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq, minimize
from scipy.spatial import cKDTree

from softrobot_env.beams.pcc import PCC
from softrobot_env.identification import networks as rig_networks
from softrobot_env.identification.visits import (
    POINTS,
    RADIUS,
    collect,
    disk_points,
    nominal_lengths,
    split,
)
from softrobot_env.learned.training import train_validated
from softrobot_env.robots import RIG
from softrobot_env.thesis.rig.servo_constraints import OutOfReachError
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES, make_rig_piece
from softrobot_env.thesis.rig.three_tendons import ThreeTendons
from studies.truths.rig_piece import energies, output
from studies.truths.slow_rig import RigStatics

PIECE, TENDONS = make_rig_piece(RIG), ThreeTendons(RIG)


def pulling(pulled, curvature):
    """Tensions (..., 3) [N] of lengths pulled in (..., 3) [m]; a slack tendon has none."""
    taut = pulled - TENDONS.geometric(curvature)
    return np.maximum(0.0, TENDONS.pretension + TENDONS.stiffness * taut)


def least_energy(lengths):
    """Output (2,) of the rig without friction, by minimising elastic energy and weight."""

    def energy(y):
        curvature = np.array([y[1], -y[0]]) / RIG.length
        tension = pulling(lengths, curvature)
        strain = np.sum(tension**2 / (2 * TENDONS.stiffness))
        return energies(PIECE, y, np.zeros(2))[1] + strain

    found = minimize(energy, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 0})
    point = np.empty(3)
    output(PIECE, found.x, point, np.empty((3, 2)))
    return point[:2]


# ---------------------------------------------------------------- points and lengths


def test_points_fill_the_disk_evenly():
    points = disk_points()
    distance = np.hypot(*points.T)
    assert len(points) == POINTS == 926
    assert RADIUS * 0.995 < distance.max() < RADIUS
    for share in (0.1, 0.3, 0.6, 0.9):  # of the area, within one point
        assert abs(np.sum(distance < RADIUS * np.sqrt(share)) - share * POINTS) <= 1
    # No two are closer than 0.8 of a square grid's distance, no place is farther than all of it.
    spacing = RADIUS * np.sqrt(np.pi / POINTS)
    tree = cKDTree(points)
    assert tree.query(points, k=2)[0][:, 1].min() > 0.8 * spacing
    rng = np.random.default_rng(0)
    angle, radius = rng.uniform(0, 2 * np.pi, 5000), RADIUS * np.sqrt(rng.uniform(0, 1, 5000))
    anywhere = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    assert tree.query(anywhere)[0].max() < spacing


def test_lengths_hold_the_points_with_least_tensions():
    """By the general model, driven by lengths, and by the travel that the audit tells."""
    points = disk_points(40)
    lengths = nominal_lengths(RIG, points)
    model = PCC(RIG, 1, axes="spatial", inertia=SUBPIECES, drive="length")
    for point, s in zip(points, lengths, strict=True):
        np.testing.assert_allclose(least_energy(s), point, atol=2e-9)
        y = RIG.length * bend_to(point)
        missing = model.residual(y / RIG.length, np.zeros(2), np.zeros(2), s)
        assert np.abs(missing).max() < 1e-12
        tension = pulling(s, y / RIG.length)
        assert tension.min() == pytest.approx(0.5)  # the pretension, in one tendon at least
    turn = 2 * np.pi * np.arange(120) / 120
    ring = nominal_lengths(RIG, 0.12 * np.column_stack([np.cos(turn), np.sin(turn)]))
    assert ring.max() == pytest.approx(20.3e-3, abs=0.05e-3)
    assert ring.min() == pytest.approx(-6.9e-3, abs=0.05e-3)


def bend_to(point):
    """Curvatures (beta, gamma) of the circular arc with a straight head that ends at a point."""
    distance = np.hypot(*point)

    def beyond(angle):
        return RIG.length * (1 - np.cos(angle)) / angle + 0.022 * np.sin(angle) - distance

    return brentq(beyond, 1e-9, 1.7, xtol=1e-15) / RIG.length * point / distance


def test_points_out_of_reach_and_bad_disks_are_refused():
    with pytest.raises(OutOfReachError, match="reaches less than"):
        nominal_lengths(RIG, np.array([[0.0, 0.3]]))
    for count, radius in ((0, 0.1), (5, 0.0), (5, np.nan)):
        with pytest.raises(ValueError, match="positive radius"):
            disk_points(count, radius)


# ---------------------------------------------------------------- collection


def test_every_point_is_visited_once_in_random_order():
    seen = []

    def measure(lengths):
        seen.append(lengths)
        return np.zeros((len(lengths), 2))

    points = disk_points(50)
    data = collect(RIG, measure, np.random.default_rng(0), points)
    assert data.lengths is seen[0]
    wanted = nominal_lengths(RIG, points)
    np.testing.assert_allclose(np.sort(data.lengths, axis=0), np.sort(wanted, axis=0), atol=1e-14)
    assert not np.allclose(data.lengths, wanted)
    again = collect(RIG, measure, np.random.default_rng(0), points)
    np.testing.assert_array_equal(again.lengths, data.lengths)
    forward, inverse = (rig_networks.direction_of(data, name) for name in ("forward", "inverse"))
    assert forward.inputs is inverse.outputs is data.lengths
    assert forward.outputs is inverse.inputs is data.measured


@pytest.mark.parametrize("bad", [np.zeros((5, 3)), np.full((5, 2), np.nan), np.zeros(5)])
def test_measurements_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match=r"finite outputs of shape \(5, 2\)"):
        collect(RIG, lambda lengths: bad, np.random.default_rng(0), disk_points(5))


def test_splits_hold_every_sample_once():
    parts = split(926, np.random.default_rng(0))
    sizes = [len(part) for part in (parts.training, parts.validation, parts.test)]
    assert sizes == [648, 139, 139]  # the thesis tests with 139
    everything = np.concatenate([parts.training, parts.validation, parts.test])
    np.testing.assert_array_equal(np.sort(everything), np.arange(926))
    again = split(926, np.random.default_rng(0))
    np.testing.assert_array_equal(parts.training, again.training)
    with pytest.raises(ValueError, match="at least 4"):
        split(3, np.random.default_rng(0))


# ---------------------------------------------------------------- statics with friction


def test_another_rig_is_where_its_energy_is_least():
    soft = replace(RIG, youngs_modulus=0.9 * RIG.youngs_modulus)
    lengths = nominal_lengths(soft, disk_points(5))
    # Slack tendons as well.
    lengths = np.vstack([nominal_lengths(RIG, disk_points(10)), lengths - 2e-3])
    reached = RigStatics(friction=0, noise=0)(lengths)
    np.testing.assert_allclose(reached, [least_energy(s) for s in lengths], atol=1e-8)


def test_friction_opposes_the_motion():
    """The dragged tendon lags by its friction, the others stay as tight as they were."""
    rig = RigStatics(friction=0.3, noise=0)
    ends = nominal_lengths(RIG, np.array([[0.0, 0.0], [0.06, 0.0], [0.1, 0.0]]))
    up = rig(ends)[1]
    down = rig(ends[[1]])[0]
    assert down[0] > up[0] + 1e-3 and abs(down[1] - up[1]) < 1e-12
    model = PCC(RIG, 1, axes="spatial", inertia=SUBPIECES)
    for point, lag in ((up, 0.3), (down, -0.3)):
        curvature = bend_to(point)
        tension = np.array([pulling(ends[1], curvature)[0] - lag, 0.5, 0.5])
        assert np.abs(pulling(ends[1], curvature) - tension)[1:].max() < 0.3
        missing = model.residual(curvature, np.zeros(2), np.zeros(2), tension)
        assert np.abs(missing).max() < 1e-9


def test_the_past_matters_and_the_speed_does_not():
    lengths = nominal_lengths(RIG, disk_points(30))
    rig = RigStatics(noise=0)
    together = rig(lengths)
    one_by_one = RigStatics(noise=0)
    np.testing.assert_array_equal(together, [one_by_one(s[None])[0] for s in lengths])
    fine = np.concatenate([np.linspace(a, b, 8)[1:] for a, b in pairwise(lengths)])
    finely = RigStatics(noise=0)(np.vstack([lengths[:1], fine]))[::7]
    np.testing.assert_allclose(finely, together, atol=1e-5)
    assert np.abs(rig(lengths[::-1])[::-1] - together).max() > 1e-3


# ---------------------------------------------------------------- networks


@cache
def ideal(total=None):
    """Data without friction and noise, split to train (150), stop and test with."""
    data = collect(RIG, RigStatics(friction=0, noise=0), np.random.default_rng(0), total=total)
    parts = split(len(data.lengths), np.random.default_rng(0))
    return data, parts.training[:150], parts.validation[:32], parts.test


def trained(direction, total=None, seed=0):
    """A network and its test data."""
    data, *parts = ideal(total)
    every = rig_networks.direction_of(data, direction)
    training, validation, test = (every.take(part) for part in parts)
    start = training.new_network(rig_networks.HIDDEN, np.random.default_rng(seed))
    return train_validated(start, training, validation, iterations=200).network, test


@pytest.mark.parametrize(
    ("direction", "scale"), [("forward", RADIUS), ("inverse", 0.02)], ids=["s to z", "z to s"]
)
def test_networks_learn_the_statics(direction, scale):
    network, test = trained(direction)
    assert network.sizes == (test.inputs.shape[1], 10, 10, test.outputs.shape[1])
    off = network(test.inputs) - test.outputs
    expected = np.sqrt(sum(np.mean(column**2) for column in off.T))
    assert rig_networks.rms(network, test) == pytest.approx(expected)
    assert expected < 0.02 * scale
    again, other = (trained(direction, seed=seed)[0].parameters for seed in (0, 1))
    np.testing.assert_array_equal(network.parameters, again)
    assert np.abs(network.parameters - other).max() > 0.1


def test_a_constant_sum_of_tensions_has_no_kinks_to_round_off():
    data = ideal(26.0)[0]
    for s, point in zip(data.lengths[:20], data.measured[:20], strict=True):
        tension = pulling(s, bend_to(point))
        assert tension.sum() == pytest.approx(26.0) and tension.min() >= 0.5
    # The lengths' spread is the 30 mm that the thesis tells for its data, sec. 5.1.1.
    assert np.ptp(data.lengths) == pytest.approx(0.030, rel=0.03)
    least, constant = (rig_networks.rms(*trained("inverse", total)) for total in (None, 26.0))
    assert constant < 0.2 * least
    with pytest.raises(ValueError, match="give at least"):
        nominal_lengths(RIG, disk_points(), total=20.0)
