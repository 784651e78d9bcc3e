"""The record of an episode survives the disk."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy import ndarray

from softrobot_env.evaluation.rollout import Rollout


@pytest.fixture
def rollout():
    rng = np.random.default_rng(5)
    t = 7
    return Rollout(
        time=0.01 * np.arange(t),
        reference=rng.normal(size=(t, 3)),
        tip=rng.normal(size=(t, 3)),
        action=rng.uniform(-1, 1, (t, 3)),
        tendon_tension=rng.uniform(0, 80, (t, 6)),
        tendon_length=rng.uniform(0, 1, (t, 6)),
        curvature=rng.normal(size=(t, 6)),
        reward=rng.normal(size=t),
        policy_time=rng.uniform(0, 1e-3, t - 1),
        policy_status=np.array(["", "tension limit reached"] * ((t - 1) // 2)),
        wall_time=0.25,
    )


@pytest.mark.parametrize("failure", [None, "", "simulation diverged: Größe of DOF 3 at t = 1 s"])
@pytest.mark.parametrize("as_type", [str, lambda p: p], ids=["str", "Path"])
def test_round_trip(rollout, tmp_path, failure, as_type):
    record = replace(rollout, failure=failure, source="real")
    path = as_type(tmp_path / "run.npz")
    record.save(path)
    loaded = Rollout.load(path)
    for field in fields(Rollout):
        old, new = getattr(record, field.name), getattr(loaded, field.name)
        assert type(new) is type(old), field.name
        np.testing.assert_array_equal(new, old, err_msg=field.name)
        if isinstance(old, ndarray):
            assert new.dtype == old.dtype


def test_round_trip_under_the_name_given(rollout, tmp_path):
    path = tmp_path / "swing_lqi.run"
    rollout.save(path)
    assert path.exists()
    np.testing.assert_array_equal(Rollout.load(path).tip, rollout.tip)


def test_a_record_of_the_start_alone(rollout, tmp_path):
    """An episode can fail in its first step."""
    arrays = {f.name: getattr(rollout, f.name)[:1] for f in fields(Rollout) if f.type is ndarray}
    start = replace(
        rollout, **arrays | {"policy_time": np.zeros(0), "policy_status": np.zeros(0, "<U1")}
    )
    start.save(tmp_path / "start.npz")
    loaded = Rollout.load(tmp_path / "start.npz")
    assert loaded.time.shape == (1,)
    assert loaded.policy_time.shape == (0,)


def test_error_is_the_euclidean_distance(rollout):
    offsets = np.array([[3.0, 0.0, 4.0], [0.0, -2.0, 0.0], [1.0, 2.0, -2.0]])
    record = replace(rollout, reference=rollout.reference[:3], tip=rollout.reference[:3] + offsets)
    # Hand-computed: 3-4-5, a single axis, 1-2-2-3.
    np.testing.assert_allclose(record.error, [5.0, 2.0, 3.0], rtol=1e-14)
