"""What no reduced model can be learned from is refused, with what is missing."""

from dataclasses import replace

import numpy as np
import pytest
from support.linear_systems import states

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.learned.reduction import FitError, Record, ReducedModel, Settings, fit

RNG = np.random.default_rng(0)
HOW = Settings(dimension=2, delays=3, order=1, input_order=1, shape_order=1, mixed=False, lag=0)


def motion(samples=300, inputs=None, period=0.01):
    """A damped oscillator under inputs (samples, 2)."""
    drives = RNG.normal(size=(samples, 2)) if inputs is None else inputs
    step = np.array([[0.999, 0.01], [-0.25, 0.99]])
    pushes = drives @ [[0.0, 0.1], [0.0, -0.1]]
    return Record(states(step, np.array([1.0, 0.0]), pushes)[:, :1], drives, period)


ONE = motion(inputs=RNG.normal(size=(300, 1)) * [1.0, -1.0])


def test_a_good_record_is_learned_from():
    assert fit([], [motion()], HOW).basis.shape == (2, 2)
    assert fit([], [ONE], HOW).basis.shape == (2, 1)


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


WAVE = np.exp((0.5 + 30j) * 0.01 * np.arange(300)).real[:, None]
GROWING = Record(WAVE, np.zeros((300, 1)), 0.01)
HIGH = {"order": 6, "input_order": 6, "mixed": True, "constant": False}
STILL = Record(np.zeros((300, 1)), RNG.normal(size=(300, 2)), 0.01)
OTHER = Record(*np.zeros((2, 50, 2)), 0.01)


@pytest.mark.parametrize(
    ("decays", "forced", "how", "error", "says"),
    [
        ([], [], {}, ValueError, "no record"),
        ([], [motion(8)], {}, FitError, "has 8 samples; 10 or more"),
        ([], [motion()], HIGH, FitError, "too few for the 209 terms of the motion"),
        ([], [STILL], {}, FitError, "directions, not in 2: excite them all"),
        ([], [motion(inputs=np.ones((300, 2)))], {}, FitError, "inputs .* change in 0 directions"),
        ([], [ONE], {"inputs": 2}, FitError, "change in 1 directions, not in 2"),
        ([], [motion(), OTHER], {}, ValueError, "record 1 has 2 outputs and 2 inputs"),
        ([], [motion(), motion(period=0.02)], {}, ValueError, "of 0.02 s, the first one of 0.01 s"),
        ([GROWING], [], {"constant": False}, FitError, "unstable at rest"),
    ],
)
def test_what_tells_no_motion_is_refused(decays, forced, how, error, says):
    with pytest.raises(error, match=says):
        fit(decays, forced, replace(HOW, **how))


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
