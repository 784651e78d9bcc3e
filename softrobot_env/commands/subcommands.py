"""Commands under a parser, each a module of this package."""

import argparse
import importlib
from collections.abc import Mapping


def add_commands(
    parser: argparse.ArgumentParser, texts: Mapping[str, str], prefix: str, dest: str
) -> None:
    """Add a command for every module `prefix + name`, with its arguments and its example.

    Args:
        parser: Where to add them.
        texts: Name -> what it does.
        prefix: Of the modules' names.
        dest: Attribute of the parsed arguments that holds the name; `<dest>_run` holds the
            module's `run`.
    """
    commands = parser.add_subparsers(dest=dest, required=True, metavar="COMMAND")
    for name, text in texts.items():
        module = importlib.import_module(f"softrobot_env.commands.{prefix}{name}")
        command = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(**{f"{dest}_run": module.run})
