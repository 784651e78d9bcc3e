"""`softrobot robot`: a real robot over serial; a module `robot_NAME` for each of its commands."""

import argparse
import importlib

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
    commands = parser.add_subparsers(dest="robot_command", required=True, metavar="COMMAND")
    for name, text in ROBOT_COMMANDS.items():
        module = importlib.import_module(f"softrobot_env.commands.robot_{name}")
        command = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run_robot=module.run)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    return args.run_robot(args)
