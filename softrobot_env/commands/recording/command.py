"""`softrobot recording`: tables of commands and marker positions of a robot."""

import argparse

from softrobot_env.commands.recording import check, replay
from softrobot_env.commands.subcommands import Command, add_commands
from softrobot_env.core.registry import Registry

EXAMPLE = "softrobot recording check train.csv --header assets/recordings/ftdcr_v4.toml"

#: The commands of `softrobot recording`.
RECORDING_COMMANDS: Registry[Command] = Registry(
    "command of recording",
    {
        "check": Command(check, "say whether a recording is good, what it holds and what is odd"),
        "replay": Command(
            replay, "simulate a recording's commands with a robot; report the error of its markers"
        ),
    },
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command: its commands with theirs."""
    add_commands(parser, RECORDING_COMMANDS, "recording_command")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    return args.recording_command_run(args)
