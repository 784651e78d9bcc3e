"""Which set-points the device follows, how it moves, and what it tells, on its outputs."""

from dataclasses import replace
from itertools import pairwise

import pytest
from support.firmware_bench import (
    CONFIG,
    REST,
    SESSION,
    Bench,
    N,
    is_off,
    refusals,
    running,
    states,
)

from softrobot_env.hardware.protocol.messages import Capability, DeviceState, Reason, Warning


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"session": SESSION + 1}, Reason.SESSION),
        ({"session": 0}, Reason.SESSION),
        ({"mode": 1}, Reason.MODE),
        ({"n": 2, "target": (REST, REST)}, Reason.COUNT),
        ({"target": (REST, -3001, REST)}, Reason.RANGE),
        ({"target": (REST, REST, 2501)}, Reason.RANGE),
    ],
)
def test_a_wrong_setpoint_neither_moves_nor_feeds(changes, reason):
    bench = running()
    for _ in range(9):
        wrong = bench.setpoint(200, 200, 200, **changes)
        assert refusals(bench.run(wrong, ms=10)) == [reason]
        assert bench.out.applied == (REST,) * N
    bench.run(ms=11)
    assert is_off(bench, DeviceState.LATCHED)


def test_the_reasons_have_an_order():
    bench = Bench()
    bench.arm()
    wrong = {"session": 1, "mode": 1, "n": 2, "target": (9999, 9999)}
    right = {"session": SESSION, "mode": 0, "n": N, "target": (9999, 9999, 9999)}
    for fixed, reason in zip(
        ((), ("session",), ("session", "mode"), ("session", "mode", "n", "target")),
        (Reason.SESSION, Reason.MODE, Reason.COUNT, Reason.RANGE),
        strict=True,
    ):
        bad = wrong | {name: right[name] for name in fixed}
        assert refusals(bench.run(bench.setpoint(**bad))) == [reason]


def test_duplicates_and_older_ones_neither_move_nor_feed():
    bench = running()
    bench.run(bench.setpoint(REST, REST, REST), seq=1000)
    for i in range(9):
        old = bench.setpoint(200, 200, 200)
        seq = (1000 - 4 * i) % 2**16
        replies = bench.run(old, seq=seq, ms=10)
        assert refusals(replies) == [Reason.SEQUENCE]
        for state in states(replies)[i > 0 :]:
            assert state.warnings == Warning.OLD_SEQUENCE
            assert state.last_seq == 1000
    assert bench.out.applied == (REST,) * N
    bench.run(ms=10)
    assert is_off(bench, DeviceState.LATCHED)


def test_sequence_numbers_wrap():
    bench = Bench()
    bench.arm()
    bench.run(bench.setpoint(REST, REST, REST), seq=65534)
    for seq, accepted in ((65535, True), (0, True), (65535, False), (32767, True), (65535, False)):
        target = bench.out.applied[0] + 1
        reasons = refusals(bench.run(bench.setpoint(target, REST, REST), seq=seq, ms=5))
        bench.run()
        assert (reasons == []) is accepted
        assert (bench.out.applied[0] == target) is accepted


def test_a_late_setpoint_neither_moves_nor_feeds():
    bench = running()
    late = bench.setpoint(200, 200, 200)
    bench.hold(60, REST, REST, REST)
    fed = bench.now - 9000
    replies = bench.run(late)
    assert refusals(replies) == [Reason.LATE]
    warned = states(replies + bench.wait(60))[0]
    assert warned.warnings & Warning.LATE_SETPOINT
    assert bench.out.applied == (REST,) * N
    bench.run(ms=(fed - bench.now) / 1000 + 100)
    assert is_off(bench, DeviceState.LATCHED)


@pytest.mark.parametrize(("age", "reasons"), [(50.0, []), (50.9, [Reason.LATE])])
def test_age_counts_to_the_time_to_live(age, reasons):
    bench = running(replace(CONFIG, watchdog_ms=1000))
    bench.hold(100, REST, REST, REST, every=50)
    old = bench.setpoint(REST, REST, REST)
    assert refusals(bench.run(old, ms=1 + age)) == reasons  # all others took 1 ms


