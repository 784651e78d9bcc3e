"""The host's session against the firmware's core, on a virtual clock."""

from dataclasses import replace
from struct import pack
from zlib import crc32

import numpy as np
import pytest
from support.hardware_boards import PASS, Bench, state

from softrobot_env.hardware.errors import (
    ProtocolMismatchError,
    RobotError,
    RobotFaultError,
    SessionLostError,
)
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import Decoder, encode
from softrobot_env.hardware.protocol.session import DeviceClock, LinkCounters, Phase
from softrobot_env.hardware.robot_file import Supervision, rig_file, virtual_file
from softrobot_env.hardware.virtual_robot import Core

HERE = [0.0, 0.0, 0.0]


@pytest.fixture
def bench():
    """A robot that is configured."""
    found = Bench()
    found.connect()
    return found


@pytest.fixture
def armed(bench):
    bench.arm()
    return bench


def turned(robot):
    """A bench of a robot whose tendons have other channels."""
    channels = zip(robot.tendons, (2, 0, 1), strict=True)
    return Bench(replace(robot, tendons=tuple(replace(s, channel=c) for s, c in channels)))


@pytest.mark.parametrize(
    ("position", "present"),
    [((150, -20, 7), [1.5e-3, -0.2e-3, 0.07e-3]), ((3100, 0, 0), [0.03, 0, 0])],
    ids=["inside the range", "at the end of the range if just outside"],
)
def test_outputs_go_on_where_the_robot_stands(position, present):
    bench = Bench()
    bench.board.position = position
    bench.start()
    assert bench.session.phase == Phase.RUNNING
    np.testing.assert_allclose(bench.board.applied, present)


def test_a_set_point_is_followed_and_echoed(armed):
    for _ in range(10):
        seq = armed.command([1e-3, -2e-3, 0.0])
    reading = armed.session.echo(seq)
    assert reading.seq == seq and reading is armed.session.reading
    np.testing.assert_allclose(reading.applied, [1e-3, -2e-3, 0.0])
    # The board waits for the state's delay, the bench passes every millisecond.
    assert 0.012 <= reading.round_trip <= 0.015


def test_tendons_keep_their_order_whatever_their_channels():
    bench = turned(rig_file()).start()
    for _ in range(10):
        bench.command([1e-3, 2e-3, 3e-3])
    assert bench.board.core.outputs.applied == (200, 300, 100)
    np.testing.assert_allclose(bench.session.reading.applied, [1e-3, 2e-3, 3e-3])


@pytest.mark.parametrize(
    ("length", "complaint"),
    [
        ([0.0, 0.0301, 0.0], r"tendon 2: 30.10 mm is outside its range of -30.00 to 30.00 mm"),
        ([0.0, 0.0], "needs 3 finite lengths"),
        ([0.0, np.nan, 0.0], "needs 3 finite lengths"),
    ],
)
def test_a_wrong_set_point_is_refused_before_it_is_sent(armed, length, complaint):
    sent = armed.session.link.sent
    with pytest.raises(ValueError, match=complaint):
        armed.session.setpoint(np.array(length), armed.now)
    assert armed.session.link.sent == sent


def test_a_refused_set_point_is_not_under_way(armed):
    armed.session.robot = replace(armed.robot, ttl=1e-3)
    late = [armed.session.setpoint(np.array(HERE), armed.now)[1] for _ in range(3)]
    armed.session.robot = armed.robot  # for the host they are young enough to be answered
    armed.run(0.01)
    for frame in late:
        armed.say(frame, 0.002)
    assert armed.session.link.as_dict()["nacks"] == {"late": 3}
    armed.command(HERE)


@pytest.mark.parametrize("start", [2**32 * 1e-6 - 0.2, 2**33 * 1e-6 - 0.2])
def test_clocks_may_wrap(start):
    bench = Bench(start=start).start()
    for _ in range(20):
        bench.command([1e-3, 0, 0])
    assert bench.session.phase == Phase.RUNNING
    assert bench.session.link.longest_round_trip < 0.02


def test_sequence_numbers_may_wrap():
    bench = Bench()
    bench.session._seq = 2**16 - 8
    bench.connect()
    first = bench.arm()
    for _ in range(10):
        seq = bench.command(HERE)
    assert seq < first and bench.session.echo(seq).seq == seq
    assert bench.session.phase == Phase.RUNNING


def test_silence_latches_and_arming_waits_for_a_clear(armed):
    armed.run(0.4)
    assert not armed.board.core.outputs.powered
    assert armed.session.fault.code == m.Fault.WATCHDOG
    assert armed.session.fault.value == pytest.approx(0.1, abs=2e-3)
    for action in (lambda: armed.command(HERE), lambda: armed.session.arm(6)):
        with pytest.raises(RobotFaultError, match=r"no set-point for 0\.1"):
            action()
    armed.say(armed.session.clear(), 0.06)
    assert armed.session.fault is None and armed.session.phase == Phase.CONFIGURED
    armed.arm(number=6)
    assert armed.session.phase == Phase.RUNNING


