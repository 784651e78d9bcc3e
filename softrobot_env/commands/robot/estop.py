"""`softrobot robot estop`: cut a robot's outputs at once."""

import argparse

from rich.console import Console

from softrobot_env.commands.robot.link import (
    add_robot,
    open_driver,
    reading_rows,
    robot_of,
    table_of,
)

EXAMPLE = "softrobot robot estop --port /dev/ttyUSB0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser)
    parser.add_argument("--clear", action="store_true", help="clear the emergency stop afterwards")


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if it cannot be confirmed."""
    robot = robot_of(args)
    with open_driver(robot, args.record) as driver:
        driver.estop()
        driver.connect()
        # Again: a board that starts when its port is opened has missed the first one.
        driver.estop()
        stopped = driver.wait_for_fault(1.0)
        if args.clear:
            driver.clear()
        Console().print(table_of(reading_rows(driver.reading), f"Robot {robot.name}"))
        return int(not stopped)
