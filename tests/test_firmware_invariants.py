"""Whatever a host sends and a board measures: outputs stay inside their limits and slew rates, and
nothing but the ramp to rest moves them without a fresh set-point of the session.
"""

from dataclasses import replace

import numpy as np
import pytest
from firmware_bench import CONFIG, Bench, N, fields_crc, of, refusals, running, states
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from softrobot_env.hardware.core import Measured
from softrobot_env.hardware.framing import encode
from softrobot_env.hardware.messages import (
    Arm,
    Clear,
    DeviceState,
    Disarm,
    EStop,
    Fault,
    Hello,
    HelloAck,
    Ping,
    Stop,
)

#: Narrow limits, so that they are met often.
TIGHT = replace(CONFIG, watchdog_ms=200, minimum=(-300,) * N, maximum=(300, 250, 300))
LOW, HIGH, SLEW, REST = (
    np.array(numbers) for numbers in (TIGHT.minimum, TIGHT.maximum, TIGHT.slew, TIGHT.rest)
)
LONGEST_STEP = 0.05  # s, that a main loop which was stuck catches up

steps = st.floats(0.1, 30) | st.floats(0.1, 250)  # ms
lengths = st.tuples(*[st.integers(-350, 350)] * N)
little_ways = st.tuples(*[st.integers(-90, 90)] * N)


class Link(RuleBasedStateMachine):
    """A host that does anything in any order, over a line that loses, repeats and adds."""

    def __init__(self):
        super().__init__()
        self.bench = Bench(now=2**32 - 10**6)
        self.session = 0
        self.fed, self.target = None, None  # time and target of the last fresh set-point
        self.accepted = []  # frames of set-points

    def step(self, ms, *messages, fresh=None):
        """A pass; what it does to the outputs must be allowed."""
        bench, before = self.bench, self.bench.out
        present = before.applied if bench.length is None else bench.length
        bench.run(*messages, ms=ms)
        after, accepted = bench.out, fresh is not None and not refusals(bench.replies)
        self.check_limits(after)
        if before.powered:
            moved = np.subtract(after.applied, before.applied)
            self.check_motion(before, moved, round(1000 * ms) / 1e6)
        elif after.powered:
            assert accepted
            assert np.all(abs(np.subtract(fresh.target, present)) <= TIGHT.arm_window)
            np.testing.assert_array_equal(after.applied, np.clip(present, LOW, HIGH))
        if accepted:
            self.fed, self.target = bench.now, np.array(fresh.target)

    def check_limits(self, out):
        if not out.powered:
            assert out.pulse_us == (0,) * N
            return
        applied = np.array(out.applied)
        assert np.all(applied >= LOW)
        assert np.all(applied <= HIGH)
        pulses = np.array(TIGHT.center_us) + np.array(TIGHT.gain) * applied / 1e4
        np.testing.assert_allclose(out.pulse_us, pulses, atol=0.51)

    def check_motion(self, before, moved, seconds):
        """Towards the last fresh set-point if it is recent enough, otherwise only by the ramp."""
        silence = (self.bench.now - self.fed) / 1000
        follows = before.state == DeviceState.RUNNING and silence < TIGHT.watchdog_ms
        way = (self.target if follows else REST) - before.applied
        most = (SLEW if follows else TIGHT.ramp) * min(seconds, LONGEST_STEP) + 1
        assert np.all(moved * way >= 0)
        assert np.all(abs(moved) <= np.minimum(abs(way), most))

    @rule(ms=steps)
    def nothing(self, ms):
        self.step(ms)

    @rule(ms=steps, low=st.integers(0, 2), high=st.integers(0, 2))
    def hello(self, ms, low, high):
        self.step(ms, Hello(1, low, high))

    @rule(ms=steps)
    def configure(self, ms):
        self.step(ms, Hello(1, 1, 1), TIGHT)

    @rule(ms=steps)
    def arm(self, ms):
        self.session += 1
        self.step(ms, Arm(self.session, fields_crc(TIGHT)))

    @rule(ms=steps, length=st.none() | lengths, way=little_ways, scale=st.integers(1, 3))
    def start(self, ms, length, way, scale):
        self.all_well(1)
        self.bench.length = length
        self.session += 1
        clears = [Clear(fault) for fault in Fault]
        ready = (Hello(1, 1, 1), TIGHT, Arm(self.session, fields_crc(TIGHT)))
        self.step(ms, *clears, *ready)
        present = self.bench.out.applied if length is None else length
        self.send(1, np.clip(np.add(present, scale * np.array(way)), LOW, HIGH), self.session)

    def send(self, ms, target, session):
        setpoint = self.bench.setpoint(*target, session=session)
        self.step(ms, setpoint, fresh=setpoint if session == self.session else None)
        if not refusals(self.bench.replies):
            self.accepted.append(encode(setpoint, self.bench.seq))

    @rule(ms=steps, goal=lengths, times=st.integers(1, 5))
    def any_setpoints(self, ms, goal, times):
        for _ in range(times):
            self.send(ms, goal, self.session)

    @rule(ms=st.floats(0.1, 30), way=little_ways, times=st.integers(1, 9))
    def near_setpoints(self, ms, way, times):
        for _ in range(times):
            self.send(ms, np.clip(np.add(self.bench.out.applied, way), LOW, HIGH), self.session)

    @rule(ms=steps, goal=lengths)
    def setpoint_of_another_session(self, ms, goal):
        self.send(ms, goal, self.session + 1)

    @rule(ms=st.floats(0.1, 15), way=little_ways, back=st.integers(1, 5))
    def repeated_setpoint(self, ms, way, back):
        if self.bench.out.state != DeviceState.RUNNING:
            self.start(1.0, None, way, 1)
        self.near_setpoints(ms, way, 2)
        for frame in self.accepted[-back:][:1]:
            self.bench.core.receive(frame)
        self.step(ms)
        self.step(ms)

    @rule(ms=steps, garbage=st.binary(max_size=300))
    def garbage(self, ms, garbage):
        self.bench.core.receive(garbage)
        self.step(ms)

    @rule(ms=steps, end=st.sampled_from((Stop, Disarm, EStop, Ping, Clear)), own=st.booleans())
    def other_orders(self, ms, end, own):
        session = self.session if own else self.session + 1
        fields = {Stop: (session, 0), Disarm: (session,), EStop: (), Ping: (1,), Clear: (1,)}
        self.step(ms, end(*fields[end]))

    @rule(
        ms=steps,
        length=st.none() | lengths,
        force=st.sampled_from((100, 2001, 0)),
        adc=st.sampled_from((2000, 0)),
        vbus=st.sampled_from((6000, 6000, 0)),
        estop=st.sampled_from((False, False, True)),
    )
    def measurements(self, ms, length, force, adc, vbus, estop):
        bench = self.bench
        bench.length, bench.force, bench.adc = length, (100, force, 100), (adc,) * 4
        bench.vbus, bench.estop = vbus, estop
        self.step(ms)

    @rule(ms=steps)
    def all_well(self, ms):
        bench = self.bench
        bench.length, bench.force, bench.adc = None, (100,) * N, (2000,) * 4
        bench.vbus, bench.estop = 6000, False
        self.step(ms)

    @invariant()
    def powered_states_are_running_and_ramping(self):
        out = self.bench.out
        assert out.powered == (out.state in (DeviceState.RUNNING, DeviceState.RAMPING))


TestLink = Link.TestCase
TestLink.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)


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
