"""Where commands write: existing results are replaced only with --overwrite.

The same rule holds for files and folders. They are locked against other runs meanwhile.
"""

import os
import re
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from hashlib import sha256
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from softrobot_env.core.files import private_dir, write_text
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.under_way import tell, under_way
from softrobot_env.evaluation.report import write_json
from softrobot_env.rendering.tables import text_page

#: File that marks a folder of results, and the list of files written to it.
_REPORT, _LIST = "report.json", ".written"


def check_free(*paths: Path, overwrite: bool) -> None:
    """Refuse to replace files, and refuse files that could not be written later.

    Raises:
        FileExistsError: A file exists and must not be overwritten, or is not a regular file.
        OSError: See `check_folder`, for their folders.
    """
    for path in paths:
        if path.exists() and not path.is_file():
            raise FileExistsError(f"{path} is there, but is no file: choose another name")
        if path.exists() and not overwrite:
            raise FileExistsError(
                f"{path} is there already: --overwrite replaces it, --out writes elsewhere"
            )
        check_folder(path.parent)


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be created or written to.

    Raises:
        NotADirectoryError: It is a file, or lies below one.
        PermissionError: The user has no permission.
    """
    there = next(place for place in (folder, *folder.parents) if place.exists())
    if not there.is_dir():
        raise NotADirectoryError(f"{there} is no folder: choose another one to write to")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(f"nothing can be written in {there}: choose another folder")


@contextmanager
def new_file(path: Path, overwrite: bool) -> Iterator[None]:
    """Lock a free file while it is written.

    Raises:
        OSError: See `check_free`.
        BlockingIOError: Another run writes to it.
    """
    with claimed(path):
        check_free(path, overwrite=overwrite)
        yield


@contextmanager
def new_results(folder: Path, overwrite: bool) -> Iterator[None]:
    """Lock a folder without results, or with results to be overwritten, while it is filled.

    Files of an earlier run that this one did not rewrite are deleted at the end, if this one wrote
    a report; other files stay.

    Raises:
        FileExistsError: There are results.
        OSError: See `check_folder`.
        BlockingIOError: Another run writes to it.
    """
    with claimed(folder):
        check_free(folder / _REPORT, overwrite=overwrite)
        folder.mkdir(parents=True, exist_ok=True)
        with _noted(folder, anew=True):
            yield


def filling(run: Callable[..., int]) -> Callable[..., int]:
    """Decorator of a command that fills --out, see `new_results`; its arguments come first."""

    @wraps(run)
    def held(args: Namespace, *more: Any) -> int:
        with new_results(args.out, args.overwrite):
            return run(args, *more)

    return held


@contextmanager
def changed_results(folder: Path) -> Iterator[None]:
    """Lock a folder of results while something in it is added or redrawn.

    Raises:
        FileNotFoundError: There are no results.
        BlockingIOError: Another run writes to it.
    """
    if not any(folder.glob(f"{_REPORT}*")):
        raise FileNotFoundError(f"{folder / _REPORT}: there is no such report")
    with claimed(folder), _noted(folder, anew=False):
        yield


@contextmanager
def _noted(folder: Path, anew: bool) -> Iterator[None]:
    """List the files written to a folder; after a new report, other listed files are deleted."""
    listed, before = _listed(folder), _states(folder)
    try:
        yield
    finally:
        written = {k for k, state in _states(folder).items() if state != before.get(k)}
        for name in listed - written if anew and _REPORT in written else ():
            (folder / name).unlink(missing_ok=True)
        if not anew or _REPORT in written:
            names = sorted(written if anew else listed | written)
            write_text(folder / _LIST, "".join(f"{name}\n" for name in names))


def _listed(folder: Path) -> set[str]:
    """Names of the files that an earlier run wrote to a folder."""
    with suppress(OSError, UnicodeDecodeError):
        names = (folder / _LIST).read_text("utf-8").splitlines()
        return {name for name in names if Path(name).name == name and (folder / name).is_file()}
    return set()


def _states(folder: Path) -> dict[str, tuple[int, int]]:
    """State of each file, by name, that changes when it is rewritten."""
    found = {path.name: path.stat() for path in folder.iterdir() if path.is_file()}
    return {name: (s.st_ino, s.st_mtime_ns) for name, s in found.items() if name != _LIST}


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Lock a file or folder; the lock ends with the process, however that ends.

    The lock is on a separate temporary file, so it excludes runs of this user on this machine.
    Systems without `fcntl` have no locks.

    Raises:
        BlockingIOError: Another run holds the lock.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    name = sha256(str(path.resolve()).encode()).hexdigest()[:24]
    with (private_dir() / f"{name}.lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(
                f"another run writes to {path}: wait for it, or --out writes elsewhere"
            ) from None
        yield


#: Width larger than any table needs.
_WIDE = 10_000


def _console() -> Console:
    """Console on standard output; without a terminal, lines are as long as their contents.

    `COLUMNS` overrides this.
    """
    console = Console()
    if not (console.is_terminal or "COLUMNS" in os.environ):
        console.width = _WIDE
    return console


#: Consoles of the progress bars on display: other output is printed above them.
_BARS: list[Console] = []


def say(*shown: Any, **how: Any) -> None:
    """Print like `Console.print` of rich; without a terminal, lines are not padded."""
    console = _BARS[-1] if _BARS else _console()
    if console.is_terminal:
        console.print(*shown, **how)
        return
    with console.capture() as printed:
        console.print(*shown, **how)
    console.file.write(re.sub(r" +$", "", printed.get(), flags=re.MULTILINE))


def plotted(draw: Callable[[], object]) -> bool:
    """Draw plots; without matplotlib, print a note and return False: reports do not need them."""
    try:
        draw()
    except ImportError as error:
        say(f"No plots: {error}", markup=False, soft_wrap=True)
        return False
    return True


@contextmanager
def progress_on(
    name: str, total: float | None = None, prefix: str = ""
) -> Iterator[ProgressCallback]:
    """A progress bar that disappears at the end; its clock also runs during long parts.

    If standard output is not a terminal, lines on standard error, see `core.under_way`.

    Args:
        name: Initial description.
        total: Total amount of work, if known.
        prefix: Prefix of later descriptions.

    Yields:
        Function that shows (description, done, total).
    """
    console = _console()
    shown = _bar(console, name, total, prefix) if console.is_terminal else _lines(name, prefix)
    with shown as show:
        yield show


@contextmanager
def _bar(
    console: Console, name: str, total: float | None, prefix: str
) -> Iterator[ProgressCallback]:
    columns = (*Progress.get_default_columns(), TextColumn("after"), TimeElapsedColumn())
    _BARS.append(console)
    try:
        with under_way(None), Progress(*columns, console=console, transient=True) as progress:
            bar = progress.add_task(name, total=total)
            yield lambda what, done, total: progress.update(
                bar, description=prefix + what, completed=done, total=total
            )
    finally:
        _BARS.remove(console)


@contextmanager
def _lines(name: str, prefix: str) -> Iterator[ProgressCallback]:
    now = name

    def show(what: str, done: float, total: float | None) -> None:
        nonlocal now
        counted = isinstance(done, int) and isinstance(total, int)
        share = f"{done} of {total}" if counted else f"{done / total:.0%}" if total else ""
        now = f"{prefix}{what}: {share}"

    with under_way(lambda: now):
        tell(prefix + name)
        yield show


def write_report(args: Namespace, rows: list[Any], *page: Any, **more: Any) -> None:
    """Write rows as report.json in the folder --out, and the rest like `write_page`."""
    write_json(args.out / _REPORT, rows, args.command_line)
    write_page(args, *page, **more)


def write_page(
    args: Namespace,
    title: str,
    tables: Any,
    draw: Callable[[], object] | None = None,
    files: Iterable[str] = (),
) -> None:
    """Write tables as report.md, draw plots if there are any and no --no-plots, and report it.

    Args:
        args: Of the command.
        title: Of the page.
        tables: Tables of rich.
        draw: Function that draws the plots.
        files: Other files written, besides report.json.
    """
    write_tables(args.out, title, tables, args.command_line)
    drawn = draw is not None and not vars(args).get("no_plots") and plotted(draw)
    wrote = ", ".join([*files, _REPORT, "report.md"])
    say(f"Wrote {wrote}{' and plots' if drawn else ''} to {args.out}", soft_wrap=True)


def write_tables(folder: Path, title: str, tables: Any, command: str) -> None:
    """Write tables of rich as report.md; `command` is the one that measured them."""
    write_text(folder / "report.md", text_page(title, tables, command))
