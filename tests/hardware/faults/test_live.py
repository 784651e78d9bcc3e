"""The fault matrix over a pseudo-terminal, in real time; see `test_matrix`."""

from contextlib import suppress
from copy import copy
from time import monotonic, sleep

import numpy as np
import pytest
from support.hardware_boards import Board, LiveBoard, RoughTerminal
from support.output_witness import WatchedCore
from support.real_episodes import (
    FILE,
    PERIOD,
    assert_comes_to_rest,
    assert_runs_again,
    fail,
    pull,
    running,
)
from support.rough_lines import KINDS, Harm

from softrobot_env.hardware.driver import Driver
from softrobot_env.hardware.errors import LinkError, UnansweredError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.session import MOST_IN_FLIGHT
from softrobot_env.hardware.transport import SerialTransport

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("cobs", reason="needs the robot extra")

pytestmark = [
    pytest.mark.timeout(60),
    pytest.mark.realtime(late=0.4),
    pytest.mark.usefixtures("patience"),
]

THERE = np.array([4e-3, -2e-3, 0.0])


@pytest.fixture
def robot():
    with RoughTerminal(Board(core=WatchedCore())) as robot:
        yield robot


@pytest.fixture
def core(robot):
    return robot.board.core


@pytest.fixture
def driver(robot):
    with Driver(FILE, SerialTransport(robot.port, FILE.baud)) as driver:
        driver.connect(timeout=10)
        driver.arm(timeout=10)
        yield driver


def drive(driver, length, done, limit=10.0):
    """Command a length until something is so."""
    end = monotonic() + limit
    while not done():
        assert monotonic() < end
        with suppress(UnansweredError):
            driver.pace(length, monotonic() + PERIOD)


def is_at(core, length):
    return core.outputs.powered and np.allclose(1e-5 * np.array(core.outputs.applied), length)


def test_all_harm_at_once_is_survived(driver, robot, core):
    """And then frames that come in pieces."""
    lines = (robot.to_robot, robot.from_robot)
    for line in lines:
        line.harm = Harm(**dict.fromkeys(KINDS, 0.1), held=0.02, garbage=50)
    drive(driver, THERE, lambda: all(line.done[kind] >= 5 for line in lines for kind in KINDS))
    for line in lines:
        line.harm = Harm(piece=8)
    drive(driver, THERE, lambda: is_at(core, THERE))
    assert driver.fault is None


# ---------------------------------------------------------------------- the environment


def setpoints(core):
    """How many set-points have reached the robot."""
    return sum(isinstance(message, m.Setpoint) for message in core.heard)


def test_a_lost_line_ends_the_episode_and_can_be_plugged_again(robot, core):
    with running(lambda: SerialTransport(robot.port, FILE.baud), core) as env:
        robot.unplug()
        assert robot.port in fail(env)  # reading or writing notices first
        assert_comes_to_rest(core)
        with pytest.raises(LinkError):
            env.reset(options={"clear_fault": True})
        assert not core.outputs.powered
        robot.plug()
        assert_runs_again(env, core)


def test_a_peer_that_does_not_read_ends_the_episode(robot, core):
    port = SerialTransport(robot.port, FILE.baud)
    with running(lambda: port, core) as env:
        robot.reads.clear()
        with pytest.raises(LinkError):  # the system's buffer is full
            port.write(bytes(1 << 20))
        failure = fail(env)  # the host's system or the robot notices first
        assert "cannot write" in failure or "no set-point" in failure
        assert_comes_to_rest(core)
        followed = len(core.witness.followed)
        robot.reads.set()
        sleep(0.2)
        assert not core.outputs.powered and len(core.witness.followed) == followed


def test_a_stalled_device_ends_the_episode(robot, core):
    with running(lambda: SerialTransport(robot.port, FILE.baud), core, oldest=0.2) as env:
        heard, followed = setpoints(core), len(core.witness.followed)
        robot.alive.clear()
        assert "microcontroller" in fail(env, within=5.0)
        sleep(FILE.watchdog)
        robot.alive.set()
        assert_comes_to_rest(core)
        assert heard < setpoints(core) <= heard + MOST_IN_FLIGHT + 1
        assert len(core.witness.followed) <= followed + 1
        assert_runs_again(env, core)


# ---------------------------------------------------------------- with a board in memory


@pytest.fixture
def live():
    """A board in memory; a copy of its transport is a line that nobody has closed."""
    with LiveBoard(Board(core=WatchedCore())) as live:
        yield live


def line(live):
    return lambda: copy(live.transport)


def test_a_slow_host_sends_no_burst(live):
    core = live.board.core
    with running(line(live), core) as env:
        *_, info = pull(env)
        missed, followed = info["missed_steps"], len(core.witness.followed)
        sleep(10 * PERIOD)
        for _ in range(10):
            *_, info = pull(env)
        assert info["missed_steps"] >= missed + 9 and info["device_state"] == "running"
        assert followed < len(core.witness.followed) <= followed + 11


def test_a_slow_host_is_stopped(live):
    with running(line(live), live.board.core, max_missed=10) as env:
        sleep(20 * PERIOD)
        assert "missed" in fail(env)
        assert_comes_to_rest(live.board.core)


def test_a_restart_ends_the_episode_and_the_board_can_run_again(live):
    with running(line(live), live.board.core) as env:
        core = live.board.core = WatchedCore(boot_id=2, reset_cause=m.Reset.BROWN_OUT)
        failure = fail(env)
        for reported in ("brown-out", "boot 00000001", "now 00000002"):
            assert reported in failure
        sleep(1.2 * FILE.watchdog)
        assert not core.outputs.powered and not core.witness.followed
        assert core.outputs.state == m.DeviceState.DISARMED
        assert_runs_again(env, core)
