"""Waiting for the tip's rest, on a clock of the test's own."""

import numpy as np
import pytest
from gymnasium import spaces

from softrobot_env.envs import real as session
from softrobot_env.envs.real import (
    STILL,
    STILL_TIME,
    NotStillError,
    StaleError,
    StepClock,
    TipFilter,
    reference_at,
    wait_for_rest,
)
from softrobot_env.hardware.tip import TipMeasurement


class Time:
    """A clock that only moves when told to, or when somebody sleeps."""

    def __init__(self):
        self.now = 100.0
        self.slept = []

    def __call__(self):
        return self.now

    def sleep(self, duration):
        self.slept.append(duration)
        self.now += duration


@pytest.fixture
def time(monkeypatch):
    time = Time()
    monkeypatch.setattr(session, "monotonic", time)
    monkeypatch.setattr(session, "sleep", time.sleep)
    return time


def rest(time, position):
    """How long [s] the wait takes for a tip at x = position(time since the start)."""
    start = time.now
    wait_for_rest(
        lambda: TipMeasurement(time.now, np.array([position(time.now - start), 0.0])), "test"
    )
    return time.now - start


@pytest.mark.parametrize(
    ("moved", "way", "waited"),
    [
        (0.3, 0.0, STILL_TIME),
        (0.3, 0.9 * STILL, STILL_TIME),
        (0.3, 1.1 * STILL, 0.3 + STILL_TIME),
        (0.39, 1.1 * STILL, 0.39 + STILL_TIME),
    ],
)
def test_only_a_motion_beyond_the_bound_starts_the_wait_anew(time, moved, way, waited):
    found = rest(time, lambda t: 0.1 + way * (t >= moved))
    assert found == pytest.approx(waited, abs=0.0051 if waited == STILL_TIME else 0.011)


def test_creeping_is_no_rest(time):
    """Steps below the bound add up: what counts is the way since the rest seemed to begin."""
    with pytest.raises(NotStillError):
        rest(time, lambda t: 2 * STILL / STILL_TIME * t)


@pytest.fixture
def clock(time):
    clock = StepClock(0.02)
    clock.start()
    return clock


def step(clock, time, work=0.0):
    """A step of a policy that takes `work` seconds before it; lateness and missed periods."""
    time.now += work
    found = clock.begin()
    clock.finish()
    return found


def test_a_prompt_policy_keeps_the_period(clock, time):
    for _ in range(500):
        late, missed = step(clock, time, work=0.003)
        assert (late, missed) == (pytest.approx(0.003, abs=1e-9), 0)
    # The first step waits for the rest of its period only.
    assert time.now == pytest.approx(100.0 + 500 * 0.02)


def test_late_by_less_than_half_a_period_keeps_the_phase(clock, time):
    step(clock, time)
    assert step(clock, time, work=0.009) == (pytest.approx(0.009), 0)
    assert time.now == pytest.approx(100.0 + 2 * 0.02)


@pytest.mark.parametrize(
    ("work", "missed"), [(0.0101, 1), (0.0299, 1), (0.0301, 2), (0.2, 10), (1.0, 50)]
)
def test_later_skips_whole_periods(clock, time, work, missed):
    assert step(clock, time, work)[1] == missed
    assert step(clock, time) == (pytest.approx(0.0), 0)
    assert time.now == pytest.approx(100.0 + (missed + 2) * 0.02)
    assert max(time.slept) <= 0.03


def test_velocity_is_by_difference_of_different_pictures():
    tip = TipFilter(TipMeasurement(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64))
    assert tip.velocity.tolist() == [0.0, 0.0]
    tip.add(TipMeasurement(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])
    tip.add(TipMeasurement(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])


def test_a_tip_that_is_faster_than_the_limit_is_refused():
    tip = TipFilter(
        TipMeasurement(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64), speed=5.0
    )
    tip.add(TipMeasurement(1.01, np.array([0.049, 0.0])))
    with pytest.raises(StaleError, match=r"moves at 5\.1 m/s, allowed are 5 m/s"):
        tip.add(TipMeasurement(1.02, np.array([0.1, 0.0])))
    assert tip.velocity == pytest.approx([4.9, 0.0])


def test_reference_between_control_instants():
    points = np.array([[0.0, 0.0], [1.0, 10.0], [2.0, 40.0]])
    assert reference_at(points, 1.5) == pytest.approx([1.5, 25.0])
    assert reference_at(points, -1.0) == pytest.approx([0.0, 0.0])
