"""Studies that have not yet moved to `scripts/studies`, each an attribute of this module."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from rich.console import Group

from softrobot_env.benchmarks.records import Record
from softrobot_env.core.registry import load


@dataclass(frozen=True)
class Old:
    """A study as a folder with the modules `run`, `tables` and `plots`."""

    run: Callable[..., Sequence[Record]]
    show: Callable[[Sequence[Record]], Group]
    draw: Callable[[Sequence[Record], Path], None] | None = None
    options: tuple[str, ...] = ()
    alone: bool = False

    @property
    def kinds(self) -> tuple[type[Record], ...]:
        """Rows that `run` returns by its annotation."""
        (what,) = get_args(get_type_hints(self.run)["return"])
        return get_args(what) or (what,)


_OTHERS: dict[str, dict[str, Any]] = {
    "laws": {},
    "transfer": {},
}


def __getattr__(name: str) -> Old:
    if name not in _OTHERS:
        raise AttributeError(name)
    own = {"run": "run:run", "draw": "plots:plot"} | _OTHERS[name]
    for key in ("run", "draw"):
        own[key] = own[key] and load(f"{__package__}.{name}.{own[key]}")
    return Old(show=load(f"{__package__}.{name}.tables:tables"), **own)
