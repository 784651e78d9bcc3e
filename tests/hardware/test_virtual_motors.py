"""Emulated motors behind a pseudo-terminal: the vendors' own programs, and hosts that die."""

import signal
import subprocess
import textwrap
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from support.processes import python

from softrobot_env.cli import main
from softrobot_env.commands.robot.soak import unsafe_outputs
from softrobot_env.commands.robot.virtual import virtual_process
from softrobot_env.hardware.registry import find_hardware
from softrobot_env.robots import find_robot
from softrobot_env.robots.file import write_robot

pytest.importorskip("serial", reason="needs the robot extra")
dynamixel_sdk = pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
scservo_sdk = pytest.importorskip("scservo_sdk", reason="needs the robot extra")

pytestmark = pytest.mark.realtime(late=0.4)

TRUNK = find_robot("examples/motor_trunk.toml")


@contextmanager
def virtual(kind, log=None):
    with virtual_process(None, log=log, kind=kind, robot=TRUNK) as robot:
        yield robot


def patient(port):
    """A busy machine answers later than a bus."""
    port.setPacketTimeout = lambda length: port.setPacketTimeoutMillis(500.0)
    return port


def test_the_library_of_dynamixel_talks_to_its_own_port():
    with virtual("dynamixel") as robot:
        port = dynamixel_sdk.PortHandler(robot.file.port)
        packets = dynamixel_sdk.PacketHandler(2.0)
        assert port.openPort() and port.setBaudRate(1000000)
        patient(port)
        assert packets.ping(port, 3) == (1020, dynamixel_sdk.COMM_SUCCESS, 0)
        group = dynamixel_sdk.GroupSyncRead(port, packets, 132, 4)
        for number in range(1, 7):
            assert group.addParam(number)
        assert group.txRxPacket() == dynamixel_sdk.COMM_SUCCESS
        assert [group.getData(n, 132, 4) for n in range(1, 7)] == [2048] * 6
        assert packets.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
        assert packets.write1ByteTxRx(port, 1, 11, 4)[1] == 7  # locked while torque is on
        assert packets.write4ByteTxRx(port, 1, 116, 2148) == (0, 0)
        end = time.monotonic() + 10
        while abs(packets.read4ByteTxRx(port, 1, 132)[0] - 2148) > 2:
            assert time.monotonic() < end
        assert packets.ping(port, 9)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
        port.closePort()


def test_the_library_of_feetech_talks_to_its_own_port():
    with virtual("feetech") as robot:
        port = scservo_sdk.PortHandler(robot.file.port)
        packets = scservo_sdk.sms_sts(port)
        assert port.openPort() and port.setBaudRate(1000000)
        patient(port)
        assert packets.ping(2) == (777, scservo_sdk.COMM_SUCCESS, 0)
        assert packets.ReadPos(2) == (2048, 0, 0)
        assert packets.write1ByteTxRx(2, scservo_sdk.SMS_STS_TORQUE_ENABLE, 1) == (0, 0)
        assert packets.WritePosEx(2, 2148, 2000, 0) == (0, 0)
        end = time.monotonic() + 10
        while abs(packets.ReadPos(2)[0] - 2148) > 2:
            assert time.monotonic() < end
        group = scservo_sdk.GroupSyncRead(packets, 56, 2)
        for number in range(1, 7):
            assert group.addParam(number)
        assert group.txRxPacket() == scservo_sdk.COMM_SUCCESS
        assert group.getData(6, 56, 2) == 2048
        port.closePort()


HOST = """
    import sys, time
    from dataclasses import replace
    import numpy as np
    from softrobot_env.commands.robot.virtual import motors_of
    from softrobot_env.hardware.registry import open_hardware
    from softrobot_env.robots import find_robot
    file = motors_of(sys.argv[1], find_robot("examples/motor_trunk.toml"), sys.argv[2])
    file = replace(file, watchdog=0.2, latency=0.02, patience=1.0, slew=0.005)
    robot = open_hardware(file)
    robot.connect(10)
    robot.arm()
    due, start = time.monotonic(), time.monotonic()
    while True:
        due = max(due, time.monotonic()) + file.control_period
        robot.pace(np.full(6, 0.01), due)
        if start and due - start > 0.3:
            print("moving", flush=True)
            start = None
"""


@pytest.mark.parametrize(
    "kind", ["dynamixel", "feetech", pytest.param("odrive", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "kill",
    [signal.SIGKILL, signal.SIGSTOP, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)],
)
def test_motors_of_a_host_that_dies_in_motion(tmp_path, kind, kill):
    """They hold, or let go, in the watchdog's time; a host that is told to end ramps them down."""
    log = tmp_path / "log.npz"
    with virtual(kind, log) as robot:
        args = (textwrap.dedent(HOST), kind, robot.file.port)
        with python(*args, text=True, stdout=subprocess.PIPE) as host:
            assert host.stdout.readline() == "moving\n"
            killed = time.monotonic()
            host.send_signal(kill)
            time.sleep(1.5)
            host.kill()
            host.wait(30)
    with np.load(log) as data:
        moment, applied, powered = data["time"], data["applied"], data["powered"]
        file = replace(robot.file, slew=0.005 * 1.5)  # a motor's profile is a whole count
        assert unsafe_outputs(dict(data), file)["unsafe_outputs"] == 0
    way = np.abs(np.diff(applied[moment > killed + 0.3], axis=0)).max(axis=1)
    if kill == signal.SIGTERM:
        np.testing.assert_allclose(applied[-1], 0.0, atol=1e-4)
        assert not powered[-1]
    else:
        assert way.max() < 1e-6 and applied[-1].max() > 1e-4
        assert powered[-1] == (kind != "odrive")


def test_commands_of_a_real_robot_serve_motors(tmp_path, capsys):
    """Who answers, homing, the file that it writes, and a recorded link."""
    table = TRUNK.hardware | {"latency_ms": 30, "watchdog_ms": 1000, "patience_ms": 2000}
    file, homed, log = (tmp_path / name for name in ("trunk.toml", "homed.toml", "home.link"))
    write_robot(replace(TRUNK, hardware=table), file)
    with virtual("dynamixel") as robot:
        where = f"--robot-file {file} --port {robot.file.port}"
        assert main(f"robot info {where}".split()) == 0
        assert main(f"robot home {where} --out {homed} --record {log}".split()) == 0
        assert main(f"robot stop {where}".split()) == 0
        assert main(f"robot replay {log}".split()) == 0
    said = capsys.readouterr().out
    assert "XM430-W350, tendon a1" in said and "Length zero was at" in said
    assert "ff ff fd 00 01" in said  # what the first motor was asked
    zeros = [motor.zero for motor in find_hardware(homed).motors]
    assert all(abs(zero - np.pi) > 1e-3 for zero in zeros)


def test_homing_is_for_motors_and_virtual_motors_for_robots_driven_by_length(capsys):
    for words, reason in (
        ("robot home --port nowhere", "only motors feel their tendons"),
        ("robot virtual --hardware dynamixel --robot arm", "driven by tension"),
        ("robot virtual --robot rig", "--robot: only with motors"),
    ):
        with pytest.raises(SystemExit):
            raise SystemExit(main(words.split()))
        said = capsys.readouterr()
        assert reason in (said.err + said.out).replace("\n", " ")
