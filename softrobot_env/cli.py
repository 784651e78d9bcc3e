"""`softrobot`: the command line."""

import argparse
import shlex
import sys

from softrobot_env.commands.subcommands import add_commands

#: Command (a module of that name in `softrobot_env.commands`) -> what it does.
COMMANDS = {
    "evaluate": "run policies on tasks; write report.json, report.md and plots",
    "render": "write a video of a policy on a task",
    "benchmark": "measure accuracy and speed",
    "train": "make the trained artefacts that policies load",
    "inspect": "print what a scene contains and what it leaves out",
    "export": "write the MJCF of the registered scenes",
    "robot": "find, calibrate, hold and stop a real robot, or run a virtual one",
}


def build_parser() -> argparse.ArgumentParser:
    """The parser with all commands."""
    parser = argparse.ArgumentParser(
        prog="softrobot", description="MuJoCo environments for tendon-driven soft robots."
    )
    add_commands(parser, COMMANDS, "", "command")
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
