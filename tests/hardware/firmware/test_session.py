"""What the device does with a host's messages, asserted on its outputs."""

from dataclasses import replace

import numpy as np
import pytest
from support.firmware_bench import (
    AWAY,
    CONFIG,
    REST,
    SESSION,
    Bench,
    N,
    fields_crc,
    is_off,
    of,
    refusals,
    running,
    states,
)

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import DeviceState, Reason


def test_hello_is_answered_with_what_the_board_is():
    bench = Bench(boot_id=2**32 - 2, reset_cause=m.Reset.BROWN_OUT, capabilities=m.Capability.ADC)
    (ack,) = bench.run(m.Hello(2**32 - 1, 1, 9))
    assert ack == m.HelloAck(
        nonce=2**32 - 1,
        boot_id=2**32 - 2,
        firmware=0x100,
        min_protocol=1,
        max_protocol=1,
        schema=m.SCHEMA,
        n=N,
        capabilities=m.Capability.ADC,
        reset_cause=m.Reset.BROWN_OUT,
    )


def test_nothing_goes_without_a_fitting_hello():
    bench = Bench()
    arm = m.Arm(SESSION, fields_crc(CONFIG))
    assert refusals(bench.run(CONFIG, arm, m.Ping(1))) == [m.Reason.PROTOCOL] * 3
    for low, high in ((2, 9), (0, 0)):
        replies = bench.run(m.Hello(5, low, high), CONFIG)
        assert of(m.HelloAck, replies)[0].nonce == 5
        assert refusals(replies) == [m.Reason.PROTOCOL]
    assert of(m.ConfigAck, bench.run(m.Hello(6, 0, 3), CONFIG)) == [m.ConfigAck(fields_crc(CONFIG))]


def test_hello_ends_a_session_with_a_ramp_and_forgets_the_configuration():
    bench = running()
    bench.hold(50, 250, 250, 250)
    bench.run(m.Hello(9, 1, 1))
    assert bench.out.state == m.DeviceState.RAMPING
    assert refusals(bench.run(bench.setpoint(300, 300, 300))) == [m.Reason.STATE]
    bench.wait(200, state=m.DeviceState.DISARMED)
    assert bench.out.applied == (REST,) * N
    assert refusals(bench.run(m.Arm(SESSION, fields_crc(CONFIG)))) == [m.Reason.CONFIG]


_ARRAYS = ("center_us", "gain", "minimum", "maximum", "slew", "rest", "max_force", "min_force")
TWO_TENDONS = {"n": 2, **{name: getattr(CONFIG, name)[:2] for name in _ARRAYS}}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"minimum": (60, -3000, -3000)}, m.Reason.CONFIG),
        ({"rest": (REST, REST, 2501)}, m.Reason.CONFIG),
        ({"gain": (1000, 0, 500)}, m.Reason.CONFIG),
        ({"slew": (10000, 10000, 0)}, m.Reason.CONFIG),
        ({"ramp": 0}, m.Reason.CONFIG),
        ({"free_run_ms": 0}, m.Reason.CONFIG),
        ({"watchdog_ms": 19}, m.Reason.RANGE),
        ({"watchdog_ms": 1001}, m.Reason.RANGE),
        ({"center_us": (699, 1400, 1600)}, m.Reason.RANGE),
        ({"center_us": (1500, 2301, 1600)}, m.Reason.RANGE),
        ({"gain": (1000, -32768, 500)}, m.Reason.RANGE),
        (TWO_TENDONS, m.Reason.COUNT),
        ({"watchdog_ms": 20}, None),
        ({"watchdog_ms": 1000, "center_us": (700, 2300, 1600)}, None),
    ],
)
def test_a_wrong_configuration_is_refused_and_an_extreme_one_accepted(changes, reason):
    bench = Bench()
    config = replace(CONFIG, **changes)
    answers, armed = bench.configure(config), bench.run(m.Arm(SESSION, fields_crc(config)))
    if reason is None:
        assert of(m.ConfigAck, answers) == [m.ConfigAck(fields_crc(config))] and not refusals(armed)
    else:
        assert refusals(answers) == [reason] and refusals(armed) == [m.Reason.CONFIG]


