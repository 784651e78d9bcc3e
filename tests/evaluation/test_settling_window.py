"""Where the window of the steady-state value begins, to the sample."""

import numpy as np
import pytest

from softrobot_env.evaluation.metrics import step_metrics

START, TARGET = np.array([0.1, 0.0, 0.4]), np.array([0.16, 0.0, 0.32])
COUNT, WINDOW, PERIOD = 100, 10, 0.05  # the window is the last tenth


def metrics(outside):
    """Of a response that is 10 % off at one sample, and elsewhere where it stays."""
    response = np.ones(COUNT)
    response[0], response[outside] = 0.0, 1.1
    time = PERIOD * np.arange(COUNT)
    return step_metrics(time, START + np.outer(response, TARGET - START), TARGET)


def test_an_excursion_just_before_the_window_settles_at_the_band():
    # From 10 % to 0 within a period, so 2 % are reached after 0.8 of it.
    last = COUNT - WINDOW - 1
    assert metrics(last).settling_time == pytest.approx(PERIOD * (last + 0.8))
    assert metrics(last).steady_state_error == pytest.approx(0, abs=1e-12)


def test_an_excursion_in_the_window_s_first_sample_has_no_settling_time():
    found = metrics(COUNT - WINDOW)
    assert found.settling_time is None
    assert found.steady_state_error == pytest.approx(0.1 / WINDOW)
