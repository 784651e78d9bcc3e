"""The fault matrix with the environment, in real time; see `test_matrix`."""

from copy import copy
from dataclasses import replace
from time import sleep

import pytest
from support.hardware_boards import Board, LiveBoard
from support.output_witness import WatchedCore
from support.real_episodes import (
    FILE,
    PERIOD,
    Still,
    assert_comes_to_rest,
    assert_runs_again,
    fail,
    pull,
    running,
)

from softrobot_env.envs.real import RealRigEnv
from softrobot_env.hardware.errors import ProtocolMismatchError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import Decoder, encode

pytest.importorskip("cobs", reason="needs the robot extra")

pytestmark = [
    pytest.mark.timeout(60),
    pytest.mark.realtime(late=0.4),
    pytest.mark.usefixtures("patience"),
]


@pytest.fixture
def live():
    """A board in memory; a copy of its transport is a line that nobody has closed."""
    board = Board()
    board.core = WatchedCore()
    with LiveBoard(board) as live:
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


@pytest.fixture
def restarted(live):
    """An environment whose board started again in an episode."""
    with running(line(live), live.board.core) as env:
        live.board.core = WatchedCore(boot_id=2, reset_cause=m.Reset.BROWN_OUT)
        failure = fail(env)
        assert all(told in failure for told in ("brown-out", "boot 00000001", "now 00000002"))
        yield env


def test_a_restart_ends_the_episode(restarted, live):
    sleep(1.2 * FILE.watchdog)
    core = live.board.core
    assert not core.outputs.powered and not core.witness.followed
    assert core.outputs.state == m.DeviceState.DISARMED


def test_a_restarted_board_can_run_again(restarted, live):
    assert_runs_again(restarted, live.board.core)


class OtherFirmware(WatchedCore):
    """A device that introduces itself with other numbers."""

    def __init__(self, **changes):
        super().__init__()
        self._changes = changes

    def transmit(self):
        sent = Decoder().feed(super().transmit())
        return b"".join(encode(self._changed(message), seq) for message, seq in sent)

    def _changed(self, message):
        return replace(message, **self._changes) if isinstance(message, m.HelloAck) else message


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"min_protocol": 2, "max_protocol": 3}, "speaks protocol 2 to 3, this package 1"),
        ({"schema": 0xABCD}, f"schema 0000abcd and {m.SCHEMA:08x}"),
    ],
    ids=["protocol", "table"],
)
def test_another_firmware_is_named_and_never_armed(changes, told):
    board = Board()
    board.core = OtherFirmware(**changes)
    with LiveBoard(board) as live:
        env = RealRigEnv(robot_file=FILE, line=line(live), tip=Still())
        with pytest.raises(ProtocolMismatchError, match=told):
            env.reset()
        env.close()
        sleep(0.1)
    assert {type(message) for message in board.core.heard} == {m.Hello}
    assert not board.core.outputs.powered
