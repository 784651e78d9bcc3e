"""TOML as the package's files have it: read as tables, written from them."""

import json
import tomllib
from collections.abc import Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any


def read_table(path: Path) -> dict[str, Any]:
    """The table that a TOML file holds.

    Raises:
        ValueError: The file is no TOML.
        OSError: The file cannot be read.
    """
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"no TOML: {error}") from None


def lines(table: Mapping[str, Any]) -> str:
    """The lines of a table; numbers are read back to the last bit."""
    return "".join(f"{_key(name)} = {_value(value)}\n" for name, value in table.items())


def _key(name: str) -> str:
    return name if name.isidentifier() and name.isascii() else _text(name)


def _text(text: str) -> str:
    """A text; JSON writes it as TOML does, but for one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{_key(name)} = {_value(inner)}" for name, inner in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Real) and not isinstance(value, bool):
        return repr(int(value)) if isinstance(value, Integral) else repr(float(value))
    return _text(value) if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
