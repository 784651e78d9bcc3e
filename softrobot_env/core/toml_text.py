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


def text(table: Mapping[str, Any], path: str = "") -> str:
    """The text of a table; numbers are read back to the last bit.

    Tables in it, and lists of tables, follow under their names.

    Args:
        table: The table.
        path: Of the table within the file, ending with a dot.
    """
    inner = {name: value for name, value in table.items() if _is_inner(value)}
    plain = {name: value for name, value in table.items() if name not in inner}
    blocks = ["".join(f"{_key(name)} = {_value(value)}\n" for name, value in plain.items())]
    for name, value in inner.items():
        place = path + _key(name)
        if isinstance(value, Mapping):
            blocks.append(f"[{place}]\n{text(value, f'{place}.')}")
        else:
            blocks += [f"[[{place}]]\n{text(one, f'{place}.')}" for one in value]
    return "\n".join(blocks)


def _is_inner(value: Any) -> bool:
    """Whether a value is a table or tables."""
    tables = value if isinstance(value, list | tuple) else [value]
    return bool(tables) and all(isinstance(one, Mapping) for one in tables)


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
