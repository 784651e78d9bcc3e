"""`softrobot`: the command line."""

import argparse
import shlex
import sys
from signal import SIGINT, default_int_handler, getsignal, signal
from threading import current_thread, main_thread
from types import FrameType

from softrobot_env import __version__

#: Exit status of a command that was refused, and of one that Ctrl-C stopped.
_REFUSED, _STOPPED = 2, 130


def build_parser() -> argparse.ArgumentParser:
    """The parser with all commands."""
    from softrobot_env.commands.registry import COMMANDS
    from softrobot_env.commands.subcommands import Parser, add_commands

    parser = Parser(
        prog="softrobot", description="MuJoCo environments for tendon-driven soft robots."
    )
    parser.add_argument("--version", action="version", version=f"softrobot_env {__version__}")
    add_commands(parser, COMMANDS, "command")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status.

    Bad arguments end with status 2 and the reason in one line on standard error, failed episodes
    with 1, Ctrl-C with 130.
    """
    argv = sys.argv[1:] if argv is None else argv
    name = "softrobot"
    stop = _Stop()
    try:
        args = _parsed(argv)
        args.command_line = shlex.join(["softrobot", *argv])
        name = f"softrobot {args.command}" if args.command else name
        return args.command_run(args)
    except KeyboardInterrupt:
        stop.asked = True
    except (ValueError, ImportError, RuntimeError, OSError, ArithmeticError, MemoryError) as error:
        # Ctrl-C ends workers too, and what it interrupts may tell it as something else.
        if not stop.asked:
            print(f"{name}: {str(error) or 'out of memory'}", file=sys.stderr)
            return _REFUSED
    finally:
        stop.restore()
    print(f"{name}: stopped by Ctrl-C", file=sys.stderr)
    return _STOPPED


def _parsed(argv: list[str]) -> argparse.Namespace:
    """The arguments, read with all commands at hand, which load MuJoCo.

    Raises:
        RuntimeError: MuJoCo refuses the backend that is asked for.
    """
    try:
        return build_parser().parse_args(argv)
    except RuntimeError as error:
        if "MUJOCO_GL" not in str(error):
            raise
        raise RuntimeError(f"{error}; choose egl, osmesa or glfw, or unset it") from None


class _Stop:
    """Remembers that Ctrl-C was pressed, besides what it does anyway.

    Attributes:
        asked: Whether it was.
    """

    def __init__(self) -> None:
        self.asked = False
        self._usual = getsignal(SIGINT)
        if self._usual is default_int_handler and current_thread() is main_thread():
            signal(SIGINT, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        default_int_handler(number, frame)

    def restore(self) -> None:
        """Let Ctrl-C do what it did."""
        if getsignal(SIGINT) == self._note:
            signal(SIGINT, self._usual)