@pytest.mark.parametrize(
    ("bad", "length", "text"),
    [
        ({"stuck": (0, 0, 0)}, (6.1e-3, 0.0, 0.0), "tendon 2 stalled 6.1 mm behind"),
        ({"force": (4500, 0, 0)}, HERE, "tendon 2 pulled with 45.00 N"),
        ({"supply": 4312}, HERE, "supply fell to 4.31 V"),
    ],
)
def test_a_fault_tells_its_number_and_the_tendon_of_the_channel(bad, length, text):
    bench = turned(virtual_file()).start()
    vars(bench.board).update(bad)
    for _ in range(60):
        if bench.session.fault is None:
            bench.command((0.0, length[0], 0.0))
    assert bench.session.fault.text == text


def test_a_stop_ramps_and_ends_the_session(armed):
    for _ in range(20):
        armed.command([5e-3, 0.0, 0.0])
    armed.say(armed.session.stop(), 0.05)
    assert armed.session.phase == Phase.STOPPING
    with pytest.raises(RobotError, match="it is stopping"):
        armed.command(HERE)
    armed.run(0.3)
    assert armed.session.phase == Phase.CONFIGURED and armed.session.fault is None
    assert not armed.board.core.outputs.powered


def test_a_restart_in_a_session_is_told_and_never_armed_again(armed):
    armed.board.core = Core(boot_id=2, reset_cause=m.Reset.BROWN_OUT)
    with pytest.raises(SessionLostError, match=r"cause: brown-out; boot 00000001, now 00000002"):
        armed.run(0.2)
    with pytest.raises(SessionLostError, match="call connect"):
        armed.session.arm(6)
    assert not armed.board.core.outputs.powered


def test_a_dropped_session_without_a_restart_is_reported(armed):
    armed.say(encode(m.Hello(78, m.PROTOCOL, m.PROTOCOL), 0))  # of another host
    with pytest.raises(SessionLostError, match="without starting again"):
        armed.run(0.2)


def test_an_arming_without_a_set_point_leaves_the_robot_configured(bench):
    bench.say(bench.session.arm(5), 0.06)
    assert bench.session.phase == Phase.ARMED
    bench.run(1.2)
    assert bench.session.phase == Phase.CONFIGURED
    bench.arm(number=6)
    assert bench.session.phase == Phase.RUNNING


def test_what_waits_on_its_way_was_taken_before_it_arrived(armed):
    for _ in range(60):  # longer than the board is silent without set-points
        armed.now += PASS
        armed.board.run(armed.now)
    late = armed.now + 0.3
    armed.session.receive(armed.board.core.transmit(), late)
    reading, link = armed.session.reading, armed.session.link.as_dict()
    assert reading.time == late and late - reading.device_time >= 0.3
    # On the bench both sides have one clock.
    assert reading.age(late) == pytest.approx(late - reading.device_time, abs=2e-3)
    assert link["delay"] == link["longest_delay"] == pytest.approx(reading.age(late))


# ---------------------------------------------------------------- answers that do not fit


def hello_ack(bench, **changes):
    ack = m.HelloAck(77, 1, 0x0203, 1, 1, m.SCHEMA, 3, 15, 0)
    return bench.session.receive(encode(replace(ack, **changes), 0), bench.now)


def test_a_fault_is_known_by_its_kind_until_its_report_comes():
    bench = Bench()
    hello_ack(bench)
    latched = state(state=m.DeviceState.LATCHED, faults=1 << m.Fault.STALL)
    bench.session.receive(encode(latched, 1), bench.now)
    assert bench.session.fault.text == "a servo stalled" and not bench.session.fault_reported
    bench.session.receive(encode(m.FaultReport(m.Fault.STALL, 1, -310, 0), 2), bench.now)
    assert bench.session.fault.text == "tendon 2 stalled 3.1 mm behind"


@pytest.mark.parametrize(
    ("changes", "error", "complaint"),
    [
        (
            {"min_protocol": 2, "max_protocol": 4},
            ProtocolMismatchError,
            r"firmware 2\.3 speaks protocol 2 to 4.*1:",
        ),
        ({"schema": m.SCHEMA ^ 1}, ProtocolMismatchError, "different tables of messages"),
        ({"n": 6}, RobotError, "board drives 6 servos, robot 'rig' has 3"),
    ],
)
def test_another_board_is_refused(changes, error, complaint):
    with pytest.raises(error, match=complaint):
        hello_ack(Bench(), **changes)


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"supervision": Supervision(stall=5e-3)}, "stall_mm", m.Capability.LENGTH),
        ({"tendons": virtual_file().tendons}, "max_force_n", m.Capability.FORCE),
        ({"supervision": Supervision(adc_channels=(1,))}, "adc_channels", m.Capability.ADC),
        ({"supervision": Supervision(supply=4.8)}, "supply_v", m.Capability.SUPPLY),
    ],
)
def test_a_board_that_cannot_watch_what_the_file_asks_for_is_refused(changes, key, what):
    bench = Bench(replace(rig_file(), **changes))
    hello_ack(bench, capabilities=15)
    assert bench.session.phase == Phase.IDENTIFIED
    bench = Bench(replace(rig_file(), **changes))
    with pytest.raises(RobotError, match=f"asks for {key}.*not measure {what.name.lower()}"):
        hello_ack(bench, capabilities=15 & ~what)


