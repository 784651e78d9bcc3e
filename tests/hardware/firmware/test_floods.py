"""Damage on the line and peers that do not read: memory stays bounded, and nothing moves."""

import numpy as np
import pytest
from support.firmware_bench import CONFIG, Bench, N, of, running, states

from softrobot_env.hardware.protocol.messages import Hello, HelloAck, Ping, encode
from softrobot_env.hardware.virtual_robot import Measured


@pytest.mark.parametrize("seed", range(5))
def test_a_flood_of_garbage_moves_nothing_and_is_survived(seed):
    bench = running()
    bench.hold(50, 250, 250, 250)
    garbage = np.random.default_rng(seed)
    for _ in range(300):
        before = np.array(bench.out.applied)
        bench.core.receive(garbage.bytes(200))
        bench.run()
        assert np.all(abs(np.array(bench.out.applied) - before) <= 2)
    assert not bench.out.powered
    (state,) = states(bench.wait(51))[-1:]
    assert state.crc_errors + state.frame_errors > 100
    bench.core.receive(b"\0")
    assert len(of(HelloAck, bench.run(Hello(3, 1, 1)))) == 1


def test_one_flipped_bit_never_gives_another_motion():
    size = len(encode(Bench().setpoint(250, 250, 250), 1))
    for bit in range(8 * size):
        bench = running()
        frame = bytearray(encode(bench.setpoint(250, 250, 250), bench.seq + 1))
        frame[bit // 8] ^= 1 << bit % 8
        bench.core.receive(bytes(frame))
        bench.run()
        bench.run()
        only_a_delimiter = bit // 8 == 0 and bench.out.applied == (60,) * N
        assert bench.out.applied == (50,) * N or only_a_delimiter


QUIET = Measured((0,) * N, (0,) * N, (0,) * 4, 0, False)


def unread(bench, periods):
    """(messages, errors) that wait after so many states nobody has read."""
    for _ in range(periods):
        bench.now += 50_000
        bench.core.run(bench.now, QUIET)
    found = bench.decoder.feed(bench.core.transmit())
    return found, bench.decoder.crc_errors + bench.decoder.frame_errors


def test_a_peer_that_reads_nothing_gets_whole_messages():
    bench = Bench()
    frames, errors = unread(bench, 100)
    assert errors == 0
    assert [seq for _, seq in frames] == list(range(len(frames)))
    assert len(frames) < 10
    bench.run(Hello(42, 1, 1))
    assert bench.replies[0].nonce == 42


def test_what_found_no_room_leaves_a_gap_in_the_sequence():
    bench = Bench()
    frames, _ = unread(bench, 10)
    ((_, later),) = unread(bench, 1)[0]
    assert len(frames) < 10
    assert later == 10


def test_states_leave_room_for_answers():
    bench = Bench()
    for _ in range(100):
        bench.now += 50_000
        bench.core.run(bench.now, QUIET)
    answers = bench.run(Hello(1, 1, 1), CONFIG, Ping(9))
    assert [type(m).__name__ for m in answers if not states([m])] == [
        "HelloAck",
        "ConfigAck",
        "Pong",
    ]
