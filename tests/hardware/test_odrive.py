"""ODrive motors: one file for a kind of motors; adapters of CAN; python-can and the emulator."""

from math import pi
from pathlib import Path
from struct import pack, unpack
from time import monotonic, sleep

import numpy as np
import pytest
from support.hardware_boards import LiveBoard, Terminal
from support.motor_bench import MotorBench, Motors, motor_file

from softrobot_env.cli import main
from softrobot_env.hardware import odrive, registry
from softrobot_env.hardware.can_line import CanTransport, frames, open_can, text
from softrobot_env.hardware.errors import LinkError, RobotFaultError
from softrobot_env.hardware.registry import open_hardware

POSITION_OF_THREE = 3 << 5 | 9


def test_a_kind_of_motors_is_one_short_file():
    assert len(Path(odrive.__file__).read_text("utf-8").splitlines()) <= 200


def test_frames_are_those_of_serial_adapters():
    """As the protocol of CANable and others has them: t, 11 bits, length, data."""
    assert text(0x069, b"\x01\xff") == b"t069201ff\r"
    assert text(0x7FF) == b"r7ff8\r"
    left = bytearray(b"\x07z\rt069201FF\rjunkt0692\rr7ff8\rt0693010203\rt00")
    assert [*frames(left)] == [(0x069, b"\x01\xff"), (0x7FF, None), (0x069, b"\x01\x02\x03")]
    assert left == b"t00"
    left += bytes(10000)
    assert [*frames(left)] == [] and len(left) <= 64


@pytest.mark.parametrize("name", ["ODriveError", "AxisState"])
def test_numbers_are_those_of_the_makers_package(name):
    enums = pytest.importorskip("odrive.enums")
    if name == "AxisState":
        assert (enums.AxisState.IDLE, enums.AxisState.CLOSED_LOOP_CONTROL) == (1, 8)
        assert (odrive.IDLE, odrive.CLOSED_LOOP) == (1, 8)
        return
    known = {error.value.bit_length() - 1 for error in enums.ODriveError if error}
    assert known <= set(odrive.ODrive.bits)
    assert enums.ODriveError.WATCHDOG_TIMER_EXPIRED == 1 << odrive.EXPIRED


@pytest.fixture
def terminal():
    pytest.importorskip("serial", reason="needs the robot extra")
    with Terminal(Motors(motor_file("odrive", watchdog=1.0, latency=0.03), look=0.01)) as robot:
        yield robot


def test_a_list_of_ports_names_them(terminal, capsys, monkeypatch):
    monkeypatch.setattr(registry.HARDWARE, "_own", {"odrive": registry.HARDWARE["odrive"]})
    assert main(["robot", "list", terminal.port, "--timeout", "0.1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "odrive at 1000000 baud: 1 ODrive S1, 2 ODrive S1, 3 ODrive S1" in said


def test_python_cans_own_adapter_talks_to_the_emulator(terminal):
    """Position, and a goal after arming, by a program that knows nothing of this package."""
    can = pytest.importorskip("can")

    def ask(bus, name):
        bus.send(
            can.Message(arbitration_id=name, is_remote_frame=True, is_extended_id=False, dlc=8)
        )
        end = monotonic() + 5
        while monotonic() < end:
            found = bus.recv(0.1)
            if found is not None and found.arbitration_id == name:
                return bytes(found.data)
        raise AssertionError("no answer")

    def tell(bus, name, data):
        bus.send(can.Message(arbitration_id=name, is_extended_id=False, data=data))

    with can.Bus(interface="slcan", channel=terminal.port, sleep_after_open=0.0) as bus:
        assert unpack("<2f", ask(bus, POSITION_OF_THREE))[0] == pytest.approx(0.5)  # a half turn
        tell(bus, 3 << 5 | 0x18, b"\0")  # its watchdog has bitten
        tell(bus, 3 << 5 | 7, pack("<I", 8))
        while not terminal.board.device.motors[2].was_on:
            sleep(0.01)
        tell(bus, 3 << 5 | 0xC, pack("<f2h", 0.52, 0, 0))
        end = monotonic() + 5
        while abs(unpack("<2f", ask(bus, POSITION_OF_THREE))[0] - 0.52) > 1e-4:
            assert monotonic() < end
    np.testing.assert_allclose(terminal.board.device.applied[2], 0.02 * 2 * pi * 0.01, atol=1e-5)


def test_a_robot_over_python_cans_virtual_bus():
    """Driver and emulator each have an adapter of python-can."""
    can = pytest.importorskip("can")
    file = motor_file("odrive", port="virtual:softrobot", watchdog=1.0, latency=0.03, patience=2.0)
    end = CanTransport("virtual", "softrobot", file.baud)
    with LiveBoard(Motors(file, look=0.01), end=end) as live, open_hardware(file) as robot:
        robot.connect(5)
        assert robot.about["motor 2"] == "ODrive S1, tendon b"
        robot.arm()
        due = monotonic()
        for _ in range(20):
            due = max(due, monotonic()) + file.control_period
            robot.pace(np.full(3, 5e-3), due)
        np.testing.assert_allclose(robot.reading.length, 5e-3, atol=2e-3)
        robot.stop()
        assert not live.board.device.powered
    end.close()
    assert isinstance(can.Message(), can.Message)


@pytest.mark.parametrize("command", [1, 9, 0x14, 0x15, 0x17])
def test_a_motor_of_which_one_message_is_missing_has_not_answered(command):
    bench = MotorBench(motor_file("odrive"))
    status = bench.device.status

    def without(number, sent, data):
        return b"" if (number, sent) == (2, command) else status(number, sent, data)

    bench.device.status = without
    bench.run_for(0.2)
    with pytest.raises(LinkError, match="not all motors say where they are"):
        bench.robot.connect()
    bench.device.status = status
    bench.start()
    bench.device.status = without
    if command == 1:  # comes ten times a second, and not when it is asked for
        return
    with pytest.raises(RobotFaultError, match=r"motor 2 \(tendon b\) does not answer"):
        bench.go(0.01, 0.5)


def test_rates_that_no_adapter_has_are_refused():
    with pytest.raises(ValueError, match="baud of a CAN bus must be one of"):
        open_can(motor_file("odrive", baud=57600))


def test_a_bus_that_is_too_slow_is_refused():
    """A goal of 130 bits, and four answers of as many after requests of 50."""
    needed = 3 * (130 + 4 * 180)
    MotorBench(motor_file("odrive", baud=int(needed / 0.02) + 100))
    with pytest.raises(ValueError, match="more than control_period_ms"):
        MotorBench(motor_file("odrive", baud=int(needed / 0.02) - 100))
