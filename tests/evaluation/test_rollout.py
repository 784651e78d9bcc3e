"""The record of an episode survives the disk."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from support.rollouts import made_rollout

from softrobot_env.evaluation import run
from softrobot_env.evaluation.rollout import Rollout


@pytest.fixture
def rollout():
    rng = np.random.default_rng(5)
    reference, tip, action = rng.normal(size=(3, 7, 3))
    tables = {n: rng.normal(size=(7, 6)) for n in ("tendon_tension", "tendon_length", "curvature")}
    status = np.array(["", "tension limit reached"] * 3)
    tables |= {"reward": rng.normal(size=7), "policy_time": rng.uniform(size=6), "action": action}
    return made_rollout(0.01 * np.arange(7), reference, tip, policy_status=status, **tables)


@pytest.mark.parametrize("failure", [None, "", "simulation diverged: Größe of DOF 3 at t = 1 s"])
@pytest.mark.parametrize(
    ("as_type", "name"), [(str, "run.npz"), (Path, "run.npz"), (Path, "swing_lqi.run")]
)
def test_round_trip_under_the_name_given(rollout, tmp_path, failure, as_type, name):
    record = replace(rollout, failure=failure, source="real")
    path = as_type(tmp_path / name)
    record.save(path)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    loaded = Rollout.load(path)
    for field in fields(Rollout):
        old, new = getattr(record, field.name), getattr(loaded, field.name)
        assert type(new) is type(old), field.name
        np.testing.assert_array_equal(new, old, err_msg=field.name)
        if isinstance(old, ndarray):
            assert new.dtype == old.dtype


def test_a_record_of_the_start_alone(rollout, tmp_path):
    """An episode can fail in its first step."""
    none = {"policy_time": np.zeros(0), "policy_status": np.zeros(0, "<U1")}
    replace(rollout.part(slice(1)), **none).save(tmp_path / "start.npz")
    loaded = Rollout.load(tmp_path / "start.npz")
    assert loaded.time.shape == (1,)
    assert loaded.policy_time.shape == (0,)


def test_error_is_the_euclidean_distance(rollout):
    offsets = np.array([[3.0, 0.0, 4.0], [0.0, -2.0, 0.0], [1.0, 2.0, -2.0]])
    record = replace(rollout, reference=rollout.reference[:3], tip=rollout.reference[:3] + offsets)
    # Hand-computed: 3-4-5, a single axis, 1-2-2-3.
    np.testing.assert_allclose(record.error, [5.0, 2.0, 3.0], rtol=1e-14)


@pytest.mark.parametrize("count", [1, 4, 8, 11])
def test_columns_of_many_blocks_are_joined_in_order(monkeypatch, count):
    monkeypatch.setattr(run, "_BLOCK", 4)
    columns, rows = run.Columns(), np.arange(float(count))
    for k in rows:
        columns.add({"time": k, "tip": np.full(3, -k), "powered": k > 5})
    joined = columns.columns()
    assert np.array_equal(joined["time"], rows)
    assert np.array_equal(joined["tip"], np.repeat(-rows[:, None], 3, axis=1))
    assert np.array_equal(joined["powered"], rows > 5)
    assert run.Columns().columns() == {} and joined["tip"].base is None
