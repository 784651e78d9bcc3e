"""What the device does by itself when something goes wrong, asserted on its outputs."""

from dataclasses import replace

import pytest
from support.firmware_bench import (
    AWAY,
    CONFIG,
    REST,
    SESSION,
    N,
    away,
    faults,
    fields_crc,
    is_off,
    of,
    refusals,
    running,
    spoil,
    states,
)

from softrobot_env.hardware.protocol import messages as m


def test_the_watchdog_freezes_ramps_to_rest_and_switches_off():
    bench = running()
    bench.run(bench.setpoint(3000, 3000, REST))
    bench.wait(99)
    assert bench.out.applied == (REST + 990, REST + 990, REST)
    replies = bench.run()
    assert faults(replies) == [(m.Fault.WATCHDOG, 0)]
    assert bench.out.applied == (REST + 988, REST + 988, REST)
    bench.wait(492)
    assert bench.out.applied == (REST + 4, REST + 4, REST)
    assert bench.out.powered
    bench.wait(3)
    assert is_off(bench, m.DeviceState.LATCHED)


@pytest.mark.parametrize("watchdog", [20, 1000])
def test_the_watchdog_waits_as_long_as_configured(watchdog):
    bench = running(replace(CONFIG, watchdog_ms=watchdog))
    bench.wait(watchdog - 1)
    assert bench.out.state == m.DeviceState.RUNNING
    bench.run()
    assert is_off(bench, m.DeviceState.LATCHED)  # it was at rest: no way to ramp


@pytest.mark.parametrize(
    ("fault", "bad", "messages"),
    [
        (m.Fault.ESTOP, {}, [m.EStop()]),
        (m.Fault.ESTOP, {"estop": True}, []),
        (m.Fault.BROWN_OUT, {"vbus": 4999}, []),
    ],
    ids=["message", "switch", "supply"],
)
def test_an_emergency_stop_and_a_low_supply_cut_at_once(fault, bad, messages):
    bench = away()
    spoil(bench, **bad)
    replies = bench.run(*messages)
    assert is_off(bench, m.DeviceState.LATCHED)
    assert faults(replies) == [(fault, 0)]
    bench.hold(100, *AWAY)
    assert is_off(bench, m.DeviceState.LATCHED)


SLOW_FAULTS = [
    (m.Fault.FORCE, 1, {"force": (100, 2001, 100)}, 2001),
    (m.Fault.SLACK, 2, {"force": (100, 100, 19)}, 19),
    (m.Fault.STALL, 0, {"length": (250 - 301, 150, 50)}, -301),
    (m.Fault.ADC, 1, {"adc": (2000, 4086, 2000, 2000)}, 4086),
    (m.Fault.ADC, 0, {"adc": (9, 2000, 2000, 2000)}, 9),
]


@pytest.mark.parametrize(("fault", "channel", "bad", "value"), SLOW_FAULTS)
def test_what_lasts_ramps_down_and_latches(fault, channel, bad, value):
    bench = away()
    spoil(bench, **bad)
    assert faults(bench.hold(40, *AWAY)) == []
    assert bench.out.state == m.DeviceState.RUNNING
    (report,) = of(m.FaultReport, bench.run())
    assert (report.code, report.channel, report.value) == (fault, channel, value)
    assert report.t_dev == bench.now
    bench.wait(10)
    moved = [b - a for a, b in zip(AWAY, bench.out.applied, strict=True)]
    frozen = fault in (m.Fault.FORCE, m.Fault.STALL)
    expected = [-20, -20, 0]
    if frozen:
        expected[channel] = 0
    assert moved == expected
    assert bench.out.powered
    bench.wait(200, state=m.DeviceState.LATCHED)
    assert is_off(bench, m.DeviceState.LATCHED)


@pytest.mark.parametrize(("fault", "channel", "bad", "value"), SLOW_FAULTS)
def test_what_passes_is_no_fault(fault, channel, bad, value):
    bench = away()
    good = {name: getattr(bench, name) for name in bad}
    for _ in range(5):
        spoil(bench, **bad)
        bench.hold(30, *AWAY)
        spoil(bench, **good)
        bench.hold(10, *AWAY)
    assert bench.out.state == m.DeviceState.RUNNING
    assert bench.out.applied == AWAY


@pytest.mark.parametrize(
    "edge",
    [
        {"force": (100, 2000, 20)},
        {"length": (250 - 300, 150 + 300, 50)},
        {"adc": (10, 4085, 0, 4095)},
        {"vbus": 5000},
    ],
)
def test_limits_themselves_are_allowed(edge):
    bench = away()
    spoil(bench, **edge)
    bench.hold(200, *AWAY)
    assert bench.out.state == m.DeviceState.RUNNING


