"""What no reduced model can be learned from is refused, with what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.learned.reduction import FitError, Record, ReducedModel, Settings, fit

RNG = np.random.default_rng(0)
HOW = Settings(dimension=2, delays=3, order=1, input_order=1, shape_order=1, mixed=False, lag=0)


def motion(samples=300, inputs=None):
    """A damped oscillator under inputs (samples, 2)."""
    drives = RNG.normal(size=(samples, 2)) if inputs is None else inputs
    x, rows = np.array([1.0, 0.0]), []
    for u in drives:
        rows.append(x[:1].copy())
        x = np.array([[0.999, 0.01], [-0.25, 0.99]]) @ x + np.array([0.0, 0.1 * (u[0] - u[1])])
    return Record(np.array(rows), drives, 0.01)


def test_a_good_record_is_learned_from():
    model = fit([], [motion()], HOW)
    assert model.basis.shape == (2, 2)


@pytest.mark.parametrize(
    ("outputs", "inputs", "period", "says"),
    [
        (np.full((5, 1), np.nan), np.zeros((5, 1)), 0.01, "outputs must be finite.*sample 0"),
        (np.zeros((5, 1)), np.full((5, 1), np.inf), 0.01, "inputs must be finite"),
        (np.zeros((5, 1)), np.zeros((4, 1)), 0.01, "as many samples of inputs"),
        (np.zeros(5), np.zeros((5, 1)), 0.01, r"outputs must have shape \(samples, n\)"),
        (np.zeros((5, 1)), np.zeros((5, 1)), 0.0, "period must be positive"),
    ],
)
def test_records_are_checked(outputs, inputs, period, says):
    with pytest.raises(ValueError, match=says):
        Record(outputs, inputs, period)


def test_too_little_is_refused():
    with pytest.raises(ValueError, match="no record"):
        fit([], [], HOW)
    with pytest.raises(FitError, match=r"has 8 samples; 10 or more"):
        fit([], [motion(8)], HOW)
    with pytest.raises(FitError, match="too few for the 209 terms of the motion"):
        fit([], [motion()], replace(HOW, order=6, input_order=6, mixed=True, constant=False))


def test_what_does_not_move_is_refused():
    still = Record(np.zeros((300, 1)), RNG.normal(size=(300, 2)), 0.01)
    with pytest.raises(FitError, match="directions, not in 2: excite them all"):
        fit([], [still], HOW)
    with pytest.raises(FitError, match="inputs of the forced records change in 0 directions"):
        fit([], [motion(inputs=np.ones((300, 2)))], HOW)
    one = RNG.normal(size=(300, 1)) * [1.0, -1.0]
    with pytest.raises(FitError, match="change in 1 directions, not in 2"):
        fit([], [motion(inputs=one)], replace(HOW, inputs=2))
    assert fit([], [motion(inputs=one)], HOW).basis.shape == (2, 1)


def test_records_must_be_alike():
    other = Record(np.zeros((50, 2)), np.zeros((50, 2)), 0.01)
    with pytest.raises(ValueError, match="record 1 has 2 outputs and 2 inputs"):
        fit([], [motion(), other], HOW)
    slow = replace(motion(), period=0.02)
    with pytest.raises(ValueError, match=r"period of 0.02 s, the first one of 0.01 s"):
        fit([], [motion(), slow], HOW)


def test_unstable_models_are_refused():
    growing = np.exp(0.5 * np.arange(300) * 0.01) * np.cos(0.3 * np.arange(300))
    drives = RNG.normal(size=(300, 2))
    with pytest.raises(FitError, match="unstable at rest: a mode grows"):
        fit([Record(growing[:, None], 0 * drives, 0.01)], [], replace(HOW, constant=False))


def test_a_file_brings_the_model_back(tmp_path):
    record = motion()
    model = fit([], [record], HOW)
    write_arrays(tmp_path / "a.npz", model.arrays())
    read = ReducedModel.read(read_arrays(tmp_path / "a.npz"))
    np.testing.assert_array_equal(read.predict_record(record), model.predict_record(record))
    for name, value in {
        "scale": np.ones(3),
        "period": -1.0,
        "shape": np.full((3, 2), np.nan),
    }.items():
        write_arrays(tmp_path / "b.npz", {**model.arrays(), name: value})
        with pytest.raises(ValueError, match=r"must|not finite"):
            ReducedModel.read(read_arrays(tmp_path / "b.npz"))
