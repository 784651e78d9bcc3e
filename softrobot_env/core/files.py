"""Files are written whole or not at all: a full disk or a kill leaves what was there before."""

import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from errno import EEXIST, EISDIR
from functools import cache
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import Any
from uuid import uuid4


@contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """A path beside `path` to write to, which takes its place at the end of the context.

    It has the same suffix. Where writing fails, what was written is deleted and `path` stays as it
    was. Folders are made as needed; a link stays a link.

    Raises:
        OSError: It cannot be written, with the name of `path`; or it is there and no file.
    """
    file = Path(path).resolve()
    if file.exists() and not file.is_file():
        raise FileExistsError(EEXIST, "it is there, but no file", str(path))
    aside = file.with_name(f".{file.stem}-{uuid4().hex[:12]}{file.suffix}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        yield aside
        _flush(aside)
        aside.replace(file)
    except OSError as error:
        if error.errno is None:
            raise
        raise type(error)(error.errno, os.strerror(error.errno), str(path)) from error
    finally:
        with suppress(OSError):
            aside.unlink()


def in_one_line(text: str) -> str:
    """A text in one line, in which nothing moves a screen's cursor or rings its bell."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


def is_in_one_line(text: str) -> bool:
    """Whether a screen shows a text as it is, and no system takes a folder out of it."""
    return text.isprintable() and not {*text} & {*"/\\"}


def file_name(text: str) -> str:
    """A text that is the name of a file in a folder.

    Whatever has a name that people choose is called by it in files through here.

    Raises:
        ValueError: It is no name, or leads out of the folder.
    """
    if text in ("", ".", "..") or not is_in_one_line(text):
        raise ValueError(f"no name of a file, printable without / and \\: {text!r}")
    return text


def write_text(path: Path | str, text: str) -> None:
    """Write a text file; OSError as `atomic_write`."""
    with atomic_write(path) as aside:
        aside.write_text(text, "utf-8")


def _flush(path: Path) -> None:
    """Let what was written reach the disk before it gets its name."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


_PACKAGE = Path(__file__).resolve().parents[1]


def _data_dir(name: str) -> Path:
    """Folder `name` inside an installed wheel, else beside the package in a checkout."""
    packaged = _PACKAGE / "_data" / name
    return packaged if packaged.is_dir() else _PACKAGE.parent / name


def assets_dir() -> Path:
    """Folder of the exported MJCF scenes."""
    return _data_dir("assets")


def models_dir() -> Path:
    """Folder of trained artifacts and their model cards."""
    return _data_dir("models")


def firmware_dir() -> Path:
    """Folder of the microcontroller's sources."""
    return _data_dir("firmware")


def cache_dir() -> Path:
    """Folder for what is compiled: in the user's cache, else a private one for temporary files."""
    own = _user_cache()
    return private_dir() if own is None else own / "softrobot_env"


def give_caches_a_place() -> None:
    """Let Numba and Matplotlib keep files in `cache_dir` where they would find no place themselves.

    Numba looks beside the sources and in the user's cache, Matplotlib in the user's home, and tells
    of it at length; call it before they are loaded.
    """
    if _user_cache() is not None:
        return
    os.environ.setdefault("MPLCONFIGDIR", str(cache_dir() / "matplotlib"))
    if not os.access(_PACKAGE, os.W_OK):
        os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_dir() / "numba"))


def _user_cache() -> Path | None:
    """The user's folder of caches, None where nothing can be written."""
    with suppress(RuntimeError):  # there may be no home at all
        own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        there = next(place for place in (own, *own.parents) if place.exists())
        if there.is_dir() and os.access(there, os.W_OK):
            return own
    return None


@cache
def private_dir() -> Path:
    """A folder that nobody else can write to: what lies in a cache is run."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    path = Path(tempfile.gettempdir()) / f"softrobot_env-{user}"
    with suppress(OSError):
        path.mkdir(mode=0o700, exist_ok=True)
        found = path.lstat()
        if S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o077:
            return path
    return Path(tempfile.mkdtemp(prefix="softrobot_env-"))


#: Largest TOML file [bytes], which takes half a second, and largest of any other kind.
LARGEST_TABLE, LARGEST = 2**20, 2**34


#: What `readable` was asked for: results may depend on it.
FILES_READ: set[Path] = set()


def readable(path: Path | str, most: int = LARGEST) -> Path:
    """A path whose file has an end: not a device, nor a pipe, nor more bytes than asked for.

    Raises:
        ValueError: It is something else than a file, or too large.
        OSError: It is not there.
    """
    found = Path(path).stat()
    if S_ISDIR(found.st_mode):
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(path))
    if not S_ISREG(found.st_mode):
        raise ValueError(f"{path}: give a file, not a device or a pipe")
    if found.st_size > most:
        raise ValueError(f"{path}: at most {most} bytes, it has {found.st_size}")
    FILES_READ.add(Path(path).resolve())
    return Path(path)


def read_table(path: Path) -> dict[str, Any]:
    """The table that a TOML file holds.

    Raises:
        ValueError: The file is no TOML, or as of `readable`.
        OSError: The file cannot be read.
    """
    try:
        return tomllib.loads(readable(path, LARGEST_TABLE).read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"no TOML: {error}") from None
    except RecursionError:
        raise ValueError("no TOML that is read: it is nested too deeply") from None


def text(table: Mapping[str, Any]) -> str:
    """The text of a TOML file of a table; numbers are read back to the last bit."""
    import tomlkit  # few commands write one

    return tomlkit.dumps(table)
