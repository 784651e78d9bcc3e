"""A bench whose lines do harm, for the fault matrix."""

from contextlib import suppress

import numpy as np
from support.hardware_boards import PASS, Bench, Board
from support.output_witness import WatchedCore
from support.serial_proxy import Harm, Line

from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.robot_file import virtual_file

HERE, THERE, FAR = (0.0, 0.0, 0.0), (8e-3, -4e-3, 0.0), (25e-3, 0.0, 0.0)
PERIOD = 0.02  # s

ROBOT = virtual_file()
#: Longest time [s] from the last fresh set-point to the power's end, anywhere up to `THERE`.
STOPPED = ROBOT.watchdog + max(THERE) / ROBOT.ramp + 0.01


class Rough(Bench):
    """A bench whose lines do harm, and whose board is watched; running.

    Attributes:
        up, down: The lines to and from the board.
        asleep: Whether the board's program stands still.
        reads: Whether the host takes what the board sends.
    """

    def __init__(self, robot=ROBOT, seed=0):
        board = Board()
        board.core = WatchedCore()
        super().__init__(robot, board)
        self.up, self.down = Line(seed), Line(seed + 1)
        self.asleep, self.reads = False, True
        self.connect()
        self.arm()

    @property
    def core(self):
        return self.board.core

    @property
    def out(self):
        return self.core.outputs

    def say(self, frame, wait=0.0):
        self.up.put(frame, self.now)
        self.run(wait)

    def run(self, duration):
        for _ in range(max(1, round(duration / PASS))):
            self.now += PASS
            self.core.receive(self.up.take(self.now))
            if not self.asleep:
                self.board.run(self.now)
            if self.reads:
                self.down.put(self.core.transmit(), self.now)
            self.up.put(self.session.receive(self.down.take(self.now), self.now), self.now)

    def drive(self, length, duration):
        """Command a length, period by period, whatever the robot says."""
        for _ in range(round(duration / PERIOD)):
            with suppress(RobotError):
                self.up.put(self.session.setpoint(np.array(length), self.now)[1], self.now)
            self.run(PERIOD)

    def harm(self, **shares):
        self.up.harm = self.down.harm = Harm(**shares)

    def nacks(self):
        return self.session.link.as_dict()["nacks"]


def counts(length):
    return tuple(round(x / m.LENGTH_UNIT) for x in length)


def assert_off(bench):
    out = bench.out
    assert not out.powered and out.pulse_us == (0, 0, 0)


def assert_stays_off(bench):
    """Neither time nor the host's next set-points bring the power back."""
    assert_off(bench)
    for _ in range(10):
        bench.drive(THERE, PERIOD)
        assert_off(bench)
