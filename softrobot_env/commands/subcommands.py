"""Commands under a parser, each a module."""

import argparse
from collections.abc import Mapping
from typing import Any, NamedTuple


class Command(NamedTuple):
    """A command.

    Attributes:
        module: Or an object: has `EXAMPLE` for people, `add_arguments(parser)` and `run(args)`,
            which returns the exit status.
        text: What it does.
    """

    module: Any
    text: str


def add_commands(
    parser: argparse.ArgumentParser, commands: Mapping[str, Command], dest: str
) -> None:
    """Add commands with their arguments and examples.

    Args:
        parser: Where to add them.
        commands: By name.
        dest: Attribute of the parsed arguments that holds the name; `<dest>_run` holds the
            module's `run`.
    """
    added = parser.add_subparsers(dest=dest, required=True, metavar="COMMAND")
    for name, (module, text) in commands.items():
        command = added.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(**{f"{dest}_run": module.run})
