"""Recordings read from files and written to them."""

from pathlib import Path

import numpy as np
from numpy import ndarray

from softrobot_env.core.files import readable
from softrobot_env.core.records import placed

from .columns import Columns, read_csv, read_mcap, read_minari, read_parquet, write_columns
from .header import UNITS, Header, read_header, write_header
from .recording import Recording, since_begin


def header_path(path: Path | str) -> Path:
    """Where the header of a table lies: beside it, with the ending .toml."""
    return Path(path).with_suffix(".toml")


def read_recording(path: Path | str, header: Header | Path | str | None = None) -> Recording:
    """The recording that a table holds.

    Args:
        path: CSV or Parquet file, MCAP file, or folder of a Minari data set.
        header: The header, or a file of it that counts before what the one beside the table says;
            the one beside the table unless given.

    Raises:
        ValueError: Table or header say what is not allowed; one line with the file's name.
        ImportError: The package that reads such files is missing; the message tells which.
        OSError: A file cannot be read.
    """
    if not Path(path).exists():
        raise FileNotFoundError(f"{path}: no such file")
    known = header if isinstance(header, Header) else _header_of(Path(path), header)
    columns = _columns(Path(path), known)
    with placed(path):
        return recording_of(columns, known)


def _columns(path: Path, header: Header) -> Columns:
    if path.is_dir():
        return read_minari(path)
    kind = readable(path).suffix.lower()
    if kind == ".mcap":
        return read_mcap(path, header)
    if kind not in (".csv", ".parquet"):
        raise ValueError(f"{path}: recordings are .csv, .parquet, .mcap, or folders of Minari")
    return read_csv(path) if kind == ".csv" else read_parquet(path)


def _header_of(path: Path, header: Path | str | None) -> Header:
    beside = header_path(path)
    found = [beside] if beside.is_file() else []
    if header is None and not found:
        raise FileNotFoundError(
            f"{path} has no header: write {beside.name} beside it, or name one by --header "
            "(assets/recordings has an example)"
        )
    return read_header(*found, *([] if header is None else [header]))


def recording_of(columns: Columns, header: Header) -> Recording:
    """The recording in columns (t,) of a table.

    Raises:
        ValueError: A column is missing, holds no numbers, or the times do not rise.
    """
    missing = [name for name in header.columns if name not in columns]
    if missing:
        raise ValueError(f"column {missing[0]!r} is missing; there are {', '.join(columns)}")
    rows = len(next(iter(columns.values())))
    runs = _runs(columns, header, rows)
    frame, marked = header.frame, np.full((rows, len(header.marker), 3), np.nan)
    for k, marker in enumerate(header.marker):
        for axis, name in enumerate(marker.columns):
            if name is not None:
                values = _numbers(columns, name, marker.may_be_lost, _HOW_LOST)
                marked[:, k, axis] = UNITS["length"][marker.unit] * values
    commands = np.stack([_numbers(columns, name) for name in header.commands.columns], axis=1)
    labels = columns[header.label].astype(str) if header.label else np.full(rows, "")
    return Recording(
        header=header,
        times=_times(columns, header, runs),
        commands=commands * header.commands.scale + header.commands.offset,
        markers=frame.to_world(marked),
        labels=labels,
        runs=runs,
    )


def _runs(columns: Columns, header: Header, rows: int) -> ndarray:
    if header.runs is None:
        return np.zeros(rows, int)
    values = columns[header.runs]
    return np.append(0, np.cumsum(values[1:] != values[:-1])) if rows else np.zeros(0, int)


def _times(columns: Columns, header: Header, runs: ndarray) -> ndarray:
    """(t,) [s] since the first row of each run."""
    if header.time is None:
        times = np.arange(len(runs)) / (header.rate_Hz or 1.0)
    else:
        times = _numbers(columns, header.time.column)
    elapsed = since_begin(times, runs)  # before scaling: epochs are large
    return elapsed * (1.0 if header.time is None else UNITS["time"][header.time.unit])


#: Cells without a number, beside "nan", and what a header must say for them.
_EMPTY = ("", "na", "n/a", "none", "null")
_HOW_LOST = "; where it may be lost, its marker needs may_be_lost = true"


def _numbers(columns: Columns, name: str, may_be_lost: bool = False, hint: str = "") -> ndarray:
    """A column (t,) as finite numbers, or NaN where that may be; the hint is for empty cells."""
    values = columns[name]
    if values.dtype.kind in "US":
        numbers = []
        for row, text in enumerate(values.tolist(), 1):
            is_empty = text.strip().lower() in _EMPTY
            try:
                numbers.append(float("nan" if is_empty and may_be_lost else text))
            except ValueError:
                raise ValueError(
                    f"row {row}: column {name!r} must be a number, got {text!r}"
                    f"{hint if is_empty else ''}"
                ) from None
        values = np.array(numbers)
    if values.dtype.kind not in "iufb":
        raise ValueError(f"column {name!r} holds no numbers")
    values = values.astype(float)
    bad = np.flatnonzero(np.isinf(values) | (np.isnan(values) & (not may_be_lost)))
    if len(bad):
        value = values[bad[0]]
        more = hint if np.isnan(value) else ""
        raise ValueError(f"row {bad[0] + 1}: column {name!r} must be finite, got {value}{more}")
    return values


def write_recording(recording: Recording, path: Path | str) -> None:
    """Write a table, CSV or Parquet by its ending, and its header beside it.

    They are read as the same recording, to 9 digits where the table is CSV.

    Raises:
        ValueError: Another ending, or two columns of one name.
        ImportError: The package that writes such files is missing; the message tells which.
    """
    head = recording.header
    columns: Columns = {}
    if head.time is not None:
        columns[head.time.column] = recording.times / UNITS["time"][head.time.unit]
    if head.runs is not None:
        columns[head.runs] = recording.runs
    if head.label is not None:
        columns[head.label] = recording.labels
    raw = (recording.commands - head.commands.offset) / head.commands.scale
    columns |= dict(zip(head.commands.columns, raw.T, strict=True))
    for k, marker in enumerate(head.marker):
        points = head.frame.to_recorded(recording.markers[:, k]) / UNITS["length"][marker.unit]
        for axis, name in enumerate(marker.columns):
            if name is not None:
                columns[name] = points[:, axis]
    if len(columns) < len(head.columns):
        raise ValueError(f"{path}: the header names a column twice: {', '.join(head.columns)}")
    write_columns(columns, path)
    write_header(head, header_path(path))
