"""`softrobot robot stop`: ramp a robot to rest, then off."""

import argparse

from rich.console import Console

from softrobot_env.commands.arguments import positive
from softrobot_env.commands.robot.link import (
    add_robot,
    open_driver,
    reading_rows,
    robot_of,
    table_of,
)

EXAMPLE = "softrobot robot stop --port /dev/ttyUSB0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser)
    parser.add_argument(
        "--clear", action="store_true", help="clear a latched fault, if its cause is gone"
    )
    parser.add_argument("--timeout", type=positive, default=10.0, metavar="S", help="default: 10")


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if a fault is latched.

    A hello ends any session with the ramp, and the configuration is taken only after it.
    """
    robot = robot_of(args)
    with open_driver(robot, args.record) as driver:
        driver.connect(args.timeout)
        if args.clear:
            driver.clear()
        Console().print(table_of(reading_rows(driver.reading), f"Robot {robot.name} has stopped"))
        return int(bool(driver.reading.faults))
