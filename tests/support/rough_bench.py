"""A bench whose lines do harm, for the fault matrix."""

from contextlib import suppress

import numpy as np
from support.hardware_boards import Bench, Board
from support.output_witness import WatchedCore
from support.rough_lines import Harm

from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.robot_file import virtual_file

HERE, THERE = (0.0, 0.0, 0.0), (8e-3, -4e-3, 0.0)
PERIOD = 0.02  # s

ROBOT = virtual_file()
#: Longest time [s] from the last fresh set-point to the power's end, anywhere up to `THERE`.
STOPPED = ROBOT.watchdog + max(THERE) / ROBOT.ramp + 0.01


class Rough(Bench):
    """A bench that runs, whose lines may do harm, and whose board is watched."""

    def __init__(self, robot=ROBOT, seed=0):
        super().__init__(robot, Board(core=WatchedCore()), seed=seed)
        self.start()

    @property
    def core(self):
        return self.board.core

    @property
    def out(self):
        return self.core.outputs

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
