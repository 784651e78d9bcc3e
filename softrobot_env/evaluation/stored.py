"""Writes and reads the results of a study; its pictures are drawn from these files alone.

`report.json` has the rows; `drawn.npz` next to it, if present, holds data for pictures only.
"""

import gzip
import json
from collections.abc import Iterable, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, get_type_hints

from softrobot_env.core.artifacts import read_tree, write_tree
from softrobot_env.core.runs import Record, as_typed

from .report import write_json
from .rollout import Rollout

REPORT, DRAWN = "report.json", "drawn.npz"


def write(folder: Path, records: Sequence[Record], command: str) -> None:
    """Write both files; `command` is the one that made them.

    Raises:
        ValueError: A row holds NaN or infinity.
    """
    rows = [record.row() for record in records]
    write_json(folder / REPORT, rows, command)
    shown = {k: _plain(record.shown()) for k, record in enumerate(records) if record.shown()}
    if shown:
        write_tree(folder / DRAWN, {"report": _digest(rows), "fields": shown})


def command(folder: Path) -> str:
    """The command that made the report of a folder.

    Raises:
        FileNotFoundError, ValueError: See `read`.
    """
    return _content(_report(folder))[1]


def read(folder: Path, kinds: Iterable[type[Record]]) -> list[Record]:
    """The records of a study.

    Args:
        folder: Folder of `write`; the report may be compressed with gzip.
        kinds: Their classes, or base classes.

    Raises:
        FileNotFoundError: There is no report.
        ValueError: The report or `drawn.npz` is damaged or belongs to another study.
    """
    path = _report(folder)
    rows = _rows(path)
    by_columns = {frozenset(_columns(kind)): kind for kind in _with_derived(kinds)}
    found = []
    for number, row in enumerate(rows):
        kind = by_columns.get(frozenset(row)) if isinstance(row, dict) else None
        if kind is None:
            raise ValueError(f"{path}: row {number + 1} is none of this benchmark")
        try:
            values = {k: as_typed(row[k], hint) for k, hint in _columns(kind).items()}
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: row {number + 1} is damaged: {error}") from None
        found.append((kind, values))
    shown = _shown(folder / DRAWN, rows)
    return [kind(**values, **shown.get(k, {})) for k, (kind, values) in enumerate(found)]


def _report(folder: Path) -> Path:
    packed = folder / f"{REPORT}.gz"
    return packed if packed.exists() and not (folder / REPORT).exists() else folder / REPORT


def _rows(path: Path) -> list[Any]:
    rows, _ = _content(path)
    if not isinstance(rows, list) or not rows:
        raise ValueError(f"{path} is no report, or damaged")
    return rows


def _content(path: Path) -> tuple[Any, str]:
    """Rows of a report, and the command that made it."""
    try:
        content = path.read_bytes()
        content = gzip.decompress(content) if path.suffix == ".gz" else content
        found = json.loads(content)
        return found["rows"], found["meta"]["command"]
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no report to redraw") from None
    except (ValueError, LookupError, TypeError, EOFError, OSError) as error:
        raise ValueError(f"{path} is no report, or damaged") from error


def _shown(path: Path, rows: list[Any]) -> dict[int, dict[str, Any]]:
    """Values of fields for pictures, by the number of the row."""
    if not path.exists():
        return {}
    tree = read_tree(path)
    try:
        report, fields = tree["report"], tree["fields"]
        made = {
            number: {k: _shown_value(v) for k, v in values.items()}
            for number, values in fields.items()
        }
    except (AttributeError, LookupError, TypeError) as error:
        raise ValueError(f"{path} is not what pictures need, or damaged") from error
    if report != _digest(rows):
        raise ValueError(f"{path} belongs to another report than the {REPORT} beside it")
    return made


_ROLLOUT = "rollout"


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Values for a tree of plain data, without episodes."""
    return {k: {_ROLLOUT: vars(v)} if isinstance(v, Rollout) else v for k, v in values.items()}


def _shown_value(value: Any) -> Any:
    is_rollout = isinstance(value, dict) and value.keys() == {_ROLLOUT}
    return Rollout(**value[_ROLLOUT]) if is_rollout else value


def _digest(rows: list[Any]) -> str:
    return sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()


def _with_derived(kinds: Iterable[type[Record]]) -> list[type[Record]]:
    found = list(kinds)
    for kind in found:  # grows
        found += kind.__subclasses__()
    return found


@cache
def _columns(kind: type[Record]) -> dict[str, Any]:
    """Types of the columns written for a record."""
    return {k: hint for k, hint in get_type_hints(kind).items() if k in kind.written()}
