"""`softrobot`: the command line."""

import argparse
import importlib
import shlex
import sys

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
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        module = importlib.import_module(f"softrobot_env.commands.{name}")
        command = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status.

    Bad arguments end with status 2 and the reason on standard error, failed episodes with 1.
    """
    argv = sys.argv[1:] if argv is None else argv
    args = build_parser().parse_args(argv)
    args.command_line = shlex.join(["softrobot", *argv])
    try:
        return args.run(args)
    except (ValueError, ImportError, RuntimeError, OSError) as error:
        print(f"softrobot {args.command}: {error}", file=sys.stderr)
        return 2
