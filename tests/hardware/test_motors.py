"""Tables of motors in robots' files, their numbers, homing, and a kind of motors from outside."""

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from support.hardware_boards import Terminal
from support.motor_bench import MotorBench, Motors, motor_file

from softrobot_env.cli import main
from softrobot_env.core.extras import install_command
from softrobot_env.envs.real import RealEnv
from softrobot_env.hardware.dynamixel import Dynamixel
from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.feetech import Feetech
from softrobot_env.hardware.interface import Hardware
from softrobot_env.hardware.motors import MotorRobot, Register, home
from softrobot_env.hardware.registry import (
    HARDWARE,
    find_hardware,
    hardware_of,
    motor_kind,
    open_hardware,
    register_hardware,
    save_hardware,
)
from softrobot_env.hardware.robot_file import Tip, rig_file, write_robot_file
from softrobot_env.hardware.virtual_motors import VirtualDynamixel, crc16
from softrobot_env.robots import find_robot
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.tasks import SetPoints, Task

TRUNK = "examples/motor_trunk.toml"
TABLE = find_robot(TRUNK).hardware


def reads(table):
    return hardware_of(replace(find_robot(TRUNK), hardware=table))


def with_motor(**changes):
    first, *others = TABLE["motor"]
    return TABLE | {"motor": [first | changes, *others]}


REFUSED = [
    ({"kind": "stepper"}, "unknown kind of hardware 'stepper'; choose from firmware, dynamixel"),
    ({"watchdog_ms": 30}, "watchdog_ms must be at least twice"),
    ({"baud": 10**7}, "baud must be a whole number from 9600"),
    ({"mode": "velocity"}, "mode must be one of 'position'"),
    ({"speed": 1}, "hardware.speed is no key"),
    ({"motor": []}, "different ids, one or more"),
    ({"motor": TABLE["motor"][:5]}, "tendon 'b3' needs one motor or two, it has 0"),
    (with_motor(id=2), "different ids"),
    (with_motor(tendon="c1"), "winds tendon 'c1', the robot's are a1"),
    (with_motor(direction=2), "direction must be 1 or -1"),
    (with_motor(rest_mm=13), "rest_mm"),
    (with_motor(spool_radius_mm=0), "spool_radius_mm must be in"),
    (with_motor(zero_deg=400) | {"mode": "position"}, "mode 'position' has one turn"),
]


@pytest.mark.parametrize(("changes", "allowed"), REFUSED, ids=lambda x: str(x)[:30])
def test_a_table_that_says_what_is_not_allowed_is_refused(changes, allowed):
    with pytest.raises(ValueError, match=allowed):
        reads(TABLE | changes)


@pytest.mark.parametrize(("kind", "bytes_each"), [("dynamixel", 99), ("feetech", 40)])
def test_a_bus_that_is_too_slow_is_refused(kind, bytes_each):
    """Ten bits a byte: answers of 83 + 11 or 31 + 6 bytes, and goals of 5 or 3 in one packet."""
    slow = int(10 * 3 * bytes_each / 0.02)
    MotorBench(motor_file(kind, baud=slow + 100))
    with pytest.raises(ValueError, match=r"3 motors take 20 ms at .* baud, more than"):
        MotorBench(motor_file(kind, baud=slow - 100))


def test_two_motors_of_a_tendon_need_one_range():
    first = TABLE["motor"][0]
    table = TABLE | {"motor": [*TABLE["motor"], first | {"id": 9, "maximum_mm": 10}]}
    with pytest.raises(ValueError, match="one range and one rest"):
        reads(table)


def test_a_robots_file_keeps_its_table(tmp_path):
    robot = read_robot(TRUNK)
    write_robot(robot, tmp_path / "again.toml")
    again = read_robot(tmp_path / "again.toml")
    assert again == robot and again.hardware == robot.hardware
    assert find_hardware(tmp_path / "again.toml") == find_hardware(TRUNK)


