"""Kinds of hardware by name: how a table `[hardware]` is read, driven, and emulated."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from softrobot_env.core.files import read_table, readable, write_text
from softrobot_env.core.records import placed, write
from softrobot_env.core.registry import Registry, load
from softrobot_env.robots import RobotParams
from softrobot_env.robots.file import read_robot

from .interface import Hardware, HardwareFile
from .motor_file import Motor, MotorFile, read_motors
from .robot_file import (
    RobotFile,
    read_robot_file,
    robot_from_table,
    tip_from,
    write_robot_file,
)
from .transport import SerialTransport, Transport

_LATENCY = 0.02  # s, of a converter that nobody has set up


def _serial(file: HardwareFile) -> Transport:
    return SerialTransport(file.port, file.baud)


class HardwareKind(NamedTuple):
    """A kind of hardware.

    Attributes:
        read: Of a table `[hardware]`, the robot's name and its tendons' names: what it says.
        drive: Of that and a transport: the robot.
        device: Of that: what emulates it; None where nothing does.
        open: Of that: the way to it.
        find: Of a port: who answers there, for people; None if nobody does, or it cannot be asked.
    """

    read: Callable[[Mapping[str, Any], str, Sequence[str]], HardwareFile]
    drive: Callable[[HardwareFile, Transport], Hardware]
    device: Callable[..., Any] | None = None
    open: Callable[[HardwareFile], Transport] = _serial
    find: Callable[[str], str | None] = lambda port: None


def motor_kind(
    bus: str,
    device: str | None = None,
    way: Callable[[HardwareFile], Transport] = _serial,
    bauds: Sequence[int] = (1000000, 57600),
) -> HardwareKind:
    """A kind of motors.

    Args:
        bus: Path `module:class` of its `motors.MotorBus`.
        device: Path of its `virtual_motors.VirtualMotors`.
        way: Opens the way to them.
        bauds: Rates at which `softrobot robot list` asks for them.
    """

    def find(port: str) -> str | None:
        from .motors import BusPort

        for baud in bauds:
            file = MotorFile(bus, port, (Motor(1, "t", 0.01),), baud=baud, latency=_LATENCY)
            with closing(way(file)) as line:
                found = load(bus)(file, BusPort(line, baud, file.latency)).present()
            if found:
                return f"at {baud} baud: " + ", ".join(f"{k} {name}" for k, name in found.items())
        return None

    def drive(file: MotorFile, transport: Transport) -> Hardware:
        from .motors import MotorRobot

        return MotorRobot(file, transport, load(bus))

    emulate = None if device is None else lambda file, seed=0: load(device)(file, seed)
    return HardwareKind(read_motors, drive, emulate, way, find)


def _driver(file: RobotFile, transport: Transport) -> Hardware:
    from .driver import Driver

    return Driver(file, transport)


def _board_file(table: Mapping[str, Any], name: str, tendons: Sequence[str]) -> RobotFile:
    with placed("hardware"):
        file = robot_from_table({k: v for k, v in table.items() if k != "kind"} | {"name": name})
        if len(file.tendons) != len(tendons):
            raise ValueError(f"{len(file.tendons)} servos for {len(tendons)} tendons")
    return file


_HERE = "softrobot_env.hardware"

#: Kinds of hardware by name, as in a robot's file.
HARDWARE: Registry[HardwareKind] = Registry(
    "kind of hardware",
    {
        "firmware": HardwareKind(_board_file, _driver),
        "dynamixel": motor_kind(
            f"{_HERE}.dynamixel:Dynamixel", f"{_HERE}.virtual_motors:VirtualDynamixel"
        ),
        "feetech": motor_kind(f"{_HERE}.feetech:Feetech", f"{_HERE}.virtual_motors:VirtualFeetech"),
        "odrive": motor_kind(
            f"{_HERE}.odrive:ODrive",
            f"{_HERE}.virtual_odrive:VirtualODrive",
            lambda file: load(f"{_HERE}.can_line:open_can")(file),
            (1000000, 250000),
        ),
    },
)


def register_hardware(name: str, kind: HardwareKind, replace: bool = False) -> None:
    """Add a kind of hardware, or replace one; errors as of `Registry.register`."""
    HARDWARE.register(name, kind, replace)


def hardware_of(
    robot: RobotParams, port: str | None = None, kind: str | None = None
) -> HardwareFile:
    """What the table `[hardware]` of a robot's file says.

    Args:
        robot: A robot with such a table.
        port, kind: In place of the table's.

    Raises:
        ValueError: It says what is not allowed; names the key.
    """
    table = robot.hardware if kind is None else robot.hardware | {"kind": kind}
    table = table if robot.file is None else tip_from(table, robot.file.parent)
    if "kind" not in table:
        raise ValueError(f"hardware.kind missing; choose from {', '.join(HARDWARE)}")
    with placed("hardware"):
        found = HARDWARE.find(table["kind"])
    file = found.read(table, robot.name, [tendon.name for tendon in robot.tendons])
    return with_port(file, port)


def find_hardware(path: Path) -> HardwareFile:
    """The hardware that a file describes: a robot's table `[hardware]`, or a board's own file.

    Raises:
        ValueError: It says what is not allowed; names file and key.
        OSError: It cannot be read.
    """
    with placed(path):
        table = read_table(path)
    if "hardware" not in table:
        return read_robot_file(path)
    robot = read_robot(path)
    with placed(path):
        return hardware_of(robot)


def save_hardware(file: HardwareFile, source: Path | None, path: Path) -> None:
    """Write a calibration: a board's own file, or a robot's file with another `[hardware]`.

    Args:
        file: What was found.
        source: The robot's file; the rest of it stays as it is written.
        path: The file to write.
    """
    if source is None or "hardware" not in read_table(source):
        write_robot_file(file, path)
        return
    import tomlkit  # few commands write one

    document = tomlkit.parse(readable(source).read_text("utf-8"))
    table = write(file) | {"tip": {"kind": file.tip.kind, **file.tip.options}}
    if path.resolve().parent == Path(source).resolve().parent and "tip" in document["hardware"]:
        table["tip"] = document["hardware"]["tip"]  # its files as they are named there
    if isinstance(file, RobotFile):
        table["kind"] = "firmware"
        del table["name"]
    document["hardware"] = table
    write_text(path, tomlkit.dumps(document))


def with_port(file: HardwareFile, port: str | None) -> HardwareFile:
    """The same at another port, if one is given."""
    return file if port is None else replace(file, port=port)


def kind_of(file: HardwareFile) -> HardwareKind:
    """The kind that a file is of."""
    return HARDWARE.find(getattr(file, "kind", "firmware"))


def open_hardware(file: HardwareFile, transport: Transport | None = None) -> Hardware:
    """A robot at its port, or over a transport; nothing is sent yet.

    Raises:
        LinkError: The port cannot be opened.
        ImportError: The kind's package is missing; the message says what to install.
    """
    kind = kind_of(file)
    return kind.drive(file, transport or kind.open(file))
