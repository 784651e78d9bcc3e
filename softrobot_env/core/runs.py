"""Runs of many cases: rows of what was measured, in processes, kept until their report is written.

A run that was stopped goes on where it was: rows are lines of JSON with their case as key, and what
is there is not measured again.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from time import process_time
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints
from uuid import uuid4

import cloudpickle
import numpy as np
from numpy import ndarray

from . import __version__, sources
from .files import assets_dir, models_dir
from .interfaces import ProgressCallback, quiet
from .processes import worker_processes
from .registry import PACKAGES

# ---------------------------------------------------------------- rows


@dataclass(frozen=True)
class Row:
    """A row of a report; subclasses are frozen dataclasses of numbers and texts.

    Fields declared with `for_pictures()` hold what only pictures need, and stand in a file beside
    the report.
    """

    def row(self) -> dict[str, Any]:
        """What is written: column -> value in SI units, None where there is none."""
        return {name: getattr(self, name) for name in self.written()}

    @classmethod
    def written(cls) -> list[str]:
        """Columns of a row."""
        return [f.name for f in fields(cls) if f.metadata != _PLOTTED]

    def shown(self) -> dict[str, Any]:
        """What only the pictures need, where there is any."""
        mine = [f for f in fields(self) if f.metadata == _PLOTTED]
        values = {f.name: (getattr(self, f.name), f.default) for f in mine}
        return {name: value for name, (value, none) in values.items() if value is not none}


_PLOTTED = {"plotted": True}

#: The name of rows in studies.
Record = Row


def for_pictures(default: Any = None) -> Any:
    """A field of a record for pictures alone, such as arrays over time."""
    return field(default=default, metadata=_PLOTTED, repr=False)


# ---------------------------------------------------------------- rows as JSON


def packed(row: Any) -> dict[str, Any]:
    """All fields of a row, those for pictures too, with the name of its kind."""
    return {_KIND: type(row).__name__} | {f.name: getattr(row, f.name) for f in fields(row)}


def unpacked(values: Mapping[str, Any], kinds: Iterable[type]) -> Any:
    """The row that `packed` values say.

    Raises:
        ValueError: They are of none of the kinds, or a field does not hold what its type says.
    """
    known = {one.__name__: one for kind in kinds for one in (kind, *kind.__subclasses__())}
    try:
        kind = known[values[_KIND]]
        hints = _hints(kind)
        given = {k: v for k, v in values.items() if k != _KIND}
        return kind(**{name: as_typed(value, hints[name]) for name, value in given.items()})
    except (LookupError, TypeError) as error:
        raise ValueError(f"no row of {', '.join(known)}: {error}") from None


#: Key of a row's kind, and of an array's type of numbers: no field has this name.
_KIND = ""


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def as_typed(value: Any, hint: Any) -> Any:
    """A value of JSON as one of a type.

    Raises:
        TypeError, ValueError: It is none.
    """
    if hint is Any:
        hint = {list: list[Any], dict: dict[str, Any]}.get(type(value), Any)
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        for one in inner:
            with suppress(TypeError, ValueError):
                return as_typed(value, one)
    elif isinstance(value, dict) and "shape" in value and _KIND in value:
        if hint in (dict[str, Any], ndarray):
            return np.array(value["values"], value[_KIND]).reshape(value["shape"])
    elif hint is Any or (origin is Literal and value in inner):
        return value
    elif origin is dict and isinstance(value, dict) and _KIND not in value:
        return {k: as_typed(v, inner[1]) for k, v in value.items()}
    elif origin is list and isinstance(value, list):
        return [as_typed(one, inner[0]) for one in value]
    elif origin is tuple and isinstance(value, list):
        hints = [inner[0]] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(as_typed(one, h) for one, h in zip(value, hints, strict=True))
    elif isinstance(hint, type) and issubclass(hint, Enum):
        return hint(value)
    elif hint is NoneType and value is None:
        return value
    elif is_dataclass(hint) and isinstance(value, dict):
        return unpacked({_KIND: hint.__name__} | value, [hint])
    elif isinstance(hint, type) and isinstance(value, bool) == (hint is bool):
        wanted = int | float if hint is float else hint
        if isinstance(value, wanted):
            return value
    raise TypeError(f"{value!r:.60} is no {getattr(hint, '__name__', hint)}")


def _plain(value: Any) -> Any:
    """What JSON does not know of a row.

    Raises:
        TypeError: It is nothing that a row can hold.
    """
    if isinstance(value, ndarray):
        return {
            _KIND: value.dtype.str,
            "shape": list(value.shape),
            "values": value.ravel().tolist(),
        }
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value):
        return packed(value)
    raise TypeError(f"a row cannot hold {value!r:.60}")


def case_key(case: Any) -> str:
    """What tells a case from others: its fields or entries, in any order."""
    return json.dumps(case, sort_keys=True, default=_said)


def _said(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {"": type(value).__name__, **asdict(value)}
    return value.tolist() if isinstance(value, ndarray | np.generic) else str(value)


# ---------------------------------------------------------------- rows that are kept

#: Name of the file of kept rows in the folder of a report.
KEPT = ".kept.jsonl"


class Kept:
    """Rows of a study as lines of a file, each with its case, as they arrive.

    Args:
        path: The file.
        study: What is run, in words; rows of anything else, or of other sources, scenes or models
            of this package, are not taken up.
        files: What it depends on besides; nor are rows of other content of these.

    Attributes:
        taken: Number of cases that were there and could be used.
    """

    def __init__(self, path: Path, study: str, files: Iterable[Path] = ()) -> None:
        self.taken = 0
        self._path = path
        self._noted: set[str] = set()
        self._head = {"study": study, "content": _content({*_own_files(), *files})}
        self._head["version"] = __version__
        self._found = self._read()

    def _read(self) -> dict[str, Any]:
        """Cases and their rows; none where there are only those of something else."""
        with suppress(OSError, ValueError, TypeError):
            first, *lines = self._path.read_text("utf-8").split("\n")
            name = json.loads(first).pop("name")
            if json.loads(first) == self._head | {"name": name}:
                self._head["name"] = name
                found = {}
                for case, rows, names, seconds in _whole_lines(lines):
                    found[case] = rows
                    sources.add(names, seconds)
                return found
        return {}

    @property
    def name(self) -> str:
        """A name of this study, the same until it is done."""
        if "name" not in self._head:
            self._head["name"] = uuid4().hex
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._path.unlink(missing_ok=True)
            self._append(self._head)
        return self._head["name"]

    def rows(self, case: str, kinds: Iterable[type]) -> Any:
        """The row of a case, or its list of rows; None where there is none of these kinds."""
        found = self._found.get(case)
        with suppress(ValueError, AttributeError, TypeError):
            rows = [unpacked(x, kinds) for x in found] if isinstance(found, list) else None
            rows = unpacked(found, kinds) if isinstance(found, dict) else rows
            self.taken += rows is not None
            return rows
        return None

    def add(self, case: str, rows: Any, names: Iterable[str] = (), seconds: float = 0.0) -> None:
        """Keep the row of a case, or its list of rows, and what they depend on and took.

        Args:
            case, rows: What was measured.
            names, seconds: As of `sources.add`.

        Raises:
            OSError: They cannot be written.
            TypeError: They hold what JSON does not.
        """
        assert self.name
        several = isinstance(rows, list)
        kept = [packed(row) for row in rows] if several else packed(rows)
        self._append([case, kept, sorted({*names} - self._noted), seconds])
        self._noted.update(names)

    def _append(self, line: Any) -> None:
        text = json.dumps(line, default=_plain)
        with self._path.open("ab") as file:
            # What was cut short before stays a line of its own.
            file.write(("" if file.tell() == 0 else "\n").encode() + text.encode())
            file.flush()
            os.fsync(file.fileno())

    def end(self) -> None:
        """Forget all, as the study is done."""
        self._path.unlink(missing_ok=True)


def _whole_lines(lines: Iterable[str]) -> Iterator[tuple[str, Any, list[str], float]]:
    """Lines that were not cut short: a case, its rows, what they depend on, and their CPU time."""
    for line in lines:
        with suppress(ValueError, TypeError):
            case, rows, names, seconds = json.loads(line)
            yield str(case), rows, [*map(str, names)], float(seconds)


@contextmanager
def kept_rows(path: Path, study: str, files: Iterable[Path] = ()) -> Iterator[Kept]:
    """Rows that are kept in a file until the context ends without an error.

    Write within it what the rows are for: until then they are kept.

    Args:
        path, study, files: See `Kept`.
    """
    kept = Kept(path, study, files)
    yield kept
    kept.end()


@cache
def _own_files() -> tuple[Path, ...]:
    """Sources, scenes, robots and models of this package."""
    folders = ((Path(__file__).parents[1], "*.py"), (assets_dir(), "*"), (models_dir(), "*"))
    return tuple(path for folder, what in folders for path in folder.rglob(what))


def _content(files: Iterable[Path]) -> str:
    """Which content files have."""
    digest = sha256()
    for path in sorted({path.resolve() for path in files if path.is_file()}):
        content = path.read_bytes()
        digest.update(f"{path} {len(content)} ".encode() + content)
    return digest.hexdigest()


# ---------------------------------------------------------------- cases and jobs


@dataclass(frozen=True)
class _Done:
    """What was measured of a case, what it depends on, and the CPU time [s] that it took."""

    result: Any
    sources: set[str]
    seconds: float


#: How often jobs whose process has ended are begun.
_TRIES = 3


def run_cases(
    cases: Iterable[Any],
    measure: Callable[[Any], Any],
    *,
    kinds: Iterable[type] = (),
    kept: Kept | None = None,
    key: Callable[[Any], str] = case_key,
    label: Callable[[Any], str] = str,
    arrived: Callable[[Any, Any], Any] | None = None,
    progress: ProgressCallback = quiet,
    processes: int | None = None,
) -> list[Any]:
    """What is measured of cases, in their order; the first error of one is raised.

    Cases whose process is killed are begun anew. Processes may be given, and return, anything that
    cloudpickle takes, such as what a user's file defines.

    Args:
        cases: The cases, begun in this order, each in a process with one thread.
        measure: From a case to what is measured; of what is kept to a row, or a list of rows:
            dataclasses of numbers, texts and arrays.
        kinds: Classes of the rows, for those that are kept.
        kept: Where rows are kept as they arrive; what is there is not measured.
        key: What tells a case from others.
        label: Of a case, for the progress bar.
        arrived: Makes rows, in this process, of a case and what was measured of it; for results
            that are more than rows.
        progress: Shows the cases that are done, at first and after each.
        processes: Cases at a time, unless the user chose (`processes.using`); one per core unless
            given. 0 does one after the other here, and tells the progress before each.

    Raises:
        RuntimeError: Processes end again and again.
    """
    cases, kinds, found = list(cases), tuple(kinds), {}
    named = [f"{_name(measure)} {key(case)}" for case in cases]
    for number, name in enumerate(named if kept is not None else ()):
        if (rows := kept.rows(name, kinds)) is not None:
            found[number] = rows

    def take(number: int, done: _Done) -> None:
        result = done.result
        found[number] = result if arrived is None else arrived(cases[number], result)
        sources.add(done.sources)
        if kept is not None:
            kept.add(named[number], found[number], done.sources, done.seconds)

    for number, case in enumerate(cases if processes == 0 else ()):
        if number not in found:
            progress(label(case), number, len(cases))
            take(number, _measured(measure, case))
    progress("done" if processes == 0 else "running", len(found), len(cases))
    for _ in range(_TRIES):
        try:
            for number, done in _arriving(cases, measure, found, processes):
                take(number, done)
                progress(label(cases[number]), len(found), len(cases))
        except BrokenExecutor:
            continue
        return [found[number] for number in range(len(cases))]
    waiting = [label(case) for number, case in enumerate(cases) if number not in found]
    raise RuntimeError(
        f"worker processes ended {_TRIES} times, as they do without memory; left of {len(cases)} "
        f"jobs: {', '.join(waiting[:3])}{' ...' if len(waiting) > 3 else ''}"
    )


def _name(function: Any) -> str:
    """What a function is called, of one with some arguments given too."""
    return _name(function.func) if isinstance(function, partial) else function.__qualname__


def _arriving(
    cases: Sequence[Any],
    measure: Callable[[Any], Any],
    found: Mapping[int, Any],
    processes: int | None,
) -> Iterator[tuple[int, _Done]]:
    """Numbers and results of those cases that are not found yet, as they arrive."""
    left = [number for number in range(len(cases)) if number not in found]
    if not left:
        return
    with worker_processes(processes) as pool:
        running = {
            pool.submit(_work, cloudpickle.dumps((measure, cases[n], PACKAGES))): n for n in left
        }
        failed: BaseException | None = None
        for future in as_completed(running):
            if future.cancelled():
                continue
            error = future.exception()
            if error is None:
                yield running[future], cloudpickle.loads(future.result())
            elif failed is None:  # what is under way ends, and counts
                failed = error
                for other in running:
                    other.cancel()
    if failed is not None:
        raise failed


def _work(work: bytes) -> bytes:
    """What a packed function did with its case, packed; with the packages that count."""
    return cloudpickle.dumps(_measured(*cloudpickle.loads(work)))


def _measured(measure: Callable[[Any], Any], case: Any, packages: Iterable[str] = ()) -> _Done:
    begun = process_time()
    result = measure(case)
    return _Done(result, sources.used(packages), process_time() - begun)