def test_a_configuration_is_refused_while_armed_running_and_ramping():
    bench = Bench()
    bench.arm()
    assert refusals(bench.run(CONFIG)) == [m.Reason.STATE]
    bench.run(bench.setpoint(REST, REST, REST))
    bench.hold(20, 200, 200, 200)
    other = replace(CONFIG, center_us=(1700, 1700, 1700))
    before = bench.out.pulse_us
    assert refusals(bench.run(other)) == [m.Reason.STATE]
    assert max(abs(a - b) for a, b in zip(bench.out.pulse_us, before, strict=True)) <= 1
    bench.run(m.Stop(SESSION, 0))
    assert refusals(bench.run(other)) == [m.Reason.STATE]


def test_arming_needs_the_configuration_and_a_session():
    bench = Bench()
    bench.configure()
    crc = fields_crc(CONFIG)
    assert refusals(bench.run(m.Arm(SESSION, crc ^ 1))) == [m.Reason.CONFIG]
    assert refusals(bench.run(m.Arm(0, crc))) == [m.Reason.SESSION]
    assert is_off(bench, m.DeviceState.DISARMED)
    assert refusals(bench.run(m.Arm(SESSION, crc))) == []
    assert is_off(bench, m.DeviceState.ARMED)
    assert refusals(bench.run(m.Arm(SESSION, crc))) == [m.Reason.STATE]


@pytest.mark.parametrize(
    "present", [{"vbus": 4999}, {"force": (100, 2001, 100)}, {"adc": (9, 99, 99, 99)}]
)
def test_arming_is_refused_while_something_is_wrong(present):
    bench = Bench()
    bench.configure()
    vars(bench).update(present)
    assert refusals(bench.run(m.Arm(SESSION, fields_crc(CONFIG)))) == [m.Reason.FAULT]
    assert is_off(bench, m.DeviceState.DISARMED)


def test_the_first_setpoint_must_be_near_where_the_servos_are():
    bench = Bench()
    bench.arm()
    bench.length = (500, -500, REST)
    assert refusals(bench.run(bench.setpoint(500, -399, REST))) == [m.Reason.FAR]
    assert is_off(bench, m.DeviceState.ARMED)
    assert refusals(bench.run(bench.setpoint(600, -400, REST))) == []
    assert bench.out.powered
    assert bench.out.applied == bench.length
    assert bench.out.pulse_us == (1550, 1450, 1603)  # 1500 + 10 * 5, 1400 + 10 * 5, 1600 + 5 / 2


