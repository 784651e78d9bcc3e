"""Episodes of the real rig's environment that tests break."""

import copy
from contextlib import closing, contextmanager
from dataclasses import replace
from time import monotonic, sleep

import numpy as np
import pytest
from support.hardware_boards import LiveBoard
from support.patience import patient_drivers

from softrobot_env.envs.real import RealRigEnv
from softrobot_env.hardware.errors import RobotFaultError
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.hardware.tip import TipMeasurement

PERIOD = 0.01  # s

#: Other programs may load the machine: only what a test breaks may make a robot stop.
FILE = replace(rig_file(), control_period=PERIOD, state_delay=2e-3, watchdog=0.9, ttl=0.4, ramp=0.1)


#: As they may load it.
PATIENT = {"max_missed": 10_000, "oldest": 2.0}


class Still:
    """A tip that stands still; see `tip.TipSource`."""

    def latest(self, adc, time):
        return TipMeasurement(monotonic(), np.zeros(2))

    def close(self):
        pass


@contextmanager
def live_rig(make, **options):
    """An environment that `make` makes with a board in memory, which needs no clock."""
    pytest.importorskip("cobs", reason="needs the robot extra")
    with LiveBoard() as live, patient_drivers():
        own = {"robot_file": FILE, "line": lambda: copy.copy(live.transport), "tip": Still()}
        with closing(make(**own, **PATIENT, **options)) as env:
            yield env


@contextmanager
def running(line, core, **options):
    """An environment away from rest."""
    with closing(RealRigEnv(robot_file=FILE, line=line, tip=Still(), **PATIENT | options)) as env:
        env.reset()
        while core.outputs.applied[0] < 50:
            assert pull(env)[4]["device_state"] == "running"
        yield env


def pull(env):
    return env.step(np.array([0.2, -0.1, 0.0], dtype=np.float32))


def fail(env, within=3.0):
    """Step until the episode ends, at the latest after so many seconds; why it did."""
    begin = monotonic()
    terminated = truncated = False
    while not truncated:
        *_, terminated, truncated, info = pull(env)
        assert not terminated and monotonic() - begin < within
    with pytest.raises(RobotFaultError):
        pull(env)
    with pytest.raises(RobotFaultError):
        env.reset()
    return info["failure"]


def assert_comes_to_rest(core):
    end = monotonic() + 10 * FILE.watchdog
    while core.outputs.powered:
        assert monotonic() < end
        sleep(PERIOD)
    assert core.outputs.applied == core.outputs.pulse_us == (0, 0, 0)


def assert_runs_again(env, core):
    env.reset(options={"clear_fault": True})
    assert not core.outputs.powered
    assert pull(env)[4]["device_state"] == "running" and core.outputs.powered