@pytest.mark.parametrize("drift", [-0.005, 0.005])
def test_drift_of_the_clocks_is_no_age(drift):
    bench = running()
    for _ in range(3000):
        bench.host_clock += round(10_000 * drift)
        assert refusals(bench.run(bench.setpoint(REST, REST, REST, ttl_ms=10), ms=10)) == []
    assert bench.out.powered


def test_a_setpoint_that_was_held_up_ten_seconds_is_late_in_spite_of_drift():
    bench = running()
    held = bench.setpoint(200, 200, 200)
    bench.hold(10_000, REST, REST, REST)
    assert refusals(bench.run(held)) == [Reason.LATE]


@pytest.mark.parametrize("ahead", [0, 1_234_567_890, 2**31, 2**32 - 5000])
def test_both_clocks_wrap(ahead):
    bench = Bench(now=2**32 - 50_000)
    bench.host_clock = ahead
    bench.start()
    replies = bench.hold(200, 250, REST, REST)
    assert refusals(replies) == []
    assert bench.out.applied == (250, REST, REST)
    gaps = [(b.t_dev - a.t_dev) % 2**32 for a, b in pairwise(states(replies))]
    assert max(gaps) <= 11_000
    bench.wait(101)
    assert bench.out.state == DeviceState.RAMPING


def test_a_state_follows_each_setpoint_after_the_delay():
    bench = running()
    bench.wait(5)
    setpoint = bench.setpoint(60, REST, REST)
    assert states(bench.run(setpoint)) == states(bench.run()) == []
    (state,) = states(bench.run())
    assert (state.last_seq, state.t_host_echo) == (bench.seq, setpoint.t_host)
    assert state.session == SESSION
    assert state.state == DeviceState.RUNNING


@pytest.mark.parametrize(("configured", "period"), [(False, 50), (True, 30)])
def test_states_run_free(configured, period):
    bench = Bench()
    if configured:
        bench.configure(replace(CONFIG, free_run_ms=30))
    times = [state.t_dev for state in states(bench.wait(400))]
    assert {b - a for a, b in pairwise(times)} == {1000 * period}


def test_a_state_tells_what_is_measured():
    bench = running()
    bench.length, bench.force = (60, -70, 80), (101, 202, 303)
    bench.adc, bench.vbus = (11, 22, 33, 4095), 65535
    (state,) = states(bench.run(ms=50))
    assert (state.length, state.force) == (bench.length, bench.force)
    assert (state.adc, state.vbus) == (bench.adc, bench.vbus)
    assert state.applied == (REST,) * N
    assert state.t_dev == bench.now


def test_what_the_board_cannot_measure_is_told_as_nothing():
    bench = Bench(capabilities=Capability(0))
    bench.configure()
    bench.length, bench.force = (60, -70, 80), (101, 202, 303)
    (state,) = states(bench.run(ms=50))
    assert (state.length, state.force) == ((REST,) * N, (0,) * N)
    assert (state.adc, state.vbus) == ((0,) * 4, 0)


def test_outputs_slew_to_the_setpoint_and_stop_there():
    bench = running()
    applied = [bench.out.applied]
    bench.run(bench.setpoint(100, -10, REST))
    for _ in range(8):
        bench.run()
        applied.append(bench.out.applied)
    expected = [(min(REST + 10 * i, 100), max(REST - 10 * i, -10), REST) for i in range(9)]
    assert applied == expected


def test_slow_slews_do_not_stand_still_between_short_passes():
    bench = running(replace(CONFIG, slew=(10, 10000, 10000)))
    bench.hold(2000, 1000, REST, REST)
    assert bench.out.applied[0] == pytest.approx(REST + 20, abs=1)


def test_a_main_loop_that_was_stuck_does_not_jump():
    bench = running(replace(CONFIG, watchdog_ms=1000))
    bench.run(bench.setpoint(3000, REST, REST))
    bench.run(ms=900)
    assert REST < bench.out.applied[0] <= REST + 10 * 50
