"""The threaded driver, over memory, in real time."""

import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.hardware_boards import Board, LiveBoard

from softrobot_env.hardware.driver import Driver, ExitGuard
from softrobot_env.hardware.errors import (
    LinkError,
    RefusedError,
    RobotError,
    RobotFaultError,
    SessionLostError,
)
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import encode
from softrobot_env.hardware.robot_file import rig_file

pytestmark = pytest.mark.realtime(late=0.5)

HERE = [0.0, 0.0, 0.0]

#: A busy computer may keep a thread waiting for longer than the usual 0.1 s.
PATIENT = replace(rig_file(), watchdog=0.8, ttl=0.5, ramp=0.1)


@pytest.fixture
def live():
    with LiveBoard() as board:
        yield board


@pytest.fixture
def driver(live):
    with Driver(PATIENT, live.transport) as found:
        found.connect()
        yield found


class Breakable:
    """A transport that breaks when told to.

    Attributes:
        deaf, dumb: Whether reading or writing is broken.
        closed: How often it was closed.
    """

    def __init__(self, transport):
        self._transport = transport
        self.deaf = self.dumb = False
        self.closed = 0

    def read(self, timeout):
        if self.deaf:
            raise LinkError("/dev/robot has gone")
        return self._transport.read(timeout)

    def write(self, data):
        if self.dumb:
            raise LinkError("cannot write to /dev/robot")
        self._transport.write(data)

    def close(self):
        self.closed += 1


def elapsed(action):
    start = time.monotonic()
    action()
    return time.monotonic() - start


def test_connecting_leaves_a_robot_off(live, driver):
    assert driver.info.firmware and driver.reading.state == m.DeviceState.DISARMED
    assert not live.board.core.outputs.powered


def test_a_set_point_is_followed_and_answered(driver):
    driver.arm()
    reading = driver.wait_for(driver.command([1e-4, 0.0, -1e-4]), time.monotonic() + 1)
    np.testing.assert_allclose(reading.applied, [1e-4, 0.0, -1e-4])
    assert 0 < reading.round_trip < 1 and driver.link["round_trip"] is not None


def test_a_slow_move_takes_its_time(driver):
    driver.arm()
    duration = elapsed(lambda: driver.move_to([5e-3, 0.0, -2.5e-3], speed=0.05, timeout=3))
    np.testing.assert_allclose(driver.reading.applied, [5e-3, 0.0, -2.5e-3])
    assert duration > 0.08


def test_a_move_out_of_range_does_not_begin(driver):
    driver.arm()
    with pytest.raises(ValueError, match="tendon 1"):
        driver.move_to([0.04, 0.0, 0.0], speed=0.05, timeout=1)
    with pytest.raises(ValueError, match="speed must be positive"):
        driver.move_to(HERE, speed=0.0, timeout=1)
    assert driver.reading.applied.tolist() == HERE


def test_a_move_that_takes_too_long_is_told(driver):
    driver.arm()
    with pytest.raises(RobotError, match=r"not come to its target within 0\.1 s"):
        driver.move_to([0.02, 0.0, 0.0], speed=0.02, timeout=0.1)


def test_nobody_answers_in_time(live):
    live.alive.clear()
    driver = Driver(PATIENT, live.transport)
    with driver, pytest.raises(LinkError, match="has not answered HELLO in time"):
        driver.connect(0.15)


def test_wait_for_ends_at_the_deadline(live, driver):
    driver.arm()
    live.alive.clear()
    seq = driver.command(HERE)
    assert driver.wait_for(seq, time.monotonic() + 0.05) is None


def test_an_emergency_stop_cuts_and_is_cleared_by_hand_only(live, driver):
    driver.arm()
    driver.estop()
    assert driver.wait_for_fault(1.0).code == m.Fault.ESTOP
    assert not live.board.core.outputs.powered
    with pytest.raises(RobotFaultError, match="emergency stop; clear it"):
        driver.command(HERE)
    with pytest.raises(RobotFaultError):
        driver.arm()
    driver.clear()
    assert driver.fault is None and not live.board.core.outputs.powered
    driver.arm()
    assert live.board.core.outputs.powered


def test_a_fault_whose_cause_is_there_cannot_be_cleared(live, driver):
    live.board.estop = True
    driver.wait_for_fault(1.0)
    with pytest.raises(RefusedError, match="refuses CLEAR: a fault is latched"):
        driver.clear()


def test_a_fault_that_was_there_before_is_known_after_connecting(live, driver):
    driver.estop()
    driver.wait_for_fault(1.0)
    driver.connect()
    assert driver.fault.code == m.Fault.ESTOP


def test_a_position_far_outside_the_range_is_not_armed(live, driver):
    live.board.position = (3300, 0, 0)
    while driver.reading.length[0] < 0.033:
        time.sleep(0.01)
    with pytest.raises(RefusedError, match="refuses SETPOINT: too far") as caught:
        driver.arm()
    assert caught.value.reason == m.Reason.FAR
    assert not live.board.core.outputs.powered


def test_a_stop_ramps_to_rest(live, driver):
    driver.arm()
    driver.move_to([5e-3, 0.0, 0.0], speed=0.1, timeout=3)
    assert elapsed(driver.stop) > 0.03
    outputs = live.board.core.outputs
    assert outputs.applied == (0, 0, 0) and not outputs.powered


def test_a_restart_surfaces_and_connecting_again_helps(live, driver):
    driver.arm()
    live.board.core = Board(boot_id=9).core
    with pytest.raises(LinkError):
        for _ in range(100):
            driver.pace(HERE, time.monotonic() + 0.02)
    with pytest.raises(SessionLostError, match="boot 00000001, now 00000009"):
        driver.wait_for(0, time.monotonic() + 2)
    assert driver.connect().boot_id == 9
    driver.arm()


