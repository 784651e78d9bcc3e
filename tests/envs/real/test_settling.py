"""Waiting for the tip's rest, on a clock of the test's own."""

import numpy as np
import pytest

from softrobot_env.envs import real as session
from softrobot_env.envs.real import STILL, STILL_TIME, NotStillError, wait_for_rest
from softrobot_env.hardware.tip import TipMeasurement


class Clock:
    """Time passes while somebody sleeps."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(session, "monotonic", lambda: self.now)
        monkeypatch.setattr(session, "sleep", self.sleep)

    def sleep(self, duration):
        self.now += duration


def rest(monkeypatch, position):
    """How long [s] the wait takes for a tip at x = position(time since the start)."""
    clock = Clock(monkeypatch)
    start = clock.now
    wait_for_rest(
        lambda: TipMeasurement(clock.now, np.array([position(clock.now - start), 0.0])), "test"
    )
    return clock.now - start


def test_a_tip_at_rest_is_watched_for_the_whole_time(monkeypatch):
    assert rest(monkeypatch, lambda t: 0.1) == pytest.approx(STILL_TIME, abs=0.0051)


@pytest.mark.parametrize("moved", [0.3, 0.39])
def test_a_late_motion_starts_the_wait_anew(monkeypatch, moved):
    waited = rest(monkeypatch, lambda t: 0.1 if t < moved else 0.1 + 1.1 * STILL)
    assert waited == pytest.approx(moved + STILL_TIME, abs=0.011)


def test_motions_below_the_bound_do_not_count(monkeypatch):
    waited = rest(monkeypatch, lambda t: 0.1 if t < 0.3 else 0.1 + 0.9 * STILL)
    assert waited == pytest.approx(STILL_TIME, abs=0.0051)


def test_creeping_is_no_rest(monkeypatch):
    """Steps below the bound add up: what counts is the way since the rest seemed to begin."""
    with pytest.raises(NotStillError):
        rest(monkeypatch, lambda t: 2 * STILL / STILL_TIME * t)
