"""The commands of `softrobot`, and their parser."""

from argparse import SUPPRESS, ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Mapping
from pkgutil import resolve_name
from typing import Any, NoReturn

from softrobot_env.core.files import in_one_line
from softrobot_env.core.registry import Registry

#: A command and its description. The command is a module or another object, or its path in this
#: package. It has an `EXAMPLE`, a `USAGE` if its arguments do not fit on a line, and `run(args)`,
#: which returns the exit status; also `ARGUMENTS`, perhaps with `KINDS`, for `arguments.declare`,
#: or `add_arguments(parser)`; or `COMMANDS` of its own instead of `run`.
Command = tuple[Any, str]

#: Name -> command.
COMMANDS: Registry[Command] = Registry(
    "command",
    {
        "evaluate": ("evaluate", "run policies on tasks; write report.json, report.md and plots"),
        "render": ("render", "write a video of a policy on a task"),
        "view": ("view", "open an interactive viewer with actuator sliders"),
        "grip": ("grip", "close a gripper on a bar; write a video with --out"),
        "benchmark": ("benchmark", "run a study of accuracy, speed or control"),
        "train": ("train", "train what a policy has to learn about a robot"),
        "optimise": ("optimise", "find actions by which the tip follows a task's path"),
        "tune": ("tune", "search for training settings with Ray Tune"),
        "inspect": ("inspect", "print what a scene contains and neglects, its errors and cost"),
        "warm-up": ("warm_up", "precompile all kernels"),
        "list": ("listing", "list robots, tasks, policies and environments"),
        "export": (
            "robot_file:EXPORT",
            "write the MJCF of the registered scenes, or of a robot",
        ),
        "robot-file": ("robot_file", "check a robot file"),
        "recording": (
            "recording",
            "check recordings of commands and markers, and replay them on any robot",
        ),
        "identify": (
            "identify",
            "identify a robot's parameters from a recording; write its file and a report",
        ),
        "robot": (
            "robot.command",
            "find, calibrate, hold and stop a real robot, or run a virtual one",
        ),
    },
)


class Parser(ArgumentParser):
    """Parser that reports errors in arguments in one line."""

    def parse_known_args(self, *arguments: Any, **more: Any) -> tuple[Any, list[str]]:
        """Refuse unknown arguments here: argparse would leave that to the topmost parser."""
        found, unknown = super().parse_known_args(*arguments, **more)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with status 2."""
        self.exit(2, f"{self.prog}: {in_one_line(message)}; see {self.prog} --help\n")


def add_commands(
    parser: ArgumentParser,
    commands: Mapping[str, Command],
    dest: str = SUPPRESS,
    asked: str | None = None,
) -> None:
    """Add commands with their arguments and examples; without a command, help is printed.

    Args:
        parser: Where to add them.
        commands: By name.
        dest: Attribute of the parsed arguments that holds the name; `run` holds the module's.
        asked: The requested command, if known: only this one is loaded.
    """

    def show_help(_: Namespace) -> int:
        parser.print_help()
        return 0

    parser.set_defaults(run=show_help)
    added = parser.add_subparsers(dest=dest, metavar="COMMAND")
    for name, (module, text) in commands.items():
        how = {"help": text, "description": text, "formatter_class": RawDescriptionHelpFormatter}
        command = added.add_parser(name, **how)
        if asked in (None, name):
            from .arguments import declare  # takes long to load, as commands do

            found = loaded(module)
            command.usage = getattr(found, "USAGE", None)
            command.epilog = f"example:\n  {found.EXAMPLE}"
            command.set_defaults(run=getattr(found, "run", None))
            if hasattr(found, "COMMANDS"):
                add_commands(command, found.COMMANDS)
            elif hasattr(found, "add_arguments"):
                found.add_arguments(command)
            else:
                declare(command, found.ARGUMENTS, **getattr(found, "KINDS", {}))


def loaded(command: Any) -> Any:
    """The command itself, loaded if its path is given."""
    return resolve_name(f"{__package__}.{command}") if isinstance(command, str) else command
