"""What a run depends on: modules that it loaded, here and in its workers, and files that it read.

A report records them with a digest of each, which tells later whether its code is still the same.
Comments, docstrings, formatting and the version do not count.
"""

import ast
import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from time import time
from typing import Any

from .files import FILES_READ, assets_dir, firmware_dir, models_dir
from .registry import PACKAGES

#: What shows and records rows, and makes none.
_SHOWING = (
    "softrobot_env.cli",
    "softrobot_env.commands.arguments",
    "softrobot_env.commands.benchmark",
    "softrobot_env.commands.output",
    "softrobot_env.commands.registry",
    "softrobot_env.core.sources",
    "softrobot_env.rendering.figures",
    "softrobot_env.rendering.tables",
    "studies",
)

#: Before what this run depends on was loaded.
_STARTED = time()

_added: set[str] = set()
_seconds_added = 0.0


def used(packages: Iterable[str] = ()) -> set[str]:
    """What this process loaded and read so far, and what `add` said.

    Modules of this package and of those whose code was asked for by name, such as `studies.laws`;
    files of a checkout that `readable` gave, and a script that is run, such as `models/rig_nn.npz`.

    Args:
        packages: Others whose modules count.
    """
    counted = PACKAGES.union(packages)
    modules = {name for name in list(sys.modules) if name.partition(".")[0] in counted}
    script = vars(sys.modules["__main__"]).get("__file__")
    files = FILES_READ | ({Path(script).resolve()} if script else set())
    named = {
        f"{name}/{file.relative_to(folder).as_posix()}"
        for name, folder in _folders().items()
        for file in files
        if file.is_relative_to(folder)
    }
    return modules.difference(_SHOWING) | named | _added


def add(names: Iterable[str], seconds: float = 0.0) -> None:
    """Count what another process used, and the CPU time of a run that is gone on with."""
    global _seconds_added
    _added.update(names)
    _seconds_added += seconds


def cpu_seconds() -> float:
    """CPU time of this process, of those it began that have ended, and of what `add` said."""
    return sum(os.times()[:4]) + _seconds_added


def recorded() -> dict[str, str]:
    """What is used, with digests; they are empty where a file was written since the run began."""
    places = {name: place for name in sorted(used()) if (place := _place(name)) is not None}
    return {
        name: "" if place.stat().st_mtime > _STARTED else digest(place)
        for name, place in places.items()
    }


def changed(record: Mapping[str, str]) -> list[str]:
    """Names whose content is another one than that `recorded`, or that are gone."""
    places = {name: _place(name) for name in record if name not in _SHOWING}
    return [k for k, place in places.items() if place is None or digest(place) != record[k]]


@cache
def _folders() -> dict[str, Path]:
    """Folders of files that count, by name."""
    scripts = Path(__file__).resolve().parents[2] / "scripts"
    folders = models_dir(), assets_dir(), firmware_dir(), scripts
    return {folder.name: folder for folder in folders}


def _place(name: str) -> Path | None:
    """The file of a name, found without importing anything; None if no Python code or data is."""
    folder, slash, rest = name.partition("/")
    if slash:
        files = [_folders()[folder] / rest] if folder in _folders() else []
    else:
        package, *parts = name.split(".")
        files = [
            file
            for base in _bases(package)
            for file in (Path(base, *parts).with_suffix(".py"), Path(base, *parts, "__init__.py"))
        ]
    return next((file for file in files if file.is_file()), None)


@cache
def _bases(package: str) -> tuple[str, ...]:
    """Folders of a package, or of a module that is one file its path without suffix."""
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):
        return ()
    if spec is None or spec.submodule_search_locations is None:
        return () if spec is None else (str(Path(spec.origin or "").with_suffix("")),)
    return tuple(spec.submodule_search_locations)


def digest(file: Path) -> str:
    """Eight hexadecimal digits that change with what a file says."""
    return _digest_since(file, file.stat().st_mtime_ns)


@cache
def _digest_since(file: Path, _written: int) -> str:
    content = file.read_bytes()
    content = _meaning(ast.parse(content)).encode() if file.suffix == ".py" else content
    return sha256(content).hexdigest()[:8]


def _meaning(node: Any) -> str:
    """A syntax tree as text that is the same in all versions of Python."""
    if isinstance(node, list):
        return "[" + ",".join(_meaning(one) for one in node if not _says_nothing(one)) + "]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = {name: getattr(node, name, None) for name in node._fields}
    said = (f"{k}={_meaning(v)}" for k, v in fields.items() if v is not None and v != [])
    return f"{type(node).__name__}({','.join(said)})"


def _says_nothing(node: Any) -> bool:
    """Whether a statement is a docstring, or the version."""
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id == "__version__"
    text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return text and isinstance(node.value.value, str)
