"""`softrobot robot`: a real robot over serial; a module `robot_NAME` for each of its commands."""

import argparse

from softrobot_env.commands.subcommands import add_commands

EXAMPLE = "softrobot robot hold --port /dev/ttyUSB0 --seconds 10"

#: Command (a module `robot_NAME` of this package) -> what it does.
ROBOT_COMMANDS = {
    "list": "list serial ports and who answers there",
    "info": "configure a robot and print what it says of itself",
    "calibrate": "jog the servos, mark zero, range and rest, and write a robot file",
    "hold": "arm a robot and hold it at rest",
    "stop": "ramp a robot to rest and switch its outputs off",
    "estop": "cut a robot's outputs at once",
    "replay": "print what a recorded link carried",
    "virtual": "run the rig without hardware, behind a serial port",
    "soak": "run at full rate for long, and print whether every promise was kept",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command: its commands with theirs."""
    add_commands(parser, ROBOT_COMMANDS, "robot_", "robot_command")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    return args.robot_command_run(args)
