"""Tables of named columns, CSV and Parquet."""

import csv
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from softrobot_env.core.extras import install_command
from softrobot_env.core.writing import whole

#: Columns (t,) by name.
Columns = dict[str, np.ndarray]

_DECIMAL_COMMA = re.compile(r"^(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*)$")


def check_writable(path: Path | str) -> None:
    """Refuse a file that `write_columns` would refuse, before there is something to write.

    Raises:
        ValueError: It has another ending than .csv or .parquet.
        ImportError: The package that writes such files is missing; the message tells which.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise ValueError(f"{path}: recordings are written as .csv or .parquet")
    if suffix == ".parquet":
        with needed("pyarrow", "Parquet files"):
            import pyarrow  # noqa: F401


def write_columns(columns: Columns, path: Path | str) -> None:
    """Write a CSV or Parquet file, by its ending; errors as `check_writable`."""
    check_writable(path)
    with whole(path) as aside:
        (_write_csv if aside.suffix.lower() == ".csv" else _write_parquet)(columns, aside)


def read_csv(path: Path) -> Columns:
    """The columns of a CSV file as texts; lines that begin with # are comments.

    Columns are parted by what the line of names has most of: commas, tabs or semicolons. With
    semicolons a decimal comma is a point.

    Raises:
        ValueError: It is no text, there are no rows, or one has another number of columns than
            there are names.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for line in file if not line.startswith("#")]
        parted = max(",\t;", key=lines[0].count) if lines else ","
        rows = list(csv.reader(lines, delimiter=parted))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: no CSV file in UTF-8, or damaged: {error}") from None
    if not rows:
        raise ValueError(f"{path}: the file is empty")
    names = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(names):
            raise ValueError(f"{path}: row {number} has {len(row)} columns instead of {len(names)}")
    if len(rows) == 1:
        raise ValueError(f"{path}: there are no rows below the names of the columns")
    if parted == ";":
        rows = [[_DECIMAL_COMMA.sub(r"\1.\2", text) for text in row] for row in rows]
    texts = np.array(rows[1:])
    return {name: texts[:, k] for k, name in enumerate(names)}


def _write_csv(columns: Columns, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(_texts(column) for column in columns.values()), strict=True))


def _texts(column: np.ndarray) -> list[str]:
    if column.dtype.kind == "f":
        return [f"{value:.9g}" for value in column]
    return [str(value) for value in column]


def read_parquet(path: Path) -> Columns:
    """The columns of a Parquet file.

    Raises:
        ValueError: It is none.
        ImportError: The package pyarrow is missing.
    """
    with needed("pyarrow", "Parquet files"):
        from pyarrow import parquet
    try:
        table = parquet.read_table(path)
    except Exception as error:  # of pyarrow's own kinds
        told = " ".join(str(error).split())
        raise ValueError(f"{path}: no Parquet file, or damaged: {told}") from None
    columns = {}
    for name in table.column_names:
        values = table.column(name).to_numpy()
        columns[name] = values.astype(str) if values.dtype.kind == "O" else values
    return columns


def _write_parquet(columns: Columns, path: Path) -> None:
    with needed("pyarrow", "Parquet files"):
        from pyarrow import parquet, table
    parquet.write_table(table({name: list(column) for name, column in columns.items()}), path)


@contextmanager
def needed(package: str, what: str) -> Iterator[None]:
    """Import within it what is not always there.

    Raises:
        ImportError: It is missing; the message tells what to install.
    """
    try:
        yield
    except ImportError:
        raise ImportError(f"{what} need {package}: {install_command('recordings')}") from None