def test_files_of_the_tip_lie_beside_the_robots_file(tmp_path, monkeypatch):
    """Whatever folder a program runs in; what is no file there stays as it is written."""
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "camera.toml").touch()
    (tmp_path / "robot" / "mine.py").touch()
    trunk = find_robot(TRUNK)
    monkeypatch.chdir(tmp_path)
    tip = {
        "kind": "mine.py:Tip",
        "camera": "camera.toml",
        "device": "some.module:take",
        "head": "x.y",
    }
    write_robot(replace(trunk, hardware=TABLE | {"tip": tip}), tmp_path / "robot/a.toml")
    board = rig_file()
    write_robot_file(
        replace(board, tip=Tip(tip["kind"], dict([*tip.items()][1:]))), tmp_path / "b.toml"
    )
    (tmp_path / "b.toml").rename(tmp_path / "robot/b.toml")
    for name in ("a.toml", "b.toml"):
        found = find_hardware(Path("robot") / name).tip
        assert found.kind == f"{tmp_path}/robot/mine.py:Tip"
        assert found.options["camera"] == f"{tmp_path}/robot/camera.toml"
        assert found.options["device"] == tip["device"] and found.options["head"] == "x.y"
    file = find_hardware(tmp_path / "robot/a.toml")
    save_hardware(file, tmp_path / "robot/a.toml", tmp_path / "robot/c.toml")
    assert 'camera = "camera.toml"' in (tmp_path / "robot/c.toml").read_text()
    save_hardware(file, tmp_path / "robot/a.toml", tmp_path / "d.toml")
    assert find_hardware(tmp_path / "d.toml").tip == file.tip


def test_a_task_that_does_not_begin_at_length_zero_is_refused_by_name():
    robot = find_robot(TRUNK)
    task = Task("pulled", robot, SetPoints(((0.0, 0.0, 0.25),), 1.0), 1.0, (1e-3,) * 6, axes="xyz")
    with pytest.raises(
        ValueError, match=r"'pulled.*' does not start with all tendons at length ze"
    ):
        RealEnv(task)


def test_a_calibration_is_written_back_and_the_rest_of_the_file_stays(tmp_path):
    file = find_hardware(TRUNK)
    marks = [(1e-3, -5e-3, 6e-3, 2e-3)] * 6
    found = file.calibrated(marks)
    save_hardware(found, TRUNK, tmp_path / "found.toml")
    again = find_hardware(tmp_path / "found.toml")
    np.testing.assert_allclose(again.tendons, [(-6e-3, 5e-3, 1e-3)] * 6, atol=1e-9)
    for before, after in zip(file.motors, again.motors, strict=True):
        assert after.length(before.angle(1e-3)) == pytest.approx(0.0, abs=1e-9)
    assert read_robot(tmp_path / "found.toml") == read_robot(TRUNK)
    assert "# The trunk of" in (tmp_path / "found.toml").read_text()


@pytest.mark.parametrize("kind", [Dynamixel, Feetech])
@pytest.mark.parametrize("value", [0, 1, -1, 2048, -2048, 30000, -30000])
def test_numbers_of_registers_come_back(kind, value):
    register = Register(0, 2, 0.5, signed=True)
    assert kind.decoded(register, kind.coded(register, 0.5 * value)) == 0.5 * value


def test_feetechs_sign_is_the_highest_bit_and_dynamixels_a_complement():
    register = Register(0, 2, signed=True)
    assert Feetech.coded(register, -1) == b"\x01\x80"
    assert Dynamixel.coded(register, -1) == b"\xff\xff"
    with pytest.raises(OverflowError, match="30719"):
        Feetech.coded(register, 31000)


def test_the_checksum_of_the_makers_example():
    """Ping of motor 1, as the e-manual of protocol 2.0 prints it: CRC 0x4e19."""
    assert crc16(bytes.fromhex("fffffd0001030001")) == 0x4E19


