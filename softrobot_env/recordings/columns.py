"""Tables of named columns: CSV, Parquet, MCAP files of robot middleware, and Minari data sets."""

import csv
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.extras import needed
from softrobot_env.core.files import atomic_write

from .header import Header

#: Columns (t,) by name.
Columns = dict[str, ndarray]

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
        with needed("Parquet files need pyarrow", "recordings"):
            import pyarrow  # noqa: F401


def write_columns(columns: Columns, path: Path | str) -> None:
    """Write a CSV or Parquet file, by its ending; errors as `check_writable`."""
    check_writable(path)
    with atomic_write(path) as aside:
        if aside.suffix.lower() == ".parquet":
            from pyarrow import parquet, table

            lists = {name: list(column) for name, column in columns.items()}
            parquet.write_table(table(lists), aside)
            return
        texts = (
            [f"{value:.9g}" if column.dtype.kind == "f" else str(value) for value in column]
            for column in columns.values()
        )
        with aside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*texts, strict=True))


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


def read_parquet(path: Path) -> Columns:
    """The columns of a Parquet file.

    Raises:
        ValueError: It is none.
        ImportError: The package pyarrow is missing.
    """
    with needed("Parquet files need pyarrow", "recordings"):
        from pyarrow import parquet
    columns = {}
    try:
        table = parquet.read_table(path)
        for name in table.column_names:
            values = table.column(name).to_numpy()
            columns[name] = values.astype(str) if values.dtype.kind == "O" else values
    except Exception as error:  # of pyarrow's own kinds
        text = " ".join(str(error).split())
        raise ValueError(f"{path}: no Parquet file, or damaged: {text}") from None
    return columns


def read_mcap(path: Path, header: Header) -> Columns:
    """The columns of an MCAP file: fields of messages such as "/tip.x" or "/servos.position.3".

    A row is a message of the topic of the first marker, or else of the commands; fields of other
    topics are the last ones before. Rows begin when every topic that the header names has spoken.
    "log_time" and "publish_time" are in ns.

    Raises:
        ValueError: No MCAP file, messages that nothing here decodes, or a topic that is missing.
        ImportError: The package mcap, or mcap_ros2 for messages of ROS 2, is missing.
    """
    with needed("MCAP files need mcap", "recordings"):
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    columns = [name for name in header.columns if "." in name]
    topics = list(dict.fromkeys(name.partition(".")[0] for name in columns))
    leading = [name for marker in header.marker for name in marker.columns if name]
    lead = [*leading, *columns, ""][0].partition(".")[0]
    known: dict[str, dict[str, Any]] = {}
    rows: list[dict[str, Any]] = []
    with path.open("rb") as file:
        try:
            for topic, times, message in _messages(make_reader(file), topics):
                known[topic] = {f"{topic}.{name}": value for name, value in _fields(message)}
                if topic == lead and len(known) == len(topics):
                    rows.append(times | {k: v for one in known.values() for k, v in one.items()})
        except McapError as error:
            raise ValueError(f"{path}: no MCAP file, or damaged: {error}") from None
        if not rows:
            there = ", ".join(sorted(_topics(make_reader(file)))) or "none"
            missing = ", ".join(t for t in topics if t not in known) or ", ".join(topics) or "none"
            raise ValueError(f"{path}: no rows with the topics {missing}; there are {there}")
    names = [name for name in rows[0] if all(name in row for row in rows)]
    return {name: np.array([row[name] for row in rows]) for name in names}


def _messages(reader: Any, topics: list[str]) -> Iterator[tuple[str, dict[str, int], Any]]:
    """Topic, times [ns] and decoded content of messages, in the order of their log times."""
    decoders: dict[int, Any] = {}
    for schema, channel, message in reader.iter_messages(topics=topics):
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(schema, channel)
        times = {"log_time": message.log_time, "publish_time": message.publish_time}
        yield channel.topic, times, decoders[channel.id](message.data)


def _decoder(schema: Any, channel: Any) -> Any:
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding != "cdr":
        raise ValueError(
            f"messages of {channel.topic} are {encoding!r}; what can be read is json, and cdr of "
            "ROS 2"
        )
    with needed("messages of ROS 2 need mcap-ros2-support", "recordings"):
        from mcap_ros2.decoder import DecoderFactory
    return DecoderFactory().decoder_for(encoding, schema)


def _topics(reader: Any) -> set[str]:
    summary = reader.get_summary()
    return set() if summary is None else {x.topic for x in summary.channels.values()}


def _fields(message: Any, name: str = "") -> Iterable[tuple[str, Any]]:
    """Numbers and texts within a message, by the names that lead to them."""
    if isinstance(message, dict):
        parts = message.items()
    elif isinstance(message, list | tuple | ndarray):
        parts = enumerate(message)
    elif hasattr(message, "__slots__") and not isinstance(message, np.generic):
        parts = ((slot, getattr(message, slot)) for slot in message.__slots__)
    else:
        yield name, message
        return
    for key, value in parts:
        yield from _fields(value, f"{name}.{key}" if name else str(key))


def read_minari(path: Path) -> Columns:
    """The columns of a Minari data set: "action.0", "observation.tip_position.1", "episode".

    A row is an observation with the action that follows it; the last one of an episode has the
    action before again. The header needs `rate_Hz` and `runs = "episode"`.

    Raises:
        ValueError: The folder holds no data set.
        ImportError: The package minari, or what it needs to read the set, is missing.
    """
    with needed("Minari data sets need minari", "recordings"):
        from minari import MinariDataset
    folder = path / "data" if (path / "data").is_dir() else path
    try:
        episodes = list(MinariDataset(folder).iterate_episodes())
    except (OSError, KeyError, AssertionError, ValueError) as error:
        raise ValueError(f"{path}: no Minari data set: {error}") from None
    parts = [_episode(number, episode) for number, episode in enumerate(episodes)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _episode(number: int, episode: Any) -> Columns:
    seen = _arrays("observation", episode.observations)
    rows = len(next(iter(seen.values())))
    done = _arrays("action", episode.actions)
    following = np.minimum(np.arange(rows), len(next(iter(done.values()))) - 1)
    actions = {name: values[following] for name, values in done.items()}
    return {"episode": np.full(rows, number)} | seen | actions


def _arrays(name: str, values: Any) -> Columns:
    """Columns of arrays (t, ...), which may be in dicts and tuples."""
    if isinstance(values, dict | tuple):
        parts = values.items() if isinstance(values, dict) else enumerate(values)
        return {k: v for key, x in parts for k, v in _arrays(f"{name}.{key}", x).items()}
    values = np.asarray(values)
    if values.ndim == 1:
        return {name: values}
    flat = values.reshape(len(values), -1)
    return {f"{name}.{k}": column for k, column in enumerate(flat.T)}
