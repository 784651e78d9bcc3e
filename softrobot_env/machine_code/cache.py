"""A cache of compiled functions that knows all their sources, so that none is ever stale."""

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile


@cache
def digest_of(places: tuple[Path, ...]) -> str:
    """Digest of the sources in some folders and below."""
    digest = sha256()
    for place in dict.fromkeys(places):
        for source in sorted(place.rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


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


class SourceCache(FunctionCache):
    """Numba's cache, which watches the file of the function alone, for one that calls others.

    An edit of any source in some folders recompiles: that of the function unless others are given,
    and this one.
    """

    def __init__(self, function: Callable, *places: Path) -> None:
        super().__init__(function)
        places = places or (Path(function.__code__.co_filename).parent,)
        self._cache_file = CacheFiles(self._cache_file, digest_of((*places, Path(__file__).parent)))
