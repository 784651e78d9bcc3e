"""What the device does by itself when something goes wrong, asserted on its outputs."""

from dataclasses import replace

import pytest
from support.firmware_bench import (
    AWAY,
    CONFIG,
    REST,
    SESSION,
    Bench,
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


def test_a_setpoint_after_its_time_saves_no_watchdog():
    bench = away()
    replies = bench.run(bench.setpoint(*AWAY), ms=200)
    assert refusals(replies) == [m.Reason.STATE]
    bench.wait(200, state=m.DeviceState.LATCHED)


@pytest.mark.parametrize("cause", ["message", "switch"])
def test_an_emergency_stop_cuts_at_once(cause):
    bench = away()
    spoil(bench, estop=cause == "switch")
    replies = bench.run(*[m.EStop()] * (cause == "message"))
    assert is_off(bench, m.DeviceState.LATCHED)
    assert faults(replies) == [(m.Fault.ESTOP, 0)]
    bench.hold(100, *AWAY)
    assert is_off(bench, m.DeviceState.LATCHED)


def test_an_emergency_stop_cuts_a_ramp_too():
    bench = away()
    bench.run(m.Stop(SESSION, 0))
    bench.wait(10)
    bench.run(m.EStop())
    assert is_off(bench, m.DeviceState.LATCHED)


def test_an_emergency_stop_needs_no_hello():
    bench = Bench()
    assert faults(bench.run(m.EStop())) == [(m.Fault.ESTOP, 0)]
    assert is_off(bench, m.DeviceState.LATCHED)
    assert refusals(bench.configure()) == []
    assert refusals(bench.run(m.Arm(SESSION, fields_crc(CONFIG)))) == [m.Reason.STATE]
    bench.run(m.Clear(m.Fault.ESTOP))
    assert refusals(bench.run(m.Arm(SESSION, fields_crc(CONFIG)))) == []


def test_low_voltage_cuts_at_once():
    bench = away()
    spoil(bench, vbus=4999)
    assert faults(bench.run()) == [(m.Fault.BROWN_OUT, 0)]
    assert is_off(bench, m.DeviceState.LATCHED)


def test_voltage_does_not_matter_while_the_outputs_are_off():
    bench = Bench()
    spoil(bench, vbus=0)
    bench.configure()
    bench.wait(300)
    assert is_off(bench, m.DeviceState.DISARMED)


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


BAD_EVERYWHERE = {"force": (-5, 9999, 1), "adc": (0,) * 4, "vbus": 0}


def test_zeros_switch_checks_off():
    none = {"max_force": (0,) * N, "min_force": (0,) * N, "stall_error": 0, "vbus_min": 0}
    bench = away(replace(CONFIG, adc_mask=0, **none))
    spoil(bench, length=(3000, -3000, 0), **BAD_EVERYWHERE)
    bench.hold(200, *AWAY)
    assert bench.out.state == m.DeviceState.RUNNING


def test_what_the_board_cannot_measure_is_not_checked():
    bench = away(capabilities=m.Capability(0))
    spoil(bench, length=(3000, -3000, 0), **BAD_EVERYWHERE)
    bench.hold(200, *AWAY)
    assert bench.out.state == m.DeviceState.RUNNING


def test_a_rail_of_the_converter_is_told_at_once():
    bench = away()
    spoil(bench, adc=(2000, 4095, 2000, 2000))
    warnings = [state.warnings for state in states(bench.hold(20, *AWAY))]
    assert warnings[-1] == m.Warning.ADC_RAIL
    spoil(bench, adc=(2000, 2000, 4095, 2000))  # that one is not supervised
    assert states(bench.hold(20, *AWAY))[-1].warnings == 0


def test_slewing_is_told_while_under_way():
    bench = running()
    warnings = [state.warnings for state in states(bench.hold(50, REST + 250, REST, REST))]
    assert warnings == [1, 1, 1, 0, 0]


@pytest.mark.parametrize("start", [2**32 - 30_000, 2**32 - 90_000])
def test_lasting_faults_and_the_watchdog_survive_the_wrap_of_the_clock(start):
    bench = away(now=start)
    spoil(bench, force=(100, 100, 2001))
    assert faults(bench.hold(40, *AWAY)) == []
    bench.run()
    assert bench.out.state == m.DeviceState.RAMPING
    assert faults(bench.wait(650)) == [(m.Fault.FORCE, 2)] * 3
