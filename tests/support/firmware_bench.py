"""The device's program on a bench: a clock in steps of a millisecond, a host and ideal servos."""

from dataclasses import replace
from zlib import crc32

import pytest

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import Decoder, encode
from softrobot_env.hardware.virtual_robot import CompilerMissingError, Core, Measured, library

try:
    library()
except CompilerMissingError as error:
    pytest.skip(str(error), allow_module_level=True)

N, SESSION = 3, 77
REST = 50
AWAY = (250, 150, 50)

CONFIG = m.Config(
    n=N,
    watchdog_ms=100,
    state_delay_us=2000,
    free_run_ms=50,
    ramp=2000,  # 2 units in a millisecond
    arm_window=100,
    stall_error=300,
    stall_ms=40,
    adc_mask=0b0011,
    adc_low=10,
    adc_high=4085,
    vbus_min=5000,
    center_us=(1500, 1400, 1600),
    gain=(1000, -1000, 500),
    minimum=(-3000,) * N,
    maximum=(3000, 3000, 2500),
    slew=(10000,) * N,  # 10 units in a millisecond
    rest=(REST,) * N,
    max_force=(2000,) * N,
    min_force=(20,) * N,
)


def fields_crc(config):
    return crc32(m.pack(config, 0)[4:])


class Bench:
    """What the board measures can be set: `length` None is that of ideal servos."""

    def __init__(self, now=0, **options):
        self.core = Core(N, **options)
        self.decoder = Decoder()
        self.now, self.seq = now, 0
        self.replies = []
        self.host_clock = 0  # of the host minus that of the device
        self.length, self.force, self.adc, self.vbus = None, (100,) * N, (2000,) * 4, 6000
        self.estop = False

    @property
    def out(self):
        return self.core.outputs

    def run(self, *messages, ms=1, seq=None):
        """A pass after `ms` with these messages; returns what the device answers."""
        self.now += round(1000 * ms)
        for message in messages:
            self.seq += 1
            self.core.receive(encode(message, (self.seq if seq is None else seq) % 2**16))
        length = self.core.outputs.applied if self.length is None else self.length
        measured = Measured(length, self.force, self.adc, self.vbus, self.estop)
        self.core.run(self.now, measured)
        self.replies = [message for message, _ in self.decoder.feed(self.core.transmit())]
        return self.replies

    def wait(self, ms, *, state=None):
        """Passes of a millisecond; with `state`, until the device is in it. Returns all replies."""
        replies = []
        for _ in range(ms):
            replies += self.run()
            if self.out.state == state:
                return replies
        assert state is None, f"{self.out} after {ms} ms"
        return replies

    def setpoint(self, *target, **changes):
        wanted = m.Setpoint(SESSION, (self.now + self.host_clock) % 2**32, 50, 0, N, target)
        return replace(wanted, **changes)

    def hold(self, ms, *target, every=10):
        """Set-points at a steady rate."""
        replies = []
        for _ in range(ms // every):
            replies += self.run(self.setpoint(*target))
            replies += self.wait(every - 1)
        return replies

    def configure(self, config=CONFIG):
        self.run(m.Hello(1, 1, 1))
        return self.run(config)

    def arm(self, config=CONFIG, session=SESSION):
        self.configure(config)
        return self.run(m.Arm(session, fields_crc(config)))

    def start(self, config=CONFIG):
        """Running, at rest."""
        self.arm(config)
        self.run(self.setpoint(*config.rest))
        assert self.out.powered
        return self


def running(config=CONFIG, **options):
    return Bench(**options).start(config)


def away(config=CONFIG, **options):
    """Running, away from rest."""
    bench = running(config, **options)
    bench.hold(50, *AWAY)
    assert bench.out.applied == AWAY
    return bench


def spoil(bench, **measured):
    vars(bench).update(measured)


def of(kind, replies):
    return [message for message in replies if isinstance(message, kind)]


def refusals(replies):
    return [nack.reason for nack in of(m.Nack, replies)]


def faults(replies):
    return [(report.code, report.channel) for report in of(m.FaultReport, replies)]


def states(replies):
    return of(m.State, replies)


def is_off(bench, state):
    """Whether no servo gets a pulse, in this state."""
    out = bench.out
    return not out.powered and out.pulse_us == (0,) * N and out.state == m.DeviceState(state)
