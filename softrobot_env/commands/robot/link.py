"""Arguments that say which robot, the driver they mean, and what a robot says, for people."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from numpy import ndarray

from softrobot_env.hardware.driver import Driver
from softrobot_env.hardware.protocol.session import DeviceInfo
from softrobot_env.hardware.protocol.unit_conversion import Reading
from softrobot_env.hardware.robot_file import RobotFile, read_robot_file, rig_file
from softrobot_env.hardware.transport import LoggingTransport, SerialTransport, Transport

from ..output import say

#: Arguments that say which robot.
ROBOT_TEXT = """
    --robot-file FILE  robot file (TOML); default: the rig before its calibration
    <port>
    --record FILE  new file for all messages
"""


def robot_of(args: Namespace) -> RobotFile:
    """The robot that the arguments of `ROBOT_TEXT` mean.

    Raises:
        ValueError: The file says what is not allowed.
    """
    robot = rig_file() if args.robot_file is None else read_robot_file(args.robot_file)
    return robot if args.port is None else replace(robot, port=args.port)


def open_driver(robot: RobotFile, record: Path | None) -> Driver:
    """A driver at the robot's port, to be closed as a context; nothing is sent yet.

    Raises:
        LinkError: The port cannot be opened.
        OSError: The file to record to exists or cannot be written.
    """
    return Driver(robot, opened(robot, record))


def opened(robot: RobotFile, record: Path | None) -> Transport:
    """The robot's port, recorded to a file where one is given; errors as of `open_driver`."""
    transport = SerialTransport(robot.port, robot.baud)
    try:
        return transport if record is None else _ToldLog(transport, record)
    except OSError:
        transport.close()
        raise


class _ToldLog(LoggingTransport):
    """A log that says at its end why it broke off."""

    def close(self) -> None:
        """See `Transport`."""
        super().close()
        if self.failure is not None:
            say(f"The log breaks off: {self.failure}")


def info_rows(info: DeviceInfo) -> dict[str, str]:
    """Who answered, by name."""
    return {
        "firmware": info.firmware,
        "protocol": f"{info.protocols[0]} to {info.protocols[1]}",
        "schema": f"{info.schema:08x}",
        "tendons": str(info.tendons),
        "measures": ", ".join(c.name.lower() for c in info.capabilities) or "nothing",
        "boot": f"{info.boot_id:08x}, cause {info.reset_cause.name.lower().replace('_', '-')}",
    }


def reading_rows(reading: Reading) -> dict[str, str]:
    """What the robot does and measures, by name."""
    return {
        "state": reading.state.name.lower(),
        "applied": f"{numbers(1e3 * reading.applied, 2)} mm",
        "length": f"{numbers(1e3 * reading.length, 2)} mm",
        "force": f"{numbers(reading.force, 2)} N",
        "converter": numbers(reading.adc, 0),
        "supply": f"{reading.supply:.2f} V",
        "faults": ", ".join(fault.name.lower() for fault in reading.faults) or "none",
    }


def numbers(values: ndarray, digits: int) -> str:
    """Numbers in a row."""
    return "  ".join(f"{value:.{digits}f}" for value in values)
