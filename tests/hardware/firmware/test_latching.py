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

from softrobot_env.hardware.protocol.messages import (
    Arm,
    Clear,
    DeviceState,
    EStop,
    Fault,
    FaultReport,
    Reason,
    Stop,
)


def test_the_first_cause_is_kept_and_repeated():
    bench = away()
    spoil(bench, force=(2500, 100, 100))
    bench.hold(40, *AWAY)
    bench.run()
    assert bench.out.state == DeviceState.RAMPING
    first = of(FaultReport, bench.replies)[0]
    bench.run(EStop())
    reports = of(FaultReport, bench.wait(1000))
    assert reports == [first] * 5
    state = states(bench.wait(60))[0]
    assert state.faults == 1 << Fault.FORCE | 1 << Fault.ESTOP
    assert state.state == DeviceState.LATCHED


def test_a_second_stalled_tendon_stops_where_it_is():
    bench = away(replace(CONFIG, ramp=1000))
    spoil(bench, length=(-100, 150, 50))
    bench.hold(50, *AWAY)
    spoil(bench, length=(-100, -300, 50))
    bench.wait(60)
    held = bench.out.applied
    assert held[0] == 250
    assert REST < held[1] < 150
    assert is_off(bench, DeviceState.LATCHED)


def test_a_fault_during_a_stop_latches():
    bench = away()
    bench.run(Stop(SESSION, 500))
    spoil(bench, force=(100, 100, 2001))
    assert faults(bench.wait(400, state=DeviceState.LATCHED)) == [
        (Fault.FORCE, 2),
        (Fault.FORCE, 2),
    ]


def test_clearing_needs_the_first_cause_by_name():
    bench = away()
    assert refusals(bench.run(Clear(Fault.NONE))) == [Reason.STATE]
    bench.run(EStop())
    for other in (Fault.NONE, Fault.WATCHDOG, 200):
        assert refusals(bench.run(Clear(other))) == [Reason.FAULT]
    assert is_off(bench, DeviceState.LATCHED)
    assert refusals(bench.run(Clear(Fault.ESTOP))) == []
    assert is_off(bench, DeviceState.DISARMED)
    state = states(bench.wait(60))[0]
    assert state.faults == 0
    assert faults(bench.wait(400)) == []


@pytest.mark.parametrize(
    ("fault", "bad", "good"),
    [
        (Fault.ESTOP, {"estop": True}, {"estop": False}),
        (Fault.BROWN_OUT, {"vbus": 4999}, {"vbus": 5000}),
        (Fault.FORCE, {"force": (100, 100, 2001)}, {"force": (100, 100, 0)}),
        (Fault.ADC, {"adc": (4086, 99, 99, 99)}, {"adc": (99, 99, 99, 99)}),
    ],
)
def test_clearing_needs_the_cause_to_be_gone(fault, bad, good):
    bench = away()
    spoil(bench, **bad)
    bench.hold(40, *AWAY)
    bench.wait(200)
    assert refusals(bench.run(Clear(fault))) == [Reason.FAULT]
    assert is_off(bench, DeviceState.LATCHED)
    spoil(bench, **good)
    bench.run()
    assert refusals(bench.run(Clear(fault))) == []
    assert is_off(bench, DeviceState.DISARMED)


def test_a_later_cause_must_be_gone_too():
    bench = away()
    bench.wait(300)
    spoil(bench, estop=True)
    bench.run()
    assert refusals(bench.run(Clear(Fault.WATCHDOG))) == [Reason.FAULT]
    spoil(bench, estop=False)
    bench.run()
    assert refusals(bench.run(Clear(Fault.WATCHDOG))) == []


def test_a_slack_or_stalled_robot_can_be_cleared_with_the_outputs_off():
    for fault, bad in ((Fault.SLACK, {"force": (0,) * N}), (Fault.STALL, {"length": (2000,) * N})):
        bench = away()
        spoil(bench, **bad)
        bench.hold(40, *AWAY)
        bench.wait(200)
        assert refusals(bench.run(Clear(fault))) == []


def test_running_goes_on_after_a_fault_only_with_a_new_session():
    bench = away()
    bench.wait(300)
    bench.run(Clear(Fault.WATCHDOG))
    bench.hold(50, REST, REST, REST)
    assert is_off(bench, DeviceState.DISARMED)
    bench.run(Arm(SESSION, fields_crc(CONFIG)))
    bench.hold(50, REST + 60, REST, REST)
    assert bench.out.applied == (REST + 60, REST, REST)


def test_the_switch_latches_while_disarmed():
    bench = Bench()
    bench.configure()
    spoil(bench, estop=True)
    bench.run()
    assert is_off(bench, DeviceState.LATCHED)
