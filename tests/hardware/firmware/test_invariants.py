"""Whatever a host sends and a board measures, a witness sees every pass: outputs stay inside their
limits and slew rates, and nothing but the ramp to rest moves them without a fresh set-point of the
session.
"""

from dataclasses import replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from support.firmware_bench import CONFIG, Bench, N, fields_crc, of
from support.output_witness import WatchedCore

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import encode

#: Narrow limits, so that they are met often.
TIGHT = replace(CONFIG, watchdog_ms=200, minimum=(-300,) * N, maximum=(300, 250, 300))
LOW, HIGH = np.array(TIGHT.minimum), np.array(TIGHT.maximum)
#: The same limits for other servo horns: at the pulses of one, lengths of the other differ.
OTHER = replace(TIGHT, center_us=(1510, 1390, 1605), gain=(800, -1000, -500))

steps = st.floats(0.1, 30) | st.floats(0.1, 250)  # ms
lengths = st.tuples(*[st.integers(-350, 350)] * N)
configs = st.sampled_from((TIGHT, OTHER))
little_ways = st.tuples(*[st.integers(-90, 90)] * N)

#: Other messages than set-points, of a session.
ORDERS = (
    lambda session: m.Stop(session, 0),
    m.Disarm,
    lambda _: m.EStop(),
    lambda _: m.Ping(1),
    lambda _: m.Clear(1),
)


class Link(RuleBasedStateMachine):
    """A host that does anything in any order, over a line that loses, repeats and adds."""

    capabilities = m.Capability.LENGTH | m.Capability.FORCE | m.Capability.ADC | m.Capability.SUPPLY

    def __init__(self):
        super().__init__()
        self.bench = Bench(now=2**32 - 10**6)
        self.bench.core = WatchedCore(capabilities=self.capabilities)
        self.config = TIGHT  # the last that it has accepted
        self.session = 0
        self.moved = False
        self.sent = []  # frames of set-points

    def step(self, ms, *messages):
        """A pass, which the witness judges."""
        bench, before = self.bench, self.bench.out
        bench.run(*messages, ms=ms)
        self.moved |= before.powered
        if acks := of(m.ConfigAck, bench.replies):
            self.check_calibration(before, bench.out, acks[0].crc)

    def check_calibration(self, before, after, crc):
        """Once something has moved, other lengths stand for the same pulses."""
        last = self.pulses_of(np.array(before.applied))
        (self.config,) = [config for config in (TIGHT, OTHER) if fields_crc(config) == crc]
        assert not after.powered
        if self.moved and not before.powered:
            now = self.pulses_of(np.array(after.applied))
            np.testing.assert_allclose(now, last, atol=0.06)  # half of 0.01 mm

    def pulses_of(self, lengths):
        return np.array(self.config.center_us) + np.array(self.config.gain) * lengths / 1e4

    @rule(ms=steps)
    def nothing(self, ms):
        self.step(ms)

    @rule(ms=steps, low=st.integers(0, 2), high=st.integers(0, 2))
    def hello(self, ms, low, high):
        self.step(ms, m.Hello(1, low, high))

    @rule(ms=steps, config=configs)
    def configure(self, ms, config):
        self.step(ms, m.Hello(1, 1, 1), config)

    @rule(ms=steps, config=configs)
    def arm(self, ms, config):
        self.session += 1
        self.step(ms, m.Arm(self.session, fields_crc(config)))

    @rule(
        ms=steps,
        config=configs,
        length=st.none() | lengths,
        way=little_ways,
        scale=st.integers(1, 3),
    )
    def start(self, ms, config, length, way, scale):
        self.all_well(1)
        self.bench.length = length
        self.session += 1
        clears = [m.Clear(fault) for fault in m.Fault]
        ready = (m.Hello(1, 1, 1), config, m.Arm(self.session, fields_crc(config)))
        self.step(ms, *clears, *ready)
        blind = length is None or m.Capability.LENGTH not in self.capabilities
        present = self.bench.out.applied if blind else length
        self.send(1, np.clip(np.add(present, scale * np.array(way)), LOW, HIGH), self.session)

    def send(self, ms, target, session):
        setpoint = self.bench.setpoint(*target, session=session)
        self.step(ms, setpoint)
        self.sent.append(encode(setpoint, self.bench.seq))

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
        if self.bench.out.state != m.DeviceState.RUNNING:
            self.start(1.0, TIGHT, None, way, 1)
        self.near_setpoints(ms, way, 2)
        for frame in self.sent[-back:][:1]:
            self.bench.core.receive(frame)
        self.step(ms)
        self.step(ms)

    @rule(ms=steps, garbage=st.binary(max_size=300))
    def garbage(self, ms, garbage):
        self.bench.core.receive(garbage)
        self.step(ms)

    @rule(ms=steps, order=st.sampled_from(ORDERS), own=st.booleans())
    def other_orders(self, ms, order, own):
        self.step(ms, order(self.session if own else self.session + 1))

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
        self.measurements(ms, None, 100, 2000, 6000, False)

    @invariant()
    def powered_states_are_running_and_ramping(self):
        out = self.bench.out
        assert out.powered == (out.state in (m.DeviceState.RUNNING, m.DeviceState.RAMPING))


class BlindLink(Link):
    """On a board that does not measure lengths."""

    capabilities = m.Capability.FORCE | m.Capability.ADC | m.Capability.SUPPLY


TestLink, TestBlindLink = Link.TestCase, BlindLink.TestCase
TestLink.settings = TestBlindLink.settings = settings(
    max_examples=25, stateful_step_count=40, deadline=None
)
