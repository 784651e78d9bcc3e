"""Deadlines of control periods: lateness does not build up, nothing is made up for in a burst."""

import numpy as np
import pytest
from gymnasium import spaces

from softrobot_env.envs.real.step_clock import StepClock
from softrobot_env.envs.real.tip_filter import TipFilter, reference_at
from softrobot_env.hardware.tip import Sight


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
def time():
    return Time()


@pytest.fixture
def clock(time):
    clock = StepClock(0.02, time, time.sleep)
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
    tip = TipFilter(Sight(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64))
    assert tip.velocity.tolist() == [0.0, 0.0]
    tip.add(Sight(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])
    tip.add(Sight(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])


def test_reference_between_control_instants():
    points = np.array([[0.0, 0.0], [1.0, 10.0], [2.0, 40.0]])
    assert reference_at(points, 1.5) == pytest.approx([1.5, 25.0])
    assert reference_at(points, -1.0) == pytest.approx([0.0, 0.0])