#: Burnt into every board of protocol 1: it checks and sends frames with this number. Whoever
#: changes a message or the name of a code changes the hash, and those boards fall silent. If that
#: is meant, raise `PROTOCOL` and tell users to flash their boards; do not just edit this line.
FLASHED = 0x7F7DC78A


@pytest.mark.parametrize(
    ("changes", "phase"),
    [({"nonce": 78}, Phase.NEW), ({"firmware": 0x0100, "schema": FLASHED}, Phase.IDENTIFIED)],
    ids=["to another hello", "of a board that was flashed before"],
)
def test_answers_are_ignored_or_pass_the_handshake(changes, phase):
    bench = Bench()
    hello_ack(bench, **changes)
    assert bench.session.phase == phase


def test_another_configuration_is_not_taken_for_ours():
    bench = Bench()
    hello_ack(bench)
    with pytest.raises(RobotError, match="another configuration"):
        bench.session.receive(encode(m.ConfigAck(1), 1), bench.now)


# ---------------------------------------------------------------- clocks and counters of a link


WRAP = 2**32


def ages(stamps, arrivals, start=0):
    """Age [s] at arrival of messages sent and arrived at times [s]."""
    clock = DeviceClock()
    counts = [round(1e6 * stamp + start) % WRAP for stamp in stamps]
    pairs = zip(counts, arrivals, strict=True)
    return [arrival - clock.taken(count, arrival) for count, arrival in pairs]


@pytest.mark.parametrize(
    ("stamps", "arrivals", "start", "expected"),
    [
        ([5.0, 5.1, 5.2], [100.0, 100.1, 100.2], 0, [0, 0, 0]),
        ([5.0, 5.1, 5.2, 5.3], [100.0, 100.4, 100.4, 100.4], 0, [0, 0.3, 0.2, 0.1]),
        ([5.0, 5.1, 5.2], [100.3, 100.1, 100.2], 0, [0, 0, 0]),
        ([0.0, 0.1, 0.2], [100.0, 100.1, 100.25], WRAP - 150_000, [0, 0, 0.05]),
        ([500.0, 500.1, 0.2, 0.3], [1.0, 1.1, 1.6, 1.7], 0, [0, 0, 0, 0]),
    ],
    ids=["at once", "waited", "the first one waited", "clock wraps", "clock starts again"],
)
def test_what_waits_is_as_old_as_it_has_waited(stamps, arrivals, start, expected):
    accuracy = 3e-3 if any(expected) else 1e-9
    assert ages(stamps, arrivals, start) == pytest.approx(expected, abs=accuracy)


@pytest.mark.parametrize("drift", [-0.005, 0.005])
def test_the_drift_of_a_resonator_is_no_age(drift):
    stamps = [0.05 * k for k in range(2000)]
    arrivals = [stamp * (1 + drift) for stamp in stamps]
    assert max(ages(stamps, arrivals)) < 1e-3


@pytest.mark.parametrize(
    ("numbers", "old", "lost"),
    [((65534, 65535, 65535, 3, 2, 4), (2, 4), 3), ((500, 0), (), 0)],
    ids=["lost and doubled", "a count that begins anew"],
)
def test_lost_and_old_messages_are_counted(numbers, old, lost):
    link = LinkCounters()
    arrived = [link.note_arrival(number) for number in numbers]
    assert [place for place, new in enumerate(arrived) if not new] == list(old)
    assert (link.lost, link.old, link.received) == (lost, len(old), arrived.count(True))


# ---------------------------------------------------------------- the table of messages


@pytest.mark.parametrize("kind", [*m.ENUMERATIONS, *m.FLAGS])
def test_every_number_that_stands_for_something_is_in_the_schema(kind):
    (line,) = [x for x in m.schema_text().splitlines() if x.startswith(f"{kind.__name__} ")]
    assert line.split()[1:] == [f"{code.name}={code.value}" for code in kind]


def test_what_a_board_that_was_flashed_before_says_is_understood():
    cobs = pytest.importorskip("cobs.cobs", reason="needs the robot extra")
    body = m.pack(m.Pong(5, 6), 1)
    frame = cobs.encode(body + pack("<I", crc32(body, FLASHED)))
    assert Decoder().feed(b"\0" + frame + b"\0") == [(m.Pong(5, 6), 1)]
    assert encode(m.Pong(5, 6), 1) == b"\0" + frame + b"\0"
