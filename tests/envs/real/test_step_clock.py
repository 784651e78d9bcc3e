"""Deadlines of control periods: lateness does not build up, nothing is made up for in a burst."""

import pytest

from softrobot_env.envs.real import StepClock


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