@pytest.mark.parametrize(
    ("config", "options"),
    [
        (
            {"max_force": (0,) * N, "min_force": (0,) * N, "stall_error": 0, "vbus_min": 0}
            | {"adc_mask": 0},
            {},
        ),
        ({}, {"capabilities": m.Capability(0)}),
    ],
    ids=["zeros", "no capabilities"],
)
def test_checks_are_off_by_zeros_and_where_the_board_cannot_measure(config, options):
    bench = away(replace(CONFIG, **config), **options)
    spoil(bench, length=(3000, -3000, 0), force=(-5, 9999, 1), adc=(0,) * 4, vbus=0)
    bench.hold(200, *AWAY)
    assert bench.out.state == m.DeviceState.RUNNING


@pytest.mark.parametrize("start", [2**32 - 30_000, 2**32 - 90_000])
def test_lasting_faults_and_the_watchdog_survive_the_wrap_of_the_clock(start):
    bench = away(now=start)
    spoil(bench, force=(100, 100, 2001))
    assert faults(bench.hold(40, *AWAY)) == []
    bench.run()
    assert bench.out.state == m.DeviceState.RAMPING
    assert faults(bench.wait(650)) == [(m.Fault.FORCE, 2)] * 3


# ---------------------------------------------------------------- what follows a fault
def test_the_first_cause_is_kept_and_repeated():
    bench = away()
    spoil(bench, force=(2500, 100, 100))
    bench.hold(40, *AWAY)
    bench.run()
    assert bench.out.state == m.DeviceState.RAMPING
    first = of(m.FaultReport, bench.replies)[0]
    bench.run(m.EStop())
    reports = of(m.FaultReport, bench.wait(1000))
    assert reports == [first] * 5
    state = states(bench.wait(60))[0]
    assert state.faults == 1 << m.Fault.FORCE | 1 << m.Fault.ESTOP
    assert state.state == m.DeviceState.LATCHED


def test_a_second_stalled_tendon_stops_where_it_is():
    bench = away(replace(CONFIG, ramp=1000))
    spoil(bench, length=(-100, 150, 50))
    bench.hold(50, *AWAY)
    spoil(bench, length=(-100, -300, 50))
    bench.wait(60)
    held = bench.out.applied
    assert held[0] == 250
    assert REST < held[1] < 150
    assert is_off(bench, m.DeviceState.LATCHED)


def test_clearing_needs_the_first_cause_by_name():
    bench = away()
    assert refusals(bench.run(m.Clear(m.Fault.NONE))) == [m.Reason.STATE]
    bench.run(m.EStop())
    for other in (m.Fault.NONE, m.Fault.WATCHDOG, 200):
        assert refusals(bench.run(m.Clear(other))) == [m.Reason.FAULT]
    assert is_off(bench, m.DeviceState.LATCHED)
    assert refusals(bench.run(m.Clear(m.Fault.ESTOP))) == []
    assert is_off(bench, m.DeviceState.DISARMED)
    state = states(bench.wait(60))[0]
    assert state.faults == 0
    assert faults(bench.wait(400)) == []


@pytest.mark.parametrize(
    ("fault", "bad", "good"),
    [
        (m.Fault.ESTOP, {"estop": True}, {"estop": False}),
        (m.Fault.BROWN_OUT, {"vbus": 4999}, {"vbus": 5000}),
        (m.Fault.FORCE, {"force": (100, 100, 2001)}, {"force": (100, 100, 0)}),
        (m.Fault.ADC, {"adc": (4086, 99, 99, 99)}, {"adc": (99, 99, 99, 99)}),
        (m.Fault.SLACK, {"force": (0,) * N}, None),
        (m.Fault.STALL, {"length": (2000,) * N}, None),
    ],
)
def test_clearing_needs_the_cause_to_be_gone(fault, bad, good):
    """But slack and stalled tendons may stay so with the outputs off, hence None."""
    bench = away()
    spoil(bench, **bad)
    bench.hold(40, *AWAY)
    bench.wait(200)
    if good is not None:
        assert refusals(bench.run(m.Clear(fault))) == [m.Reason.FAULT]
        assert is_off(bench, m.DeviceState.LATCHED)
        spoil(bench, **good)
        bench.run()
    assert refusals(bench.run(m.Clear(fault))) == []
    assert is_off(bench, m.DeviceState.DISARMED)


def test_a_later_cause_must_be_gone_too():
    bench = away()
    bench.wait(300)
    spoil(bench, estop=True)
    bench.run()
    assert refusals(bench.run(m.Clear(m.Fault.WATCHDOG))) == [m.Reason.FAULT]
    spoil(bench, estop=False)
    bench.run()
    assert refusals(bench.run(m.Clear(m.Fault.WATCHDOG))) == []


def test_running_goes_on_after_a_fault_only_with_a_new_session():
    bench = away()
    bench.wait(300)
    bench.run(m.Clear(m.Fault.WATCHDOG))
    bench.hold(50, REST, REST, REST)
    assert is_off(bench, m.DeviceState.DISARMED)
    bench.run(m.Arm(SESSION, fields_crc(CONFIG)))
    bench.hold(50, REST + 60, REST, REST)
    assert bench.out.applied == (REST + 60, REST, REST)
