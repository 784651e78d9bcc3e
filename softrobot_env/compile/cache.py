"""A cache of compiled functions that knows all their sources, so that none is ever stale."""

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from time import monotonic, sleep
from typing import IO, Any

from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # not on Windows, where processes may compile the same at once
    flock = None

#: Longest wait [s] for another process that compiles the same, and between two looks at it.
_PATIENCE, _PAUSE = 120.0, 0.05


@cache
def digest_of(places: tuple[Path, ...]) -> str:
    """Digest of some sources, of folders those in them and below."""
    digest = sha256()
    for source in sources_in(places):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def sources_in(places: tuple[Path, ...]) -> list[Path]:
    """Sources by their paths, and those in folders and below."""
    found = (sorted(p.rglob("*.py")) if p.is_dir() else [p] for p in dict.fromkeys(places))
    return [source for sources in found for source in sources]


class CacheFiles(IndexDataCacheFile):
    """Files of one function, each named by the sources and the types that it was compiled for.

    Numba numbers them in an index, which processes that compile at the same time overwrite for each
    other: a function would then be loaded for types that it does not take.
    """

    def __init__(self, files: IndexDataCacheFile, sources: str) -> None:
        self._cache_path = files._cache_path
        self._base = files._index_name.removesuffix(".nbi")
        self._of = sha256(f"{files._version} {sources}".encode()).hexdigest()[:12]

    def _name(self, key: Any) -> str:
        return f"{self._base}.{self._of}.{sha256(repr(key).encode()).hexdigest()[:20]}.nbc"

    def load(self, key: Any) -> Any:
        """What was stored under a key, None if nothing was."""
        try:
            return self._load_data(self._name(key))
        except OSError:
            return None

    def save(self, key: Any, data: Any) -> None:
        """Store something; what other sources gave is removed."""
        for old in Path(self._cache_path).glob(f"{self._base}.*"):
            if not old.name.startswith(f"{self._base}.{self._of}."):
                old.unlink(missing_ok=True)
        self._save_data(self._name(key), data)

    def flush(self) -> None:
        """Forget everything."""
        for old in Path(self._cache_path).glob(f"{self._base}.*"):
            old.unlink(missing_ok=True)


def _lock(path: Path) -> IO | None:
    """A file locked for this process until it is closed, None if it stays locked by another."""
    file = path.open("wb")
    end = monotonic() + _PATIENCE
    while monotonic() < end:
        try:
            flock(file, LOCK_EX | LOCK_NB)
            return file
        except BlockingIOError:
            sleep(_PAUSE)
    file.close()
    return None


class SourceCache(FunctionCache):
    """Numba's cache, which watches the file of the function alone, for one that calls others.

    An edit of any of some sources recompiles, or of any in a folder of them: that of the function
    unless others are given, and this one. Of several processes that need a function, one compiles
    it, and the others wait.
    """

    def __init__(self, function: Callable, *places: Path) -> None:
        super().__init__(function)
        places = places or (Path(function.__code__.co_filename).parent,)
        self._cache_file = CacheFiles(self._cache_file, digest_of((*places, Path(__file__).parent)))
        self._locks: dict[Any, IO] = {}

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super()._load_overload(sig, target_context)
        if found is None and self._enabled and flock is not None:
            name = self._cache_file._name(self._index_key(sig, target_context.codegen()))
            with suppress(OSError):
                self._impl.locator.ensure_cache_path()
                lock = _lock(Path(self._cache_path, name).with_suffix(".lock"))
                if lock is not None:
                    self._locks[sig] = lock
            found = super()._load_overload(sig, target_context)
            if found is not None:
                self._unlock(sig)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled function; other processes need not wait for it any more."""
        super().save_overload(sig, data)
        self._unlock(sig)

    def _unlock(self, sig: Any) -> None:
        lock = self._locks.pop(sig, None)
        if lock is not None:
            Path(lock.name).unlink(missing_ok=True)
            lock.close()

    def unlock(self) -> None:
        """Let other processes compile what could not be compiled here."""
        for sig in list(self._locks):
            self._unlock(sig)


class _Failures(event.Listener):
    """Unlocks what could not be compiled."""

    def on_start(self, _: event.Event) -> None:
        pass

    def on_end(self, ended: event.Event) -> None:
        cache = ended.data["dispatcher"]._cache
        if sys.exc_info()[0] is not None and isinstance(cache, SourceCache):
            cache.unlock()


event.register("numba:compile", _Failures())
