"""Motion to learn reduced models from, and what recordings do not tell."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.learned.reduction import FitError, Record
from softrobot_env.recordings.recording import episode_recording
from softrobot_env.robots import RIG, ROBOTS, find_robot
from softrobot_env.training.motions import Plan, _taut, collect, drives_of
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import TrainingRequest
from softrobot_env.training.ssm import records_of, split_decays

FINGER = find_robot("planar_finger")


def test_the_rig_is_moved_by_two_inputs_that_keep_the_sum_of_its_lengths():
    drives = drives_of(RIG, 2)
    assert drives.basis.shape == (3, 2)
    np.testing.assert_allclose(drives.basis.T @ drives.basis, np.eye(2), atol=1e-12)
    assert np.abs(drives.basis.sum(axis=0)).max() < 0.05
    assert drives.period == pytest.approx(0.01)


@pytest.mark.parametrize("kind", ["random", "laps"])
def test_motion_is_what_was_planned(kind):
    """Decays are at rest at last and under inputs that do not change; servos can follow."""
    plan = Plan(decays=1, excited=1, minutes=0.2, run=12.0, kinds=(kind,), amplitude=0.5)
    decays, forced = collect(RIG, plan, 0)
    assert len(decays) == 2 and len(forced) == 1
    for record in decays:
        assert np.ptp(record.inputs, axis=0).max() < 1e-6
        assert record.samples * record.period > plan.decay
        speed = np.abs(np.diff(record.outputs, axis=0))
        assert speed[-50:].mean() < 0.5 * speed[:50].mean()
    rate = np.abs(np.diff(forced[0].inputs, axis=0)).max() / forced[0].period
    assert rate < drives_of(RIG, 2).rate.max()
    np.testing.assert_array_equal(collect(RIG, plan, 0)[1][0].outputs, forced[0].outputs)


def recording(times, actions, tips, runs=None):
    runs = np.zeros(len(times), dtype=int) if runs is None else runs
    return episode_recording(FINGER, slice(0, 3, 2), times, actions, tips, runs=runs, source="test")


def test_a_recording_gives_records():
    times = np.tile(0.01 * np.arange(50), 2)
    actions, tips = np.random.default_rng(0).uniform(-1, 1, (2, 100, 2))
    actions[:50] = 0.3
    found = records_of(recording(times, actions, 0.1 * tips, np.repeat([0, 1], 50)), FINGER, "xz")
    decays, forced = split_decays(found)
    assert len(decays) == len(forced) == 1
    np.testing.assert_allclose(forced[0].outputs, 0.1 * tips[50:], atol=1e-9)
    np.testing.assert_allclose(forced[0].inputs, actions[50:], atol=1e-9)


def test_recordings_that_tell_no_motion_are_refused():
    times, actions = 0.01 * np.arange(50), np.zeros((50, 2))
    late = times + np.where(np.arange(50) > 20, 0.5, 0.0)
    with pytest.raises(FitError, match=r"gap of 0.51 s after 0.2 s"):
        records_of(recording(late, actions, np.zeros((50, 2))), FINGER, "xz")
    whole = recording(times, actions, np.zeros((50, 2)))
    lost = replace(whole, header=replace(whole.header, static=True))
    with pytest.raises(FitError, match="rows at rest only"):
        records_of(lost, FINGER, "xz")


@pytest.mark.slow
def test_a_model_of_a_finger(tmp_path):
    path = tmp_path / "ssm.npz"
    figures = dict(
        TRAININGS["ssm"].run(TrainingRequest(FINGER, path, 0, {"quick": True}), lambda *_: None)
    )
    assert figures["mean error over 2 s, motion left out"].value < 10e-3
    assert isinstance(Record(np.zeros((3, 1)), np.zeros((3, 1)), 1.0), Record) and path.exists()


def test_tendons_of_one_end_are_pulled_in_alike_whatever_their_groups_in_the_file():
    rod = ROBOTS["silicone_rod"]
    alone = replace(rod, tendons=tuple(replace(t, group=k) for k, t in enumerate(rod.tendons)))
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (20, len(rod.tendons)))
    taut = _taut(alone, actions)
    assert np.array_equal(taut, _taut(rod, actions))
    assert np.ptp(taut - taut.mean(axis=1, keepdims=True), axis=0).min() > 0.5
    one = replace(rod, tendons=rod.tendons[:1])
    assert np.array_equal(_taut(one, actions[:, :1]), actions[:, :1])
