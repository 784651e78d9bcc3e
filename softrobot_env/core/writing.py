"""Files are written whole or not at all: a full disk or a kill leaves what was there before."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EEXIST
from pathlib import Path
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


def write_text(path: Path | str, text: str) -> None:
    """Write a text file; OSError as `atomic_write`."""
    with atomic_write(path) as aside:
        aside.write_text(text, encoding="utf-8")


def _flush(path: Path) -> None:
    """Let what was written reach the disk before it gets its name."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())
