"""Instants of motions that are kept."""

import pytest

from softrobot_env.core.motion import sample_times


@pytest.mark.parametrize(
    ("duration", "samples", "message"),
    [
        (0.0, None, "duration must be positive"),
        (float("inf"), None, "duration must be positive"),
        (1.0, 0.3, "must divide 1.0 s"),
        (1.0, -0.5, "must divide 1.0 s"),
        (1.0, [0.1, 1.0], "must start at 0"),
        (1.0, [0.0, 0.9], "end at the duration"),
        (1.0, [0.0, 0.6, 0.4, 1.0], "increase"),
        (1.0, [0.0, float("nan"), 1.0], "increase"),
        (1.0, [[0.0, 1.0]], "increase"),
        (1.0, [], "must start at 0"),
    ],
)
def test_samples_that_do_not_fit_are_refused(duration, samples, message):
    with pytest.raises(ValueError, match=message):
        sample_times(duration, samples)


@pytest.mark.parametrize(
    ("samples", "times"),
    [(None, [0.0, 1.0]), (0.25, [0.0, 0.25, 0.5, 0.75, 1.0]), ([0.0, 0.1, 1.0], [0.0, 0.1, 1.0])],
)
def test_samples_are_those_asked_for(samples, times):
    assert sample_times(1.0, samples).tolist() == times
