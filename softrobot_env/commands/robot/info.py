"""`softrobot robot info`: what a robot says of itself."""

import argparse

from rich.console import Console

from softrobot_env.commands.robot.link import (
    add_robot,
    info_rows,
    open_driver,
    reading_rows,
    robot_of,
    table_of,
)

EXAMPLE = "softrobot robot info --robot-file rig.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if a fault is latched."""
    robot = robot_of(args)
    with open_driver(robot, args.record) as driver:
        info = driver.connect()
        rows = info_rows(info) | reading_rows(driver.reading)
        Console().print(table_of(rows, f"Robot {robot.name} at {robot.port}"))
        return int(bool(driver.reading.faults))
