"""What is written where, by Python's audit of files that are opened, made, moved and removed."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

from softrobot_env.core.files import cache_dir, private_dir

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = {"os.mkdir", "os.remove", "os.rmdir", "os.rename", "os.link", "os.symlink"}

#: Where paths are noted; hooks cannot be removed, so that one stays and mostly does nothing.
_noted: list[list[Path]] = []


def _note(event, args):
    if not _noted:
        return
    if event == "open":
        changed = args[:1] if args[2] & _WRITING else ()
    else:
        changed = args[:2] if event in _CHANGES else ()
    paths = (path for path in changed if isinstance(path, str | bytes | os.PathLike))
    _noted[-1].extend(Path.cwd() / os.fsdecode(path) for path in paths)


sys.addaudithook(_note)


@contextmanager
def outside(*folders):
    """Yield a list of what is written elsewhere than to folders, caches and locks, at the end."""
    allowed = [Path(folder).resolve() for folder in (*folders, cache_dir(), private_dir(), "/dev")]
    _noted.append([])
    found = []
    try:
        yield found
    finally:
        for path in map(Path, map(os.path.normpath, _noted.pop())):
            cached = "__pycache__" in path.parts
            if not cached and not any(path.is_relative_to(one) for one in allowed):
                found.append(path)
