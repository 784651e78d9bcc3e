"""`softrobot`: the command line."""

import argparse
import os
import shlex
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from signal import SIG_DFL, SIG_IGN, SIGINT, SIGTERM, default_int_handler, getsignal, signal
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import Any

from softrobot_env import __version__
from softrobot_env.core import under_way
from softrobot_env.core.files import in_one_line
from softrobot_env.core.processes import STOPPED, ended_by_ctrl_c
from softrobot_env.core.registry import REFUSALS, OutsideError

#: Exit status of a command that failed, that was refused, and that SIGTERM ended.
_FAILED, _REFUSED, _TERMINATED = 1, 2, 143

#: Commands that talk with whom they serve.
_TALKING = ("softrobot robot", "softrobot view")


def build_parser(asked: str | None = None) -> argparse.ArgumentParser:
    """The parser with all commands; with the arguments of one alone where that is asked for."""
    from softrobot_env.commands.registry import COMMANDS, Parser, add_commands

    parser = Parser(
        prog="softrobot", description="MuJoCo environments for tendon-driven soft robots."
    )
    parser.add_argument("--version", action="version", version=f"softrobot_env {__version__}")
    add_commands(parser, COMMANDS, "command", asked)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status.

    Bad arguments end with status 2 and the reason in one line on standard error, code from outside
    that fails with 1 and such a line, failed episodes with 1, Ctrl-C with 130, SIGTERM with 143.
    """
    argv = sys.argv[1:] if argv is None else argv
    name, stop = "softrobot", _Stop()

    def working() -> str:
        return "" if name in _TALKING else name

    under_way.begin(working)
    try:
        args = _parsed(argv)
        args.command_line = shlex.join(["softrobot", *argv])
        name = f"softrobot {args.command}" if args.command else name
        stop.begin()
        with _warned(name):
            status = args.run(args)
        if stop.asked != SIGTERM:
            return status
    except KeyboardInterrupt:
        pass
    except REFUSALS as error:
        # Ctrl-C ends workers too, and what it interrupts may tell it as something else.
        if not stop.asked:
            print(f"{name}: {in_one_line(str(error)) or 'out of memory'}", file=sys.stderr)
            return _FAILED if isinstance(error, OutsideError) else _REFUSED
    except Exception:
        if not stop.asked:
            raise
    finally:
        stop.end()
        under_way.end(working)
    by, status = ("SIGTERM", _TERMINATED) if stop.asked == SIGTERM else ("Ctrl-C", STOPPED)
    print(f"{name}: stopped by {by}", file=sys.stderr)
    return status


def _parsed(argv: list[str]) -> argparse.Namespace:
    """The arguments, read with the command at hand, which may load MuJoCo.

    Raises:
        RuntimeError: MuJoCo refuses the backend that is asked for.
    """
    asked = next((word for word in argv if not word.startswith("-")), "")
    try:
        return build_parser(asked).parse_args(argv)
    except (RuntimeError, AttributeError) as error:
        if "MUJOCO_GL" not in str(error) and "'gl" not in str(error):  # a library without it
            raise
        raise RuntimeError(f"{error}; MUJOCO_GL can be egl, osmesa or glfw, or unset") from None


@contextmanager
def _warned(name: str) -> Iterator[None]:
    """Within it warnings are lines as errors are, without the place in the sources."""
    usual = warnings.formatwarning

    def line(message: Warning | str, *place: Any, **more: Any) -> str:
        return f"{name}: warning: {' '.join(str(message).split())}\n"

    warnings.formatwarning = line
    try:
        yield
    finally:
        warnings.formatwarning = usual


class _Stop:
    """Ctrl-C and SIGTERM interrupt what runs, once it runs, and are remembered.

    Attributes:
        asked: Which of them came, None without.
    """

    def __init__(self) -> None:
        self.asked: int | None = None
        self._usual: dict[int, Any] = {}
        self._timer: Timer | None = None
        self._hooks = sys.unraisablehook, sys.excepthook

    def begin(self) -> None:
        """Until now nothing could be lost; handlers that are not the usual ones stay."""
        if current_thread() is not main_thread():
            return
        usual = {SIGINT: (default_int_handler, ended_by_ctrl_c), SIGTERM: (SIG_DFL,)}
        for number, handlers in usual.items():
            if (found := getsignal(number)) in handlers:
                self._usual[number] = found
                signal(number, self._note)
        sys.unraisablehook, sys.excepthook = self._unraisable, self._printed

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.asked = self.asked or number
        raise KeyboardInterrupt

    def _unraisable(self, unraisable: Any) -> None:
        """Python tells and forgets what is raised where C code called it: interrupt again."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._hooks[0](unraisable)
        elif self._usual:
            self._timer = Timer(0.05, os.kill, (os.getpid(), SIGINT))
            self._timer.daemon = True
            self._timer.start()

    def _printed(self, kind: type[BaseException], *about: Any) -> None:
        """So does C code that prints what is raised."""
        if not issubclass(kind, KeyboardInterrupt):
            self._hooks[1](kind, *about)

    def end(self) -> None:
        """Let both do what they did."""
        mine = {n: usual for n, usual in self._usual.items() if getsignal(n) == self._note}
        for number in mine:
            signal(number, SIG_IGN)
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()
        for number, usual in mine.items():
            signal(number, usual)
        self._usual = {}
        if sys.unraisablehook == self._unraisable:
            sys.unraisablehook, sys.excepthook = self._hooks
