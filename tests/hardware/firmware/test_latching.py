"""What follows a fault: the first cause is kept until it is cleared, asserted on outputs."""

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
    spoil,
    states,
)

from softrobot_env.hardware.protocol import messages as m


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


def test_a_fault_during_a_stop_latches():
    bench = away()
    bench.run(m.Stop(SESSION, 500))
    spoil(bench, force=(100, 100, 2001))
    assert faults(bench.wait(400, state=m.DeviceState.LATCHED)) == [
        (m.Fault.FORCE, 2),
        (m.Fault.FORCE, 2),
    ]


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
    ],
)
def test_clearing_needs_the_cause_to_be_gone(fault, bad, good):
    bench = away()
    spoil(bench, **bad)
    bench.hold(40, *AWAY)
    bench.wait(200)
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


def test_a_slack_or_stalled_robot_can_be_cleared_with_the_outputs_off():
    for fault, bad in (
        (m.Fault.SLACK, {"force": (0,) * N}),
        (m.Fault.STALL, {"length": (2000,) * N}),
    ):
        bench = away()
        spoil(bench, **bad)
        bench.hold(40, *AWAY)
        bench.wait(200)
        assert refusals(bench.run(m.Clear(fault))) == []


def test_running_goes_on_after_a_fault_only_with_a_new_session():
    bench = away()
    bench.wait(300)
    bench.run(m.Clear(m.Fault.WATCHDOG))
    bench.hold(50, REST, REST, REST)
    assert is_off(bench, m.DeviceState.DISARMED)
    bench.run(m.Arm(SESSION, fields_crc(CONFIG)))
    bench.hold(50, REST + 60, REST, REST)
    assert bench.out.applied == (REST + 60, REST, REST)


def test_the_switch_latches_while_disarmed():
    bench = Bench()
    bench.configure()
    spoil(bench, estop=True)
    bench.run()
    assert is_off(bench, m.DeviceState.LATCHED)
