"""Emulated motors on a virtual clock, and a witness of what they drive."""

from dataclasses import replace

import numpy as np
from support.rough_lines import Harm, Line

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.motor_file import usual_motors
from softrobot_env.hardware.registry import kind_of, open_hardware
from softrobot_env.hardware.transport import WRITE_TIMEOUT

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
    """Notes outputs that leave the range, are faster than allowed, or move when they must not.

    They may move until the watchdog's time, a control period and `late` have passed since the host
    has last sent goals.

    Attributes:
        unsafe: What was wrong, as texts.
        spoke: When the host has last sent goals [s].
        late: How long the line holds them back [s].
        moved: When outputs have last moved [s].
    """

    def __init__(self, file):
        self.low, self.high, _ = np.array(file.tendons).T
        self.slew, self.unsafe, self._before = file.slew, [], None
        self.spoke = self.moved = -np.inf
        self.late, self._patience = 0.0, file.watchdog + file.control_period

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
                if now - self.spoke > self._patience + self.late:
                    self.unsafe.append(f"moved at {now:.3f}, last goals at {self.spoke:.3f}")
        self._before = now, applied.copy()


class Motors:
    """Emulated motors with springs for tendons, and their witness; see `hardware_boards.LiveBoard`.

    Attributes:
        device: The motors.
        witness: See `Witness`.
    """

    def __init__(self, file, look=0.0):
        """Motors as a file says; the witness looks after this time [s] again."""
        self.device, self.plant = kind_of(file).device(file), Springs(len(file.tendons))
        self.witness, self.core, self._look, self._seen = Witness(file), self.device, look, 0.0

    def run(self, now):
        self.device.run(now, self.plant)
        self.plant.advance(self.device.command)
        if now - self._seen >= self._look:
            self.witness.see(now, self.device.applied)
            self._seen = now


class MotorBench(Motors):
    """A transport to emulated motors, in one thread and on a clock of its own.

    Attributes:
        now: [s].
        plugged, taken: Whether the line is there, and whether somebody takes what is written.
        asleep: Whether the motors stand still and what is sent to them waits.
        up, down: The lines to and from the motors.
    """

    def __init__(self, file, start=10.0):
        super().__init__(file)
        self.file, self.now = file, start
        self.plugged, self.taken, self.asleep = True, True, False
        self.up, self.down = Line(0), Line(1)
        if file.kind == "odrive":  # adapters of CAN drop what is damaged
            self.up._flipped = self.down._flipped = lambda frame: b""
        self._arrived, self.closed = b"", 0
        self.robot = self.host()

    def host(self):
        """Another program that drives the motors by this line."""
        robot = open_hardware(self.file, self)
        robot._now = robot._bus.port._now = lambda: self.now
        robot._sleep = self.run_for
        send = robot._bus.write

        def write(angles):
            self.witness.spoke = self.now
            send(angles)

        robot._bus.write = write
        return robot

    def run_for(self, duration):
        end = self.now + duration
        while self.now < end - 1e-9:
            self.now = min(end, self.now + PASS)
            if not self.asleep:
                self._pass()

    def _pass(self):
        self.device.receive(self.up.take(self.now))
        self.run(self.now)
        sent = self.device.transmit()
        if sent:
            self.down.packet(sent, self.now)
        if self.plugged:
            self._arrived += self.down.take(self.now)

    def read(self, timeout):
        self._check()
        end = self.now + timeout
        while not self._arrived and self.now < end:
            self.run_for(PASS)
        data, self._arrived = self._arrived, b""
        return data

    def write(self, data):
        self._check()
        if not self.taken:
            self.run_for(WRITE_TIMEOUT)
            raise LinkError("nobody takes the bytes")
        self.up.packet(data, self.now)

    def close(self):
        self.closed += 1

    def _check(self):
        if not self.plugged:
            raise LinkError("/dev/motors has gone")

    def harm(self, **shares):
        """What happens to packets both ways from now on."""
        self.up.harm = self.down.harm = Harm(**shares)

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
