"""`softrobot robot hold`: arm a robot and hold it at rest."""

import argparse
from math import inf
from time import monotonic

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table

from softrobot_env.commands.arguments import positive
from softrobot_env.commands.robot.link import (
    add_robot,
    open_driver,
    reading_rows,
    robot_of,
    table_of,
)
from softrobot_env.hardware.driver import Driver

EXAMPLE = "softrobot robot hold --robot-file rig.toml --seconds 10"

_LONGEST_MOVE = 30.0  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser)
    parser.add_argument(
        "--seconds", type=positive, default=inf, metavar="S", help="default: until Ctrl-C"
    )


def run(args: argparse.Namespace) -> int:
    """Run the command; Ctrl-C ends it in order."""
    robot = robot_of(args)
    console = Console()
    with open_driver(robot, args.record) as driver:
        driver.connect()
        driver.arm()
        try:
            _hold(driver, args.seconds, console)
        except KeyboardInterrupt:
            console.print("Stopping.")
    return 0


def _hold(driver: Driver, seconds: float, console: Console) -> None:
    robot = driver.robot
    rest = np.array([servo.rest for servo in robot.tendons])
    driver.move_to(rest, robot.ramp, _LONGEST_MOVE)
    end, due = monotonic() + seconds, monotonic()
    with Live(_shown(driver), console=console, get_renderable=lambda: _shown(driver)):
        while due < end:
            due = max(due, monotonic()) + robot.control_period
            driver.pace(rest, due)


def _shown(driver: Driver) -> Table:
    link = driver.link
    trips = f"{1e3 * (link['round_trip'] or 0):.1f} ms, longest "
    trips += f"{1e3 * link['longest_round_trip']:.1f} ms"
    counts = f"{link['sent']} sent, {link['received']} received, {link['lost']} lost"
    rows = reading_rows(driver.reading) | {"round trip": trips, "messages": counts}
    return table_of(rows, f"Robot {driver.robot.name}, Ctrl-C stops it")
