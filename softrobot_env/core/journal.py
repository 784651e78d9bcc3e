"""Results of jobs, kept as they arrive, so that a study that was stopped goes on where it was.

They are pickles, which can run anything when they are read. So each has a seal made with a key that
only this user can read, and what has none is left alone.
"""

import hmac
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path

from softrobot_env.core import __version__
from softrobot_env.core.paths import assets_dir, cache_dir, models_dir
from softrobot_env.core.writing import whole

#: Folder of kept results, in that of a study.
FOLDER = ".kept"

_KEY, _SEAL = "journal.key", 32  # [B] of a seal, and of the key
_TRIES = 3
_PACKAGE = Path(__file__).resolve().parents[1]


class Journal:
    """Kept results of one study.

    Args:
        folder: Of the study.
        study: What is run, in words; results of anything else, or of other sources, scenes or
            models of this package, are not taken up.
        files: What it depends on besides; nor are results of other content of these.

    Attributes:
        taken: Number of results that were there and could be used.
    """

    def __init__(self, folder: Path, study: str, files: Iterable[Path] = ()) -> None:
        self.taken = 0
        self._folder = folder / FOLDER
        self._study = f"{study} {__version__} {_content({*_own_files(), *files})}"
        self._key, self._round = _key(), 0

    def begin(self) -> int:
        """Number of the next set of jobs, as a study may have several."""
        self._round += 1
        return self._round

    def read(self, job: str) -> bytes | None:
        """The kept result of a job; None where there is none that was written by this user."""
        try:
            sealed = self._path(job).read_bytes()
        except OSError:
            return None
        seal, kept = sealed[:_SEAL], sealed[_SEAL:]
        if not hmac.compare_digest(seal, self._seal(job, kept)):
            return None
        return kept

    def write(self, job: str, kept: bytes) -> None:
        """Keep the result of a job."""
        with whole(self._path(job)) as aside:
            aside.write_bytes(self._seal(job, kept) + kept)

    def end(self) -> None:
        """Forget all, as the study is done."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _path(self, job: str) -> Path:
        return self._folder / f"{sha256(f'{self._study} {job}'.encode()).hexdigest()[:32]}.pickle"

    def _seal(self, job: str, kept: bytes) -> bytes:
        return hmac.digest(self._key, f"{self._study} {job} ".encode() + kept, "sha256")


_OPEN: ContextVar[Journal | None] = ContextVar("journal", default=None)


def current() -> Journal | None:
    """The journal that `kept_in` has opened."""
    return _OPEN.get()


@contextmanager
def kept_in(folder: Path, study: str, files: Iterable[Path] = ()) -> Iterator[Journal]:
    """Keep results of jobs in a folder until the context ends without an error.

    Write within it what the results are for: until then they are kept.

    Args:
        folder, study, files: See `Journal`.
    """
    journal = Journal(folder, study, files)
    token = _OPEN.set(journal)
    try:
        yield journal
        journal.end()
    finally:
        _OPEN.reset(token)


def _key() -> bytes:
    """This user's key on this machine; one that others may know or that is cut short is replaced.

    Raises:
        OSError: There is no place for it.
    """
    path = cache_dir() / _KEY
    path.parent.mkdir(parents=True, exist_ok=True)
    for _ in range(_TRIES):
        with suppress(FileExistsError), open(path, "xb", opener=_private) as file:
            file.write(os.urandom(_SEAL))
        with path.open("rb") as file:
            key, state = file.read(), os.fstat(file.fileno())
        mine = not hasattr(os, "getuid") or (
            state.st_uid == os.getuid() and not state.st_mode & 0o077
        )
        if mine and len(key) == _SEAL:
            return key
        path.unlink(missing_ok=True)
    raise OSError(f"{path} does not stay as it is written")


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _own_files() -> list[Path]:
    """Sources, scenes, robots and models of this package."""
    data = [path for folder in (assets_dir(), models_dir()) for path in folder.rglob("*")]
    return [*_PACKAGE.rglob("*.py"), *data]


def _content(files: Iterable[Path]) -> str:
    """Which content files have."""
    digest = sha256()
    for path in sorted({path.resolve() for path in files if path.is_file()}):
        content = path.read_bytes()
        digest.update(f"{path} {len(content)} ".encode() + content)
    return digest.hexdigest()
