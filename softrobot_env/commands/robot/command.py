"""`softrobot robot`: a real robot over serial."""

import argparse

from softrobot_env.commands.robot import calibrate, orders, record, replay, soak, virtual
from softrobot_env.commands.robot import list as list_ports
from softrobot_env.commands.subcommands import Command, add_commands
from softrobot_env.core.registry import Registry

EXAMPLE = "softrobot robot hold --port /dev/ttyUSB0 --seconds 10"

#: The commands of `softrobot robot`.
ROBOT_COMMANDS: Registry[Command] = Registry(
    "command of robot",
    {
        "list": Command(list_ports, "list serial ports and who answers there"),
        "info": Command(orders.INFO, "configure a robot and print what it says of itself"),
        "calibrate": Command(
            calibrate, "jog the servos, mark zero, range and rest, and write a robot file"
        ),
        "hold": Command(orders.HOLD, "arm a robot and hold it at rest"),
        "stop": Command(orders.STOP, "ramp a robot to rest and switch its outputs off"),
        "estop": Command(orders.ESTOP, "cut a robot's outputs at once"),
        "replay": Command(replay, "print what a recorded link carried"),
        "record": Command(
            record, "excite a robot, simulated, virtual or real, within limits, and record it"
        ),
        "virtual": Command(virtual, "run the rig without hardware, behind a serial port"),
        "soak": Command(
            soak, "run at full rate for long, and print whether every promise was kept"
        ),
    },
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command: its commands with theirs."""
    add_commands(parser, ROBOT_COMMANDS, "robot_command")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    return args.robot_command_run(args)
