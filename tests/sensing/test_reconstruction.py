"""From readings to tip and curvatures: arcs against exact ones, polynomials, files, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from softrobot_env.core.artifacts import Arrays, read_arrays, write_arrays
from softrobot_env.robots import ARM, RIG, ROBOTS, Sensor
from softrobot_env.sensing.array import felt_bends
from softrobot_env.sensing.reconstruction import (
    TIP,
    Arcs,
    Map,
    Reconstruction,
    fit_map,
    reconstruct,
)
from studies.truths.analytic import arc_tip


def tags(robot, count):
    """A robot with tags that divide it evenly."""
    ends = np.linspace(0.0, robot.length, count + 1).tolist()
    own = tuple(Sensor(f"t{k}", "tags", *x, segments=1) for k, x in enumerate(pairwise(ends)))
    return replace(robot, sensors=own)


def test_arcs_of_tags_are_circles():
    arm = tags(ARM, 3)
    turn = np.array([0.8, 0.8, 0.8])
    x, z = arc_tip(ARM.length, turn.sum() / ARM.length)
    np.testing.assert_allclose(Arcs.of(arm).tip(turn[None])[0], [x, 0, z], atol=1e-14)


def test_arcs_bend_one_after_the_other_in_space():
    """A quarter of a circle towards +x, then a quarter towards the section's own +y."""
    length = 0.3
    robot = replace(
        ROBOTS["hanging_trunk"],
        base=None,
        sensors=tuple(
            Sensor(f"s{k}", "spatial", 0.0 if k == 0 else 0.2, 0.2 if k == 0 else 0.35)
            for k in range(2)
        ),
    )
    quarter = np.pi / 4  # chords of halves turn by half of the whole
    tip = Arcs.of(robot).tip(np.array([[quarter, 0, 0, quarter]]))[0]
    first, second = 0.2 / (np.pi / 2), 0.15 / (np.pi / 2)
    exact = np.array([first, 0.0, first]) + np.array([second, second, 0.0])
    assert robot.length == pytest.approx(length + 0.05)
    np.testing.assert_allclose(tip, exact, atol=1e-14)


def test_a_spatial_sensor_feels_half_of_the_turn_of_its_arc():
    edges, strain = np.array([0.0, 0.12]), np.array([[[3.0, -2.0, 0.0]]])
    (bend,) = felt_bends((Sensor("s", "spatial", 0.0, 0.12),), edges, strain)
    np.testing.assert_allclose(bend[0, 0], 0.06 * np.array([3.0, -2.0]), rtol=1e-12)


def test_sensors_that_overlap_or_tell_no_side_have_no_arcs():
    both = (Sensor("a", "tags", 0.0, 0.3), Sensor("b", "tags", 0.2, 0.5))
    assert Arcs.of(replace(ARM, sensors=both)) is None
    assert Arcs.of(replace(ARM, sensors=(Sensor("a", "planar", 0.0, 0.5),))) is None


def test_a_polynomial_is_found_and_no_more_terms_than_needed():
    rng = np.random.default_rng(0)
    x = rng.uniform(-2, 3, (200, 2))
    y = np.stack([1 + x[:, 0] ** 2 - x[:, 0] * x[:, 1], 3 * x[:, 1]], axis=1)
    found = fit_map(x, y)
    assert len(found.powers) == 6
    np.testing.assert_allclose(found(x), y, atol=1e-3)
    noisy = fit_map(x, y[:, 1:] + rng.normal(0, 0.1, (200, 1)))
    assert len(noisy.powers) == 3 and noisy.error == pytest.approx(0.1, rel=0.15)


def test_too_few_postures_are_refused():
    with pytest.raises(ValueError, match=r"5 postures do not tell 2 quantities .* 9 or more"):
        fit_map(np.zeros((5, 2)), np.zeros((5, 1)))


@pytest.fixture(scope="module")
def known():
    """Of an arm with three ideal tags, from shapes of three arcs."""
    arm = tags(ARM, 3)
    turns = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 3))
    tips = Arcs.of(arm).tip(turns)[:, [0, 2]]
    seen = {TIP: tips, "curvature": 3 / ARM.length * turns}
    return arm, reconstruct(arm, turns, seen, (0, 2), [turns[:, :2]] * 3, 1.0)


def test_what_sensors_tell_is_what_was_seen(known):
    arm, found = known
    turns = np.array([0.3, -0.9, 1.2])
    felt = found.update(found.begin(np.zeros(3)), turns, 0.02)
    np.testing.assert_allclose(
        felt.reported[TIP], Arcs.of(arm).tip(turns[None])[0, [0, 2]], atol=1e-6
    )
    np.testing.assert_allclose(felt.reported["curvature"], 3 / ARM.length * turns, rtol=1e-5)


def test_a_reading_that_is_not_finite_or_not_new_changes_nothing(known):
    _, found = known
    felt = found.begin(np.zeros(3))
    assert found.update(felt, np.array([np.nan, 0, 0]), 0.02) is felt
    assert found.update(felt, np.zeros(3), 0.02) is felt


def test_nothing_is_known_before_the_first_finite_reading(known):
    _, found = known
    lost, turns = found.begin(np.array([np.nan, 0, 0])), np.array([0.3, -0.9, 1.2])
    seen = found.update(lost, turns, 0.02).reported
    assert lost.reported.keys() == seen.keys() == found.maps.keys()
    for name, values in found.update(found.begin(np.zeros(3)), turns, 0.02).reported.items():
        assert lost.reported[name].shape == values.shape and np.isnan(lost.reported[name]).all()
        np.testing.assert_array_equal(seen[name], values)


def test_files_keep_everything(known, tmp_path):
    arm, found = known
    write_arrays(tmp_path / "a.npz", found.arrays())
    again = Reconstruction.of(arm, read_arrays(tmp_path / "a.npz"))
    turns = np.array([0.1, 0.2, -0.4])
    one, other = (
        each.update(each.begin(np.zeros(3)), turns, 0.02).reported for each in (found, again)
    )
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("damage", ["nan", "lost", "other"])
def test_damaged_files_are_refused(known, damage):
    arm, found = known
    arrays = found.arrays()
    if damage == "nan":
        arrays["map_curvature_weights"] = np.nan * arrays["map_curvature_weights"]
    elif damage == "lost":
        arrays = {k: v for k, v in arrays.items() if TIP not in k}
    else:
        arm = tags(ARM, 2)
    with pytest.raises(ValueError, match=r"a\.npz"):
        Reconstruction.of(arm, Arrays("a.npz", arrays))


def test_the_shipped_one_is_of_the_rig():
    from softrobot_env.control.sensed import load_reconstruction

    found = load_reconstruction(RIG)
    assert found.maps[TIP].error < 0.5e-3 and isinstance(found.maps[TIP], Map)
    with pytest.raises(ValueError, match="robot 'arm' carries none"):
        load_reconstruction(ARM)
    with pytest.raises(ValueError, match=r"softrobot train sensors --robot"):
        load_reconstruction(tags(ARM, 3))
