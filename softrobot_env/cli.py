"""`softrobot`: the command line."""

import argparse
import shlex
import sys

from softrobot_env.commands import (
    benchmark,
    evaluate,
    export,
    grip,
    inspect,
    listing,
    render,
    robot_file,
    train,
)
from softrobot_env.commands.robot import command as robot
from softrobot_env.commands.subcommands import Command, add_commands
from softrobot_env.registries import Registry

#: The commands of `softrobot`.
COMMANDS: Registry[Command] = Registry(
    "command",
    {
        "evaluate": Command(
            evaluate, "run policies on tasks; write report.json, report.md and plots"
        ),
        "render": Command(render, "write a video of a policy on a task"),
        "grip": Command(grip, "close a gripper on a bar; write a video"),
        "benchmark": Command(benchmark, "measure accuracy and speed"),
        "train": Command(train, "make the trained artifacts that policies load"),
        "inspect": Command(inspect, "print what a scene contains and what it leaves out"),
        "list": Command(listing, "print the robots, tasks and policies there are"),
        "export": Command(export, "write the MJCF of the registered scenes, or of a robot"),
        "robot-file": Command(robot_file, "check the file of a robot of your own"),
        "robot": Command(
            robot, "find, calibrate, hold and stop a real robot, or run a virtual one"
        ),
    },
)


def build_parser() -> argparse.ArgumentParser:
    """The parser with all commands."""
    parser = argparse.ArgumentParser(
        prog="softrobot", description="MuJoCo environments for tendon-driven soft robots."
    )
    add_commands(parser, COMMANDS, "command")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status.

    Bad arguments end with status 2 and the reason on standard error, failed episodes with 1.
    """
    argv = sys.argv[1:] if argv is None else argv
    args = build_parser().parse_args(argv)
    args.command_line = shlex.join(["softrobot", *argv])
    try:
        return args.command_run(args)
    except (ValueError, ImportError, RuntimeError, OSError) as error:
        print(f"softrobot {args.command}: {error}", file=sys.stderr)
        return 2
