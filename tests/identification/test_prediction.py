"""Intervals for recordings that were not identified, against recordings made up by known laws."""

from dataclasses import replace

import numpy as np
import pytest
from support.recorded_rods import recorded, rod

from softrobot_env.identification.fit.prediction import predicted, read_prediction
from softrobot_env.identification.fit.validation import BLOCKS, blocks_of, fitted_without

ROD = rod(0.004, 0.008, 1e7, 1200.0)
HERE = np.zeros((2, 1))
LONG, BETWEEN, NOISE, GROWTH, START = 30, 1e-3, 0.5e-3, 2e-3, 6e-3


def commands(rng, rows, wide=1.0):
    """A random walk of three commands."""
    return wide * np.cumsum(0.2 * rng.standard_normal((rows, 3)), axis=0)


def away_from(controls, others):
    """(t,) distance from the nearest of others."""
    return np.array([np.linalg.norm(others - one, axis=1).min() for one in controls])


def errors(rng, away, drift, blocks=0):
    """(t, 1, 3): an offset of each block, and noise that grows away from the others."""
    offset = drift * rng.standard_normal((BLOCKS, 3))[blocks]
    own = np.hypot(NOISE, GROWTH * away)[:, None]
    return (offset + own * rng.standard_normal((len(away), 3)))[:, None]


def identified(rng, drift):
    """Controls, what was predicted of them, and the blocks that it was predicted from."""
    blocks = np.repeat(np.arange(BLOCKS), LONG)
    known = commands(rng, len(blocks))
    parts = [away_from(known[blocks == k], known[fitted_without(blocks, k)]) for k in range(BLOCKS)]
    error = errors(rng, np.concatenate(parts), drift, blocks)
    return known, predicted(known, True, error, blocks)


@pytest.mark.parametrize("drift", [0.0, BETWEEN])
def test_an_interval_holds_recordings_that_drift_and_go_elsewhere(drift):
    """Of 100 recordings, each with another kept back whose offset is its own."""
    rng, held = np.random.default_rng(0), []
    for _ in range(100):
        known, prediction = identified(rng, drift)
        new = commands(rng, LONG, wide=1.5)
        seen = errors(rng, away_from(new, known), drift)
        radius = prediction.radius(new, np.arange(LONG) == 0)
        held.append(np.mean(np.linalg.norm(seen, axis=2) <= radius))
    # Shares of 100 recordings of one offset each have a mean that scatters by some 2 %.
    assert 0.91 < np.mean(held) < 0.985


def test_rows_at_the_begin_of_a_recording_have_wider_intervals_where_friction_hides_them():
    rng, blocks = np.random.default_rng(1), np.repeat(np.arange(BLOCKS), LONG)
    controls = np.tile(np.linspace(0, 6, LONG)[:, None] * [1.0, 0, 0], (BLOCKS, 1))
    controls += 0.01 * rng.standard_normal(controls.shape)
    since = controls[:, 0] / controls.std(axis=0).max()
    own = np.hypot(NOISE, START * np.exp(-since / 2))
    error = own[:, None, None] * rng.standard_normal((len(blocks), 1, 3))
    prediction = predicted(controls, False, error, blocks)
    radius = prediction.radius(controls[:LONG], np.arange(LONG) == 0)[:, 0]
    chi = 7.815**0.5  # 95 % of the length of three normal numbers
    assert radius == pytest.approx(chi * own[:LONG], rel=0.3)
    assert radius[-1] < 0.3 * radius[0]


def test_what_leaves_the_identified_range_is_said_and_a_file_keeps_all(tmp_path):
    known, prediction = identified(np.random.default_rng(2), 0.0)
    prediction.save(tmp_path / "prediction.npz")
    again = read_prediction(tmp_path / "prediction.npz")
    assert all(np.array_equal(value, vars(again)[name]) for name, value in vars(prediction).items())
    span = np.ptp(known, axis=0)
    beyond = recorded(np.stack([known[0], known.max(axis=0) + 2 * span]), "length")
    known_only = recorded(known[:3], "length")
    near, far = again.judged(ROD, known_only, np.full((3, 1), 1.0)), again.judged(ROD, beyond, HERE)
    assert (near.held, near.beyond, near.over) == (0, 0, {})
    assert str(near).endswith("it holds 0%")
    assert (far.held, far.beyond) == (1, 0.5)
    assert far.away == pytest.approx(again.away(beyond.commands)[1] / again.tested)
    assert far.over == pytest.approx({"t0": 2.0, "t1": 2.0, "t2": 2.0})
    assert far.largest == pytest.approx(again.radius(beyond.commands, beyond.begins).max())
    _, left, range_left = str(far).splitlines()
    assert left.startswith("50% of the rows leave the identified range, commanded up to ")
    assert range_left.endswith("t0 by 200%, t1 by 200%, t2 by 200%")
    assert again.judged(ROD, recorded(known[:2], "tension"), HERE) is None


@pytest.mark.parametrize(("name", "value"), [("scale", 0.0), ("tested", np.nan), ("parts", 1.0)])
def test_a_damaged_prediction_is_refused(name, value, tmp_path):
    _, fine = identified(np.random.default_rng(3), 0.0)
    replace(fine, **{name: np.array(value)}).save(tmp_path / "bad.npz")
    with pytest.raises(ValueError, match=r"bad\.npz"):
        read_prediction(tmp_path / "bad.npz")


def test_blocks_are_contiguous_and_hold_whole_runs_or_patterns():
    rows = np.zeros((84, 3))
    by_pattern = recorded(rows, labels=[f"p{k // 7}" for k in range(84)])
    for recording in (by_pattern, replace(recorded(rows), runs=np.arange(84) // 7)):
        blocks = blocks_of(recording)
        assert blocks.tolist() == sorted(blocks) and set(blocks) == set(range(BLOCKS))
        assert all(len(set(blocks[7 * k : 7 * k + 7])) == 1 for k in range(12))
    assert np.bincount(blocks_of(recorded(rows))).tolist() == pytest.approx([10.5] * 8, abs=2)
    assert set(blocks_of(recorded(rows[:3]))) == {0, 1, 2}


def test_a_block_is_predicted_without_those_beside_it_unless_blocks_are_few():
    many, few = np.repeat(np.arange(BLOCKS), 2), np.repeat(np.arange(3), 2)
    assert set(many[fitted_without(many, 3)]) == {0, 1, 5, 6, 7}
    assert set(many[fitted_without(many, 0)]) == set(range(2, BLOCKS))
    assert set(few[fitted_without(few, 1)]) == {0, 2}
