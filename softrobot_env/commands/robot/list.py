"""`softrobot robot list`: serial ports, and who answers there."""

import argparse

from rich.console import Console

from softrobot_env.hardware.driver import identify
from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.robot_file import BAUDS, rig_file
from softrobot_env.hardware.transport import SerialTransport, load_serial
from softrobot_env.rendering.tables import Column, make_table

EXAMPLE = "softrobot robot list /dev/ttyUSB0 /dev/ttyUSB1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "ports", nargs="*", metavar="PORT", help="default: every serial port of this computer"
    )
    parser.add_argument(
        "--baud", type=int, choices=BAUDS, default=rig_file().baud, help="default: %(default)s"
    )
    parser.add_argument(
        "--timeout", type=float, default=2.0, metavar="S", help="for each port; default: 2"
    )


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if nobody answers.

    Every port gets a few bytes; a robot that moves ramps to rest.
    """
    answers = {port: _answer(port, args) for port in args.ports or _ports()}
    told = {port: text for port, (_, text) in answers.items()}
    columns = Column("port", lambda port: port), Column("who answers", told.get)
    table = make_table("", columns, told)
    Console().print(table if answers else "This computer has no serial port.")
    return int(not any(found for found, _ in answers.values()))


def _ports() -> list[str]:
    load_serial()
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports())


def _answer(port: str, args: argparse.Namespace) -> tuple[bool, str]:
    """Whether a robot answers at a port, and what it or its port says."""
    try:
        transport = SerialTransport(port, args.baud)
        try:
            info = identify(transport, args.timeout)
        finally:
            transport.close()
    except RobotError as error:
        return False, str(error)
    return True, f"firmware {info.firmware}, {info.tendons} tendons"
