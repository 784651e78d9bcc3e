"""The only place that knows where assets/, models/ and firmware/ are, and what is compiled."""

import os
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from stat import S_ISDIR

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
