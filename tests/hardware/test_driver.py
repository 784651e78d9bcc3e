"""The threaded driver, over memory, in real time."""

import signal
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.hardware_boards import LiveBoard, state
from support.processes import finished

from softrobot_env.hardware.driver import Driver, ExitGuard
from softrobot_env.hardware.errors import LinkError, RefusedError, RobotError, RobotFaultError
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


def breaks(error):
    """What takes the place of reading or writing on a line that is broken."""

    def act(*_):
        raise error

    return act


@pytest.fixture
def driver(live):
    with Driver(PATIENT, live.transport) as found:
        found.connect()
        yield found


@pytest.fixture
def armed(driver):
    driver.arm()
    return driver


def elapsed(action):
    start = time.monotonic()
    action()
    return time.monotonic() - start


def test_a_set_point_is_followed_and_answered(armed):
    reading = armed.wait_for(armed.command([1e-4, 0.0, -1e-4]), time.monotonic() + 1)
    np.testing.assert_allclose(reading.applied, [1e-4, 0.0, -1e-4])
    assert 0 < reading.round_trip < 1 and armed.link["round_trip"] is not None


def test_a_slow_move_takes_its_time(armed):
    duration = elapsed(lambda: armed.move_to([5e-3, 0.0, -2.5e-3], speed=0.05, timeout=3))
    np.testing.assert_allclose(armed.reading.applied, [5e-3, 0.0, -2.5e-3])
    assert duration > 0.08


@pytest.mark.parametrize(
    ("target", "speed", "error", "complaint"),
    [
        ([0.04, 0.0, 0.0], 0.05, ValueError, "tendon 1"),
        (HERE, 0.0, ValueError, "speed must be positive"),
        ([0.02, 0.0, 0.0], 0.02, RobotError, r"not come to its target within 0\.1 s"),
    ],
)
def test_a_move_that_cannot_be_or_takes_too_long_is_reported(
    armed, target, speed, error, complaint
):
    with pytest.raises(error, match=complaint):
        armed.move_to(target, speed=speed, timeout=0.1)
    assert error is RobotError or armed.reading.applied.tolist() == HERE


def test_nobody_answers_in_time(live):
    live.alive.clear()
    driver = Driver(PATIENT, live.transport)
    with driver, pytest.raises(LinkError, match="has not answered HELLO in time"):
        driver.connect(0.15)


def test_an_emergency_stop_cuts_and_is_cleared_by_hand_only(live, armed):
    armed.estop()
    assert armed.wait_for_fault(1.0).code == m.Fault.ESTOP
    assert not live.board.core.outputs.powered
    with pytest.raises(RobotFaultError, match="emergency stop; clear it"):
        armed.command(HERE)
    with pytest.raises(RobotFaultError):
        armed.arm()
    armed.clear()
    assert armed.fault is None and not live.board.core.outputs.powered
    armed.arm()
    assert live.board.core.outputs.powered


def test_a_fault_whose_cause_is_there_cannot_be_cleared(live, driver):
    live.board.estop = True
    driver.wait_for_fault(1.0)
    with pytest.raises(RefusedError, match="refuses CLEAR: a fault is latched"):
        driver.clear()


def test_what_breaks_while_listening_is_raised_by_the_next_call(live, armed):
    live.transport.read = breaks(LinkError("/dev/robot has gone"))
    with pytest.raises(LinkError, match="/dev/robot has gone"):
        armed.wait_for(armed.command(HERE) + 1, time.monotonic() + 1)
    with pytest.raises(LinkError, match="/dev/robot has gone"):
        armed.command(HERE)


def test_what_nobody_understands_is_reported(live, driver):
    live.inject(encode(state(state=9), 1000))
    with pytest.raises(RobotError, match=r"sent what means nothing, State.*state=9"):
        driver.wait_for(1, time.monotonic() + 5)


def test_a_pace_waits_for_a_robot_that_is_slow_to_answer(live, armed):
    live.alive.clear()
    answers = [armed.pace(HERE, time.monotonic() + 0.005) for _ in range(6)]
    assert answers == [None] * 6
    live.alive.set()
    end = time.monotonic() + 5
    while armed.pace(HERE, time.monotonic() + 0.02) is None:
        assert time.monotonic() < end


def test_a_pace_does_not_wait_for_a_silent_robot(live, armed):
    live.alive.clear()
    with pytest.raises(LinkError, match=r"said nothing for 0\.5 s"):
        for _ in range(200):
            armed.pace(HERE, time.monotonic() + 0.02)


def test_closing_stops_the_robot_and_happens_once(live, armed):
    armed.close()
    assert not live.board.core.outputs.powered
    armed.close()
    assert live.transport.closed == 1
    with pytest.raises(LinkError, match="closed"):
        armed.connect()


def test_closing_a_dead_robot_is_bounded(live, armed):
    """Its ramp, from where it stands, and the answer to a stop: about a second."""
    live.alive.clear()
    assert elapsed(armed.close) < 20


@pytest.mark.parametrize(
    "error", [LinkError("cannot write to /dev/robot"), OSError("no such device")], ids=repr
)
def test_closing_goes_on_when_a_stage_fails(live, armed, error):
    live.transport.write = breaks(error)
    armed.close()
    assert live.transport.closed


FORKED = """
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
IN_A_THREAD = """
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


@pytest.mark.parametrize(
    ("program", "said"),
    [(FORKED, "children are gone\nclosed\n"), (IN_A_THREAD, "installed\nclosed\n")],
    ids=["a forked child leaves the robot to its parent", "installed again by a thread"],
)
def test_the_guard_closes_once(program, said):
    ended = run_program(program)
    assert (ended.stdout, ended.stderr) == (said, "")


def run_program(text):
    return finished("-c", textwrap.dedent(text), cwd=Path(__file__).parents[1])  # for support


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