def test_what_breaks_while_listening_is_raised_by_the_next_call(live):
    transport = Breakable(live.transport)
    with Driver(PATIENT, transport) as driver:
        driver.connect()
        driver.arm()
        transport.deaf = True
        with pytest.raises(LinkError, match="/dev/robot has gone"):
            driver.wait_for(driver.command(HERE) + 1, time.monotonic() + 1)
        with pytest.raises(LinkError, match="/dev/robot has gone"):
            driver.command(HERE)


def test_what_nobody_understands_is_told(live, driver):
    numbers = {"applied": (0,) * 3, "length": (0,) * 3, "force": (0,) * 3, "adc": (0,) * 4}
    counts = {"vbus": 6000, "crc_errors": 0, "frame_errors": 0, "faults": 0, "warnings": 0}
    state = m.State(0, 0, 0, state=9, n=3, session=0, **numbers, **counts)
    live.inject(encode(state, 1000))
    with pytest.raises(RobotError, match="cannot understand the robot: 9 is not"):
        driver.wait_for(1, time.monotonic() + 5)


def test_a_pace_waits_for_a_robot_that_is_slow_to_answer(live, driver):
    driver.arm()
    live.alive.clear()
    answers = [driver.pace(HERE, time.monotonic() + 0.005) for _ in range(6)]
    assert answers == [None] * 6
    live.alive.set()
    end = time.monotonic() + 5
    while driver.pace(HERE, time.monotonic() + 0.02) is None:
        assert time.monotonic() < end


def test_a_pace_does_not_wait_for_a_silent_robot(live, driver):
    driver.arm()
    live.alive.clear()
    with pytest.raises(LinkError, match=r"said nothing for 0\.5 s"):
        for _ in range(200):
            driver.pace(HERE, time.monotonic() + 0.02)


def test_closing_stops_the_robot_and_happens_once(live):
    transport = Breakable(live.transport)
    driver = Driver(PATIENT, transport)
    driver.connect()
    driver.arm()
    driver.close()
    assert not live.board.core.outputs.powered
    driver.close()
    assert transport.closed == 1
    with pytest.raises(LinkError, match="closed"):
        driver.connect()


def test_closing_a_dead_robot_is_bounded(live, driver):
    """Its ramp, from where it stands, and the answer to a stop: about a second."""
    driver.arm()
    live.alive.clear()
    assert elapsed(driver.close) < 20


def test_closing_goes_on_when_a_stage_fails(live):
    transport = Breakable(live.transport)
    driver = Driver(PATIENT, transport)
    driver.connect()
    driver.arm()
    transport.dumb = True
    driver.close()
    assert transport.closed


class Unwritable(Breakable):
    """A transport whose port fails in the way of the operating system."""

    def write(self, data):
        if self.dumb:
            raise OSError("no such device")
        super().write(data)


def test_closing_goes_on_when_the_system_fails(live):
    transport = Unwritable(live.transport)
    driver = Driver(PATIENT, transport)
    driver.connect()
    driver.arm()
    transport.dumb = True
    driver.close()
    assert transport.closed


def test_a_forked_child_leaves_the_robot_to_its_parent():
    program = """
        import os, signal, sys
        from softrobot_env.hardware.driver import ExitGuard
        ExitGuard(lambda: print("closed", flush=True)).install()
        for end in (lambda: signal.raise_signal(signal.SIGTERM), lambda: sys.exit(3)):
            child = os.fork()
            if child == 0:
                end()
            os.waitpid(child, 0)
        print("children are gone", flush=True)
    """
    assert run_program(program).stdout == "children are gone\nclosed\n"


def test_the_guard_may_be_installed_again_by_another_thread():
    program = """
        import signal, threading
        from softrobot_env.hardware.driver import ExitGuard
        guard = ExitGuard(lambda: print("closed", flush=True))
        guard.install()
        thread = threading.Thread(target=guard.install)
        thread.start()
        thread.join()
        print("installed", flush=True)
        signal.raise_signal(signal.SIGTERM)
    """
    ended = run_program(program)
    assert (ended.stdout, ended.stderr) == ("installed\nclosed\n", "")


def run_program(text):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(text)],
        cwd=Path(__file__).parents[1],  # for tests/support
        capture_output=True,
        text=True,
    )


def test_the_guard_gives_its_signal_back():
    calls = []
    before = signal.signal(signal.SIGTERM, lambda *_: calls.append("previous"))
    try:
        previous = signal.getsignal(signal.SIGTERM)
        guard = ExitGuard(lambda: calls.append("closed"))
        guard.install()
        signal.raise_signal(signal.SIGTERM)
        assert calls == ["closed", "previous"]
        assert signal.getsignal(signal.SIGTERM) is previous
        guard.remove()
        assert signal.getsignal(signal.SIGTERM) is previous
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("how", ["signal.raise_signal(signal.SIGTERM)", "sys.exit(3)"])
def test_a_program_that_ends_stops_its_robot(how):
    program = f"""
        import signal, sys
        from support.hardware_boards import LiveBoard
        from softrobot_env.hardware.robot_file import rig_file
        from softrobot_env.hardware.driver import Driver
        board = LiveBoard().__enter__()
        driver = Driver(rig_file(), board.transport)
        close, driver._transport.close = driver._transport.close, lambda: print(
            "off" if not board.board.core.outputs.powered else "on", flush=True)
        driver.connect()
        driver.arm()
        {how}
    """
    ended = run_program(program)
    assert ended.stdout == "off\n", ended.stderr
    assert ended.returncode in (3, -signal.SIGTERM)