def test_stuffing_goes_both_ways():
    """A goal whose bytes are a packet's header, FF FF FD, through the library's own packing."""
    bench = MotorBench(motor_file("dynamixel"))
    value = 0x00FDFFFF
    data = value.to_bytes(4, "little")
    assert bench.robot._bus.write_table(1, 116, data) == ""
    assert bytes(bench.device.motors[0].table[116:120]) == data
    assert bench.robot._bus.read_bytes(1, 116, 4) == data


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_motors_keep_the_range_within_a_turn_themselves(kind):
    """Ends in counts: 180 degrees less or more 20 mm on a spool of 10 mm, 2 rad."""
    bench = MotorBench(motor_file(kind, mode="position")).start()
    for one in bench.device.motors:
        ends = [bench.device.get(one, name) for name in ("minimum", "maximum")]
        np.testing.assert_allclose(ends, 2048 + np.array([-2, 2]) * 2048 / np.pi, atol=1)
    bench.go(0.02, 0.8)
    bench.robot._bus.write([2 * pi - 0.01] * 3)  # another program's goal, 31 mm from zero
    bench.run_for(0.05)
    np.testing.assert_allclose(bench.device.applied, 0.02, atol=2e-5)
    bench.go(-0.02, 1.0)
    np.testing.assert_allclose(bench.device.applied, -0.02, atol=2e-5)
    assert bench.witness.unsafe == []


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_over_many_turns_motors_keep_no_range(kind):
    bench = MotorBench(motor_file(kind)).start()
    bench.robot._bus.write([2 * pi - 0.01] * 3)
    bench.run_for(0.09)
    assert bench.device.applied.min() > 0.004


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_a_list_of_ports_names_motors(kind, capsys, monkeypatch):
    monkeypatch.setattr(HARDWARE, "_own", {kind: HARDWARE[kind]})
    with Terminal(Motors(replace(motor_file(kind), tendon_names=("a", "b", "c")))) as robot:
        assert main(["robot", "list", robot.port, "--timeout", "0.1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    model = {"dynamixel": "XM430-W350", "feetech": "STS3215"}[kind]
    assert f"{kind} at 1000000 baud: 1 {model}, 2 {model}, 3 {model}" in said


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_homing_finds_where_tendons_are_taut(kind):
    """Springs of 1000 N/m on a spool of 10 mm ask 0.05 A at 5 mm, by T r / k_t."""
    file = motor_file(kind, home_current=0.05, home_backoff=1e-3)
    bench = MotorBench(file.jogged())
    for one, slack in zip(bench.device.motors, (0.0, -2e-3, -6e-3), strict=True):
        one.length = slack
    bench.run_for(0.01)
    bench.robot.connect()
    bench.robot.arm()
    zero = home(bench.robot)
    step = file.ramp * file.control_period
    assert np.all((zero >= 4e-3 - 1e-4) & (zero <= 4e-3 + 3 * step))
    np.testing.assert_allclose(bench.device.applied, zero, atol=2e-4)
    assert bench.witness.unsafe == []


def test_a_tendon_that_is_not_attached_is_named():
    bench = MotorBench(motor_file("dynamixel", home_current=0.05, home_travel=0.012).jogged())
    bench.plant._stiffness = np.array([1000.0, 0.0, 1000.0])
    bench.start()
    with pytest.raises(RobotError, match="tendon b is not taut after 12 mm"):
        home(bench.robot)


def test_turns_that_a_motor_forgot_are_found_again():
    """A range of less than a turn says which turn it must be."""
    file = motor_file("dynamixel")
    bench = MotorBench(replace(file, motors=tuple(replace(m, zero=9 * pi) for m in file.motors)))
    for one in bench.device.motors:
        one.turns = 4 * 2 * pi
    bench.start()
    bench.go(0.01, 0.4)
    np.testing.assert_allclose(bench.device.applied, 0.01, atol=1e-4)


def test_every_kind_is_the_one_interface():
    for name, kind in HARDWARE.registered().items():
        file = rig_file() if name == "firmware" else motor_file(name)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("softrobot_env.hardware.interface.ExitGuard.install", lambda self: None)
            assert isinstance(kind.drive(file, object()), Hardware)


class Acme(Dynamixel):
    """A kind of motors from outside: its registers lie elsewhere."""

    models: ClassVar = {1020: ("Acme", 1e-3)}


class VirtualAcme(VirtualDynamixel):
    kind = Acme


def test_a_kind_from_outside_is_driven_and_emulated(monkeypatch):
    monkeypatch.setattr(HARDWARE, "_own", dict(HARDWARE.registered()))
    register_hardware("acme", motor_kind(f"{__file__}:Acme", f"{__file__}:VirtualAcme"))
    bench = MotorBench(motor_file("acme")).start()
    assert bench.robot.about["motor 1"] == "Acme, tendon a"
    bench.go(0.005, 0.3)
    np.testing.assert_allclose(bench.device.applied, 0.005, atol=1e-4)


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_a_missing_package_names_what_to_install(kind, monkeypatch):
    module = {"dynamixel": "dynamixel_sdk", "feetech": "scservo_sdk"}[kind]
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(ImportError) as refused:
        open_hardware(motor_file(kind), object())
    assert install_command("robot") in str(refused.value)


def test_an_environment_needs_hardware_and_a_length_drive():
    with pytest.raises(ValueError, match="needs drive"):
        RealEnv("reach", robot="hanging_trunk")
    plain = replace(find_robot(TRUNK), hardware=None)
    with pytest.raises(ValueError, match=r"add a table \[hardware\]"):
        RealEnv("reach", robot=plain)
    env = RealEnv("reach", robot=TRUNK, port="/dev/other")
    assert env.control_period == 0.02 and env._session.file.port == "/dev/other"
    assert env.observation_space["tip_position"].shape == (3,)


def test_a_robot_that_measures_no_force_says_so():
    file = motor_file("dynamixel")
    bench = MotorBench(
        replace(file, motors=tuple(replace(m, torque_constant=0.0) for m in file.motors))
    )
    assert not bench.robot.measures_force and isinstance(bench.robot, MotorRobot)
