"""Arguments that select a robot, its driver, and its readings as text."""

from argparse import Namespace
from pathlib import Path

from numpy import ndarray

from softrobot_env.hardware.interface import Hardware, HardwareFile, Reading
from softrobot_env.hardware.registry import find_hardware, kind_of, open_hardware, with_port
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.hardware.transport import LoggingTransport, Transport

from ..output import say

#: Arguments that select a robot.
ROBOT_TEXT = """
    --robot-file FILE  robot's file with a table [hardware], or a board's own (TOML); default: the
        rig before its calibration
    <port>
    --record FILE  new file for all messages
"""


def robot_of(args: Namespace) -> HardwareFile:
    """The robot selected by the arguments of `ROBOT_TEXT`.

    Raises:
        ValueError: The file contains something that is not allowed.
    """
    robot = rig_file() if args.robot_file is None else find_hardware(args.robot_file)
    return with_port(robot, args.port)


def open_driver(robot: HardwareFile, record: Path | None) -> Hardware:
    """A driver at the robot's port, as a context manager; nothing is sent yet.

    Raises:
        LinkError: The port cannot be opened.
        OSError: The file to record to exists or cannot be written.
    """
    return open_hardware(robot, opened(robot, record))


def opened(robot: HardwareFile, record: Path | None) -> Transport:
    """The robot's port, recorded to a file if one is given; raises the errors of `open_driver`."""
    transport = kind_of(robot).open(robot)
    try:
        return transport if record is None else _ToldLog(transport, record)
    except OSError:
        transport.close()
        raise


class _ToldLog(LoggingTransport):
    """A log that reports at its end why it stopped early."""

    def close(self) -> None:
        """See `Transport`."""
        super().close()
        if self.failure is not None:
            say(f"The log breaks off: {self.failure}")


def reading_rows(reading: Reading) -> dict[str, str]:
    """State and measurements of the robot, by name."""
    own = {"converter": numbers(reading.adc, 0)}
    if reading.current is not None:
        own = {"current": f"{numbers(reading.current, 3)} A"}
        own["temperature"] = f"{numbers(reading.temperature, 0)} °C"
    return {
        "state": reading.state.name.lower(),
        "applied": f"{numbers(1e3 * reading.applied, 2)} mm",
        "length": f"{numbers(1e3 * reading.length, 2)} mm",
        "force": f"{numbers(reading.force, 2)} N",
        **own,
        "supply": f"{reading.supply:.2f} V",
        "faults": ", ".join(fault.name.lower() for fault in reading.faults) or "none",
    }


def numbers(values: ndarray, digits: int) -> str:
    """Numbers in a row."""
    return "  ".join(f"{value:.{digits}f}" for value in values)
