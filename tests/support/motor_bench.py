"""Emulated motors on a virtual clock, and a witness of what they drive."""

from dataclasses import replace

import numpy as np

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.motor_file import usual_motors
from softrobot_env.hardware.registry import kind_of, open_hardware

TENDONS = ("a", "b", "c")
PASS = 1e-3  # s


def motor_file(kind, **changes):
    """Three motors with limits that nothing usual reaches."""
    file = usual_motors(kind, "/dev/motors", TENDONS, (0.02,) * 3, 0.05)
    motors = tuple(replace(m, max_current=1.0, torque_constant=1.0) for m in file.motors)
    return replace(file, motors=motors, **{"patience": 0.05, "supply": 9.0} | changes)


class Springs:
    """Tendons that pull as far as they are wound; see `virtual_robot.Plant`."""

    tick, picture = PASS, None

    def __init__(self, count, stiffness=1000.0):
        self.length, self._stiffness = np.zeros(count), stiffness

    @property
    def tension(self):
        return np.maximum(0.0, self._stiffness * self.length)

    def advance(self, command):
        self.length = np.array(command)


class Witness:
    """Counts outputs that leave the range, are faster than allowed, or move when they must not.

    Attributes:
        unsafe: What was wrong, as texts.
    """

    def __init__(self, file):
        self.low, self.high, _ = np.array(file.tendons).T
        self.slew, self.unsafe, self._before, self.moved = file.slew, [], None, -np.inf

    def see(self, now, applied):
        if np.any((applied < self.low - 2e-5) | (applied > self.high + 2e-5)):
            self.unsafe.append(f"out of range at {now:.3f}: {applied}")
        if self._before is not None:
            then, before = self._before
            way = float(np.abs(applied - before).max())
            if way > 1.2 * self.slew * (now - then) + 2e-5:
                self.unsafe.append(f"too fast at {now:.3f}: {way / max(now - then, 1e-9):.3f} m/s")
            if way > 2e-6:
                self.moved = now
        self._before = now, applied.copy()


class MotorBench:
    """A transport to emulated motors, in one thread and on a clock of its own.

    Attributes:
        device: The motors.
        now: [s].
        plugged: Whether the line is there.
        witness: See `Witness`.
    """

    def __init__(self, file, start=10.0):
        self.file, self.now, self.plugged = file, start, True
        self.device = kind_of(file).device(file)
        self.plant, self.witness = Springs(len(file.tendons)), Witness(file)
        self._arrived, self.closed = b"", 0
        self.robot = open_hardware(file, self)
        self.robot._now = self.robot._bus.port._now = lambda: self.now
        self.robot._sleep = self.run

    def run(self, duration):
        end = self.now + duration
        while self.now < end - 1e-9:
            self.now = min(end, self.now + PASS)
            self._pass()

    def _pass(self):
        self.device.run(self.now, self.plant)
        self._arrived += self.device.transmit() if self.plugged else self.device.transmit()[:0]
        self.plant.advance(self.device.command)
        self.witness.see(self.now, self.device.applied)

    def read(self, timeout):
        self._check()
        end = self.now + timeout
        while not self._arrived and self.now < end:
            self.run(min(PASS, end - self.now))
        data, self._arrived = self._arrived, b""
        return data

    def write(self, data):
        self._check()
        self.device.receive(data)

    def close(self):
        self.closed += 1

    def _check(self):
        if not self.plugged:
            raise LinkError("/dev/motors has gone")

    def start(self):
        """Connected and armed."""
        self.robot.connect()
        self.robot.arm()
        return self

    def go(self, length, seconds):
        """Command a length of all tendons for a while."""
        due = self.now
        for _ in range(round(seconds / self.file.control_period)):
            due = max(due, self.now) + self.file.control_period
            self.robot.pace(np.full(len(self.file.tendons), length), due)
