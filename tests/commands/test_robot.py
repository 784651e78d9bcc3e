"""`softrobot robot`, with boards behind pseudo-terminals."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from support.commands import called
from support.hardware_boards import FullDisk, Terminal

from softrobot_env.commands.robot.link import open_driver
from softrobot_env.hardware.protocol.messages import Capability, DeviceState
from softrobot_env.hardware.robot_file import read_robot_file, rig_file, write_robot_file
from softrobot_env.hardware.virtual_robot import Core

pytestmark = [pytest.mark.realtime(late=0.9), pytest.mark.usefixtures("patience")]


@pytest.fixture
def robot(tmp_path):
    """A board, with a patient robot file at `robot.file`: this computer may be busy."""
    with Terminal() as terminal:
        terminal.file = str(tmp_path / "rig.toml")
        patient = replace(rig_file(terminal.port), watchdog=1.0, ttl=0.9)
        write_robot_file(patient, tmp_path / "rig.toml")
        yield terminal


def test_list_names_who_answers_and_who_does_not(robot, capsys):
    assert called("robot list", robot.port, "/dev/no-robot") == 0
    out = capsys.readouterr().out
    assert "firmware 1.0, 3 tendons" in out and "/dev/no-robot" in out
    assert called("robot list /dev/no-robot") == 1


def test_info_prints_what_the_robot_says(robot, capsys):
    assert called("robot info --robot-file", robot.file) == 0
    out = capsys.readouterr().out
    assert "disarmed" in out and "6.00 V" in out and "00000001" in out


def test_hold_moves_to_rest_and_stops(robot, capsys):
    robot.board.position = (300, 0, 0)
    assert called("robot hold --robot-file", robot.file, "--seconds 0.2") == 0
    assert "running" in capsys.readouterr().out
    assert robot.board.core.outputs.state == DeviceState.DISARMED
    assert robot.board.position == (0, 0, 0)


def test_estop_latches_until_it_is_cleared(robot, capsys):
    assert called("robot estop --robot-file", robot.file) == 0
    assert "latched" in capsys.readouterr().out
    assert called("robot hold --robot-file", robot.file) == 2
    assert "emergency stop; clear it" in capsys.readouterr().err
    assert called("robot stop --robot-file", robot.file) == 1
    assert called("robot stop --robot-file", robot.file, "--clear") == 0
    assert robot.board.core.outputs.state == DeviceState.DISARMED


@pytest.fixture
def calibrated(robot, tmp_path, monkeypatch):
    """Exit status of a calibration by lines, and the file that it writes."""

    def call(lines):
        monkeypatch.setattr("sys.stdin", io.StringIO(lines))
        out = tmp_path / "found.toml"
        return called("robot calibrate --robot-file", robot.file, "--out", out), out

    return call


def test_calibrate_writes_what_was_found(robot, calibrated, capsys):
    robot.board.core = Core(capabilities=Capability.SUPPLY)
    status, out = calibrated("t 2\n-1\nzero\nnonsense\n+2\nrest\nwrite\n")
    assert status == 0
    found, before = read_robot_file(out), read_robot_file(Path(robot.file))
    assert found.tendons[1].center == pytest.approx(1468e-6)  # 1500 µs less 31.83 µs
    assert found.tendons[1].rest == pytest.approx(2e-3, abs=1.1e-5)
    assert found.tendons[0] == before.tendons[0]
    assert "unknown command 'nonsense'; there are" in capsys.readouterr().out
    assert not robot.board.core.outputs.powered


def test_calibrate_goes_on_after_marks_that_contradict(calibrated, capsys):
    status, out = calibrated("+2\nmin\nwrite\nrest\nwrite\n")
    assert status == 0
    assert "not written: minimum_mm <= rest_mm" in capsys.readouterr().out
    assert read_robot_file(out).tendons[0].minimum == pytest.approx(2e-3, abs=1.1e-5)


def test_calibrate_leaves_a_board_that_measures_lengths_its_zero(calibrated, capsys):
    status, out = calibrated("+1\nzero\n")
    assert "lengths from its own zero" in capsys.readouterr().out
    assert status == 1 and not out.exists()  # without write


def test_a_recording_that_breaks_off_is_told_at_the_end(robot, capsys):
    with open_driver(read_robot_file(Path(robot.file)), FullDisk(100)) as driver:
        driver.connect()
        driver.arm()
        assert "breaks off" not in capsys.readouterr().out
    assert not robot.board.core.outputs.powered
    assert "breaks off: [Errno 28] No space left on device" in capsys.readouterr().out


def test_replay_prints_a_recording(robot, tmp_path, capsys):
    path = tmp_path / "run.link"
    called("robot hold --robot-file", robot.file, "--seconds 0.1 --record", path)
    capsys.readouterr()
    assert called("robot replay", path) == 0
    brief = capsys.readouterr().out
    assert "HelloAck" in brief and "running" in brief and "Setpoint" not in brief
    assert called("robot replay", path, "--all") == 0
    assert "Setpoint" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-1])
    assert called("robot replay", path) == 1
    assert "breaks off" in capsys.readouterr().out
