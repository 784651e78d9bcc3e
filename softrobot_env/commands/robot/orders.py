"""`softrobot robot info`, `hold`, `stop`, `estop`: an order to a robot, and what it says then."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from time import monotonic
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table

from softrobot_env.commands.arguments import positive
from softrobot_env.commands.robot.link import (
    add_robot,
    info_rows,
    open_driver,
    reading_rows,
    robot_of,
)
from softrobot_env.hardware.driver import Driver
from softrobot_env.rendering.tables import named_values

_LONGEST_MOVE = 30.0  # s


@dataclass(frozen=True)
class RobotCommand:
    """A command to the robot that the arguments of `add_robot` mean, see `Command.module`.

    Attributes:
        EXAMPLE: For people.
        give: Gives the order to a driver that has sent nothing yet; returns the exit status.
        options: More arguments, as `add_argument` has them.
    """

    EXAMPLE: str
    give: Callable[[Driver, argparse.Namespace], int]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Arguments of the command."""
        add_robot(parser)
        for name, option in self.options.items():
            parser.add_argument(name, **option)

    def run(self, args: argparse.Namespace) -> int:
        """Run the command."""
        with open_driver(robot_of(args), args.record) as driver:
            return self.give(driver, args)


def _info(driver: Driver, args: argparse.Namespace) -> int:
    """What a robot says of itself; 1 if a fault is latched."""
    robot, rows = driver.robot, info_rows(driver.connect()) | reading_rows(driver.reading)
    Console().print(named_values(f"Robot {robot.name} at {robot.port}", rows))
    return int(bool(driver.reading.faults))


def _stop(driver: Driver, args: argparse.Namespace) -> int:
    """Ramp to rest, then off; 1 if a fault is latched.

    A hello ends any session with the ramp, and the configuration is taken only after it.
    """
    driver.connect(args.timeout)
    if args.clear:
        driver.clear()
    title = f"Robot {driver.robot.name} has stopped"
    Console().print(named_values(title, reading_rows(driver.reading)))
    return int(bool(driver.reading.faults))


def _estop(driver: Driver, args: argparse.Namespace) -> int:
    """Cut the outputs at once; 1 if it cannot be confirmed."""
    driver.estop()
    driver.connect()
    # Again: a board that starts when its port is opened has missed the first one.
    driver.estop()
    stopped = driver.wait_for_fault(1.0)
    if args.clear:
        driver.clear()
    Console().print(named_values(f"Robot {driver.robot.name}", reading_rows(driver.reading)))
    return int(not stopped)


def _hold(driver: Driver, args: argparse.Namespace) -> int:
    """Hold at rest; Ctrl-C ends it in order."""
    console = Console()
    driver.connect()
    driver.arm()
    try:
        _stay(driver, args.seconds, console)
    except KeyboardInterrupt:
        console.print("Stopping.")
    return 0


def _stay(driver: Driver, seconds: float, console: Console) -> None:
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
    return named_values(f"Robot {driver.robot.name}, Ctrl-C stops it", rows)


INFO = RobotCommand("softrobot robot info --robot-file rig.toml", _info)

HOLD = RobotCommand(
    "softrobot robot hold --robot-file rig.toml --seconds 10",
    _hold,
    {
        "--seconds": {
            "type": positive,
            "default": inf,
            "metavar": "S",
            "help": "default: until Ctrl-C",
        }
    },
)

STOP = RobotCommand(
    "softrobot robot stop --port /dev/ttyUSB0",
    _stop,
    {
        "--clear": {"action": "store_true", "help": "clear a latched fault, if its cause is gone"},
        "--timeout": {"type": positive, "default": 10.0, "metavar": "S", "help": "default: 10"},
    },
)

ESTOP = RobotCommand(
    "softrobot robot estop --port /dev/ttyUSB0",
    _estop,
    {"--clear": {"action": "store_true", "help": "clear the emergency stop afterwards"}},
)
