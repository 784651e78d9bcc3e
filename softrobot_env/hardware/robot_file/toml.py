"""Robot files: TOML with units in its keys."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from softrobot_env.core.toml_text import lines, read_table
from softrobot_env.core.writing import write_text
from softrobot_env.hardware.robot_file.keys import Key, RobotFileError, keys
from softrobot_env.hardware.robot_file.model import RobotFile, Servo, Supervision, Tip

_TENDONS, _SUPERVISION, _TIP = "tendons", "supervision", "tip"


def read_robot_file(path: Path) -> RobotFile:
    """Robot that a TOML file describes.

    Raises:
        RobotFileError: The file is no TOML or says what is not allowed; names file and key.
        OSError: The file cannot be read.
    """
    with _told_of(str(path)):
        try:
            table = read_table(path)
        except ValueError as error:
            raise RobotFileError(str(error)) from None
        return _robot(table)


def write_robot_file(robot: RobotFile, path: Path) -> None:
    """Write a robot to a TOML file that `read_robot_file` reads as the same robot."""
    table = _as_table(robot)
    servos, supervision, tip = table.pop(_TENDONS), table.pop(_SUPERVISION), table.pop(_TIP)
    blocks = [lines(table)]
    blocks += [f"[[{_TENDONS}]]\n{lines(_as_table(servo))}" for servo in servos]
    blocks.append(f"[{_SUPERVISION}]\n{lines(_as_table(supervision))}")
    blocks.append(f"[{_TIP}]\n{lines({'kind': tip.kind, **tip.options})}")
    write_text(path, "\n".join(blocks))


def _robot(table: Mapping[str, Any]) -> RobotFile:
    builders = {_TENDONS: _servos, _SUPERVISION: _supervision, _TIP: _tip}
    parts = {name: build(table[name]) for name, build in builders.items() if name in table}
    return _from_table(RobotFile, {_TENDONS: ()} | dict(table) | parts)


def _servos(value: Any) -> tuple[Servo, ...]:
    if not isinstance(value, list) or not all(isinstance(x, Mapping) for x in value):
        raise RobotFileError(f"{_TENDONS} must be tables, each begun with [[{_TENDONS}]]")
    servos = []
    for number, table in enumerate(value, 1):
        with _told_of(f"tendon {number}"):
            servos.append(_from_table(Servo, table))
    return tuple(servos)


def _supervision(value: Any) -> Supervision:
    with _told_of(_SUPERVISION):
        table = _table(value)
        channels = table.get("adc_channels", [])
        if not isinstance(channels, list):
            raise RobotFileError(f"adc_channels must be a list, got {channels!r}")
        return _from_table(Supervision, table | {"adc_channels": tuple(channels)})


def _tip(value: Any) -> Tip:
    with _told_of(_TIP):
        table = _table(value)
        return Tip(table.pop("kind", None), table)


def _table(value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise RobotFileError(f"must be a table, got {value!r}")
    return dict(value)


def _as_table(record: Any) -> dict[str, Any]:
    """A dataclass as the file has it."""
    table = {}
    for name, (written, key) in _written(type(record)).items():
        value = getattr(record, name)
        table[written] = value if key is None else key.written(value)
    return table


def _from_table(kind: type, table: Mapping[str, Any]) -> Any:
    """A dataclass from a table of the file.

    Raises:
        RobotFileError: A key is unknown or missing, or a text stands where a number belongs.
    """
    known = {written: (name, key) for name, (written, key) in _written(kind).items()}
    unknown = sorted(set(table) - set(known))
    if unknown:
        raise RobotFileError(f"unknown key {unknown[0]!r}; allowed are {', '.join(known)}")
    needed = {f.name for f in fields(kind) if f.default is f.default_factory is MISSING}
    missing = [key for key, (name, _) in known.items() if name in needed and key not in table]
    if missing:
        raise RobotFileError(f"{', '.join(missing)} missing")
    return kind(**{known[key][0]: _read(key, known[key][1], x) for key, x in table.items()})


def _written(kind: type) -> dict[str, tuple[str, Key | None]]:
    """Field of a dataclass -> its key in the file, and how its number is written."""
    known, names = keys(kind), [field.name for field in fields(kind)]
    return {name: (known[name].name if name in known else name, known.get(name)) for name in names}


def _read(written: str, key: Key | None, value: Any) -> Any:
    if key is None:
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RobotFileError(f"{written} must be a number, got {value!r}")
    return key.read(value)


@contextmanager
def _told_of(where: str) -> Iterator[None]:
    """Name the place in what goes wrong inside."""
    try:
        yield
    except RobotFileError as error:
        raise RobotFileError(f"{where}: {error}") from None