@pytest.mark.parametrize(
    ("end", "speed"),
    [
        (m.Disarm(SESSION), 2),
        (m.Stop(SESSION, 0), 2),
        (m.Stop(SESSION, 1000), 1),
        (m.Stop(SESSION, 5000), 5),
        (m.Stop(SESSION, 60000), 10),
    ],
    ids=["disarm", "stop", "slower", "faster", "no faster than the slew"],
)
def test_stop_and_disarm_ramp_to_rest_and_switch_off(end, speed):
    bench = running()
    bench.hold(50, 250, REST, REST)
    bench.run(end)
    bench.wait(10)
    assert bench.out.applied[0] == 250 - speed * 10
    assert bench.out.powered
    bench.wait(200 // speed - 10)
    assert is_off(bench, m.DeviceState.DISARMED)
    assert bench.out.applied == (REST,) * N


@pytest.mark.parametrize("start", [0, 2**32 - 5_000_000])
def test_a_ramp_ends_after_ten_seconds_however_slow_it_is(start):
    bench = Bench(now=start).start()
    bench.hold(50, *AWAY)
    bench.run(m.Stop(SESSION, 1))
    bench.wait(9999)
    assert bench.out.powered
    assert bench.out.applied == (241, 141, REST)
    bench.run()
    assert is_off(bench, m.DeviceState.DISARMED)


@pytest.mark.parametrize("end", [m.Stop(SESSION + 1, 0), m.Disarm(SESSION + 1), m.Disarm(0)])
def test_only_its_own_session_can_be_stopped(end):
    bench = running()
    assert refusals(bench.run(end)) == [m.Reason.SESSION]
    assert bench.out.state == m.DeviceState.RUNNING


def test_sessions_follow_each_other():
    bench = running()
    bench.run(m.Disarm(SESSION))
    bench.wait(5, state=m.DeviceState.DISARMED)
    bench.run(m.Arm(SESSION + 1, fields_crc(CONFIG)))
    assert refusals(bench.run(bench.setpoint(60, REST, REST))) == [m.Reason.SESSION]
    new = bench.setpoint(60, REST, REST, session=SESSION + 1)
    assert refusals(bench.run(new, seq=0)) == []
    bench.run()
    assert bench.out.applied == (60, REST, REST)


def test_ping_is_answered_and_feeds_nothing():
    bench = running()
    for _ in range(9):
        (pong,) = of(m.Pong, bench.run(m.Ping(12345), ms=11))
        assert pong == m.Pong(12345, bench.now)
    bench.run(m.Ping(0), ms=2)
    assert is_off(bench, m.DeviceState.LATCHED)


# ---------------------------------------------------------------- set-points
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


def test_a_state_follows_each_setpoint_after_the_delay():
    bench = running()
    bench.wait(5)
    setpoint = bench.setpoint(60, REST, REST)
    assert states(bench.run(setpoint)) == states(bench.run()) == []
    (state,) = states(bench.run())
    assert (state.last_seq, state.t_host_echo) == (bench.seq, setpoint.t_host)
    assert state.session == SESSION
    assert state.state == DeviceState.RUNNING


def test_a_state_tells_what_is_measured():
    bench = running()
    bench.length, bench.force = (60, -70, 80), (101, 202, 303)
    bench.adc, bench.vbus = (11, 22, 33, 4095), 65535
    (state,) = states(bench.run(ms=50))
    assert (state.length, state.force) == (bench.length, bench.force)
    assert (state.adc, state.vbus) == (bench.adc, bench.vbus)
    assert state.applied == (REST,) * N
    assert state.t_dev == bench.now


def test_slow_slews_do_not_stand_still_between_short_passes():
    bench = running(replace(CONFIG, slew=(10, 10000, 10000)))
    bench.hold(2000, 1000, REST, REST)
    assert bench.out.applied[0] == pytest.approx(REST + 20, abs=1)


# ---------------------------------------------------------------- another calibration
@pytest.mark.parametrize(
    ("changes", "present"),
    [
        ({}, AWAY),
        ({"center_us": (1505, 1380, 1610)}, (200, -50, -150)),
        ({"gain": (500, 2000, -500)}, (500, -75, -50)),
        ({"center_us": (1505, 1400, 1600), "gain": (-1600, 1000, 300)}, (-125, -150, 83)),
    ],
)
def test_a_new_calibration_leaves_unmeasured_servos_where_they_are(changes, present):
    """Of servos that are switched off away from rest."""
    bench = Bench(capabilities=m.Capability(0)).start()
    bench.hold(50, *AWAY)
    assert bench.out.pulse_us == (1525, 1385, 1603)
    bench.run(m.EStop())
    bench.run(m.Clear(m.Fault.ESTOP))
    before = np.array((1525, 1385, 1602.5))
    bench.arm(replace(CONFIG, **changes))
    assert bench.out.applied == present
    assert refusals(bench.run(bench.setpoint(present[0] + 101, *present[1:]))) == [m.Reason.FAR]
    assert refusals(bench.run(bench.setpoint(*present))) == []
    assert bench.out.powered
    assert np.all(abs(bench.out.pulse_us - before) <= 0.51)
