"""The real rig's environment with a board in memory: losses, ages, and ends."""

import gc
import os
from contextlib import closing, contextmanager
from dataclasses import replace
from threading import Thread
from time import monotonic, sleep

import numpy as np
import pytest
from support.hardware_boards import Board, LiveBoard
from support.real_episodes import PATIENT, Still

from softrobot_env.envs.real import RealRigEnv
from softrobot_env.hardware.errors import LinkError, RefusedError, RobotFaultError
from softrobot_env.hardware.robot_file import Tip, rig_file
from softrobot_env.hardware.tip import UdpTip

pytest.importorskip("cobs", reason="needs the robot extra")

pytestmark = [pytest.mark.realtime(late=0.4), pytest.mark.usefixtures("patience")]

#: Other programs may load the machine: only what a test breaks may make a robot stop.
FILE = replace(rig_file(), watchdog=0.9, ttl=0.4)


class Line:
    """A transport that can be delayed.

    Attributes:
        opened, closed: How often.
        written: Number of bytes to the robot.
        delay: [s] that bytes of the robot take.
    """

    def __init__(self, transport):
        self._transport = transport
        self.opened = self.closed = self.written = 0
        self.delay, self._held = 0.0, []

    def __call__(self):
        self.opened += 1
        return self

    def read(self, timeout):
        data, now = self._transport.read(min(timeout, 0.005)), monotonic()
        self._held += [(now, data)] if data else []
        due = [data for came, data in self._held if now - came >= self.delay]
        self._held = self._held[len(due) :]
        return b"".join(due)

    def write(self, data):
        self._transport.write(data)
        self.written += len(data)

    def close(self):
        self.closed += 1


@pytest.fixture
def live():
    with LiveBoard(Board()) as live:
        yield live


@pytest.fixture
def line(live):
    return Line(live.transport)


@contextmanager
def running(line, **options):
    with closing(RealRigEnv(robot_file=FILE, line=line, tip=Still(), **PATIENT | options)) as env:
        env.reset()
        rest(env)
        yield env


def rest(env):
    return env.step(np.zeros(3, dtype=np.float32))


def fail(env):
    """Step until the episode ends; why it did."""
    ends = (rest(env) for _ in range(200))
    return next(info["failure"] for *_, truncated, info in ends if truncated)


def clear(env):
    return env.reset(options={"clear_fault": True})


def assert_runs(env):
    assert rest(env)[4]["device_state"] == "running"


def test_clearing_what_is_still_there_is_refused(line, live):
    with running(line) as env:
        live.board.estop = True
        assert "emergency" in fail(env)
        with pytest.raises(RefusedError):
            clear(env)
        live.board.estop = False
        clear(env)
        assert_runs(env)
    assert line.opened == 1


def test_a_tip_source_that_does_not_open_leaves_the_robot_alone(line):
    with closing(UdpTip(0)) as other:
        file = replace(FILE, tip=Tip("udp", {"port": other.port}))
        env = RealRigEnv(robot_file=file, line=line)
        with pytest.raises(LinkError, match="tip source does not open"):
            env.reset()
    assert line.opened == 0
    env.close()


def held(line):
    """An environment in an episode, in a list that alone refers to it."""
    env = RealRigEnv(robot_file=FILE, line=line, tip=Still(), **PATIENT)
    env.reset()
    rest(env)
    return [env]


def test_an_environment_that_is_dropped_is_closed(line, live):
    held(line).clear()
    gc.collect()
    assert line.closed == 1
    assert not live.board.core.outputs.powered


def test_an_environment_that_another_thread_drops_is_closed(line, live):
    thread = Thread(target=held(line).clear)
    thread.start()
    thread.join()
    end = monotonic() + 10
    while not line.closed:
        assert monotonic() < end
        sleep(0.01)
    assert not live.board.core.outputs.powered


def test_a_child_that_drops_its_copy_leaves_the_robot_alone(line, live, monkeypatch):
    """It is not told anything; a slow collection of garbage lets its watchdog stop it."""
    holder = held(line)
    opened, written = holder[0]._session._opened, line.written
    with monkeypatch.context() as child:
        child.setattr(os, "getpid", lambda: -1)
        holder.clear()
        gc.collect()
    assert line.closed == 0 and line.written == written
    opened.close()


def test_a_missing_answer_has_no_round_trip(line, live):
    with running(line) as env:
        answered = rest(env)[4]
        live.alive.clear()
        sleep(0.05)  # what the board has sent is read
        ages = [rest(env)[4] for _ in range(3)]
        live.alive.set()
    assert answered["rtt_s"] >= FILE.state_delay
    assert all(np.isnan(info["rtt_s"]) for info in ages)
    assert ages[-1]["obs_age_s"] > 2 * FILE.control_period


def test_a_backlog_of_the_line_counts_as_age(line):
    with running(line) as env:
        before = [rest(env)[4]["obs_age_s"] for _ in range(5)]
        line.delay = 0.3
        after = [rest(env)[4]["obs_age_s"] for _ in range(30)]
    assert min(before) < 0.1 and after[-1] > 0.25


def test_an_emergency_stop_that_is_interrupted_ends_the_episode_too(line, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    with running(line) as env:
        with monkeypatch.context() as patched:
            patched.setattr(env._clock, "finish", lambda: 1 / 0)
            patched.setattr(env._session, "emergency_stop", interrupt)
            with pytest.raises(KeyboardInterrupt):
                rest(env)
        with pytest.raises(RobotFaultError, match="emergency"):
            rest(env)


def test_a_failed_step_tells_how_late_it_was(line):
    with running(line, max_missed=1) as env:
        sleep(0.2)
        *_, truncated, info = rest(env)
        assert truncated and "missed" in info["failure"] and info["lateness_s"] > 0.1
