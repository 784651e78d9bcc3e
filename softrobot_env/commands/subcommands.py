"""Commands under a parser, each a module."""

import argparse
from collections.abc import Mapping
from typing import Any, NamedTuple, NoReturn


class Command(NamedTuple):
    """A command.

    Attributes:
        module: Or an object: has `EXAMPLE` for people, `add_arguments(parser)` and `run(args)`,
            which returns the exit status.
        text: What it does.
    """

    module: Any
    text: str


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong with arguments."""

    def parse_known_args(self, *arguments: Any, **more: Any) -> tuple[Any, list[str]]:
        """Refuse unknown arguments here: argparse would let the uppermost parser do it."""
        found, unknown = super().parse_known_args(*arguments, **more)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with status 2."""
        text = " ".join(message.split())
        self.exit(2, f"{self.prog}: {text}; see {self.prog} --help\n")


def add_commands(
    parser: argparse.ArgumentParser, commands: Mapping[str, Command], dest: str
) -> None:
    """Add commands with their arguments and examples; without one the parser's help is printed.

    Args:
        parser: Where to add them.
        commands: By name.
        dest: Attribute of the parsed arguments that holds the name; `<dest>_run` holds the
            module's `run`.
    """

    def show_help(_: argparse.Namespace) -> int:
        parser.print_help()
        return 0

    parser.set_defaults(**{f"{dest}_run": show_help})
    added = parser.add_subparsers(dest=dest, metavar="COMMAND")
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
