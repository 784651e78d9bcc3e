"""Studies by name, which `softrobot benchmark` runs: the registry and what a study has to be.

Those of this package are in its checkout (`scripts/studies`), which registers them as any package
registers its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from .registry import PACKAGES, Registry, load, package_of
from .runs import Kept


class Benchmark(Protocol):
    """How to measure, show and draw.

    Attributes:
        kinds: Dataclasses of its rows, derived from `Record`.
        options: Further keywords of `run`, out of those of `softrobot benchmark`.
        alone: Whether it runs one job after the other, as it measures times that other jobs would
            lengthen, or as its parts need each other.
        draw: Draws rows to a PNG of the given path, or others beside it; None without pictures.
        sources: Files that rows depend on besides the package, if it says so.
    """

    kinds: tuple[type, ...]
    options: tuple[str, ...]
    alone: bool
    draw: Callable[[Sequence[Any], Path], None] | None

    def run(
        self,
        quick: bool,
        progress: Callable | None = None,
        kept: Kept | None = None,
        **options: Any,
    ) -> list[Any]:
        """Rows; `progress` is called with (description, done, total), `kept` is for `run_cases`."""

    def show(self, rows: Sequence[Any]) -> Any:
        """Rows as tables of a terminal, anything that rich prints."""


@dataclass(frozen=True)
class Entry:
    """A study that is loaded when it is asked for.

    Attributes:
        path: Where it is, `package.module:name`.
        about: What it measures, in a line.
    """

    path: str
    about: str = ""

    def __call__(self) -> Benchmark:
        """The study."""
        return load(self.path)


#: Name -> function that loads the study.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry("benchmark", {})


def register_study(name: str, study: Benchmark | str, about: str = "") -> None:
    """Add a study, or where it is (`package.module:name`), to those of `softrobot benchmark`.

    Raises:
        ValueError: The name is taken, or no name.
    """
    if isinstance(study, str):
        BENCHMARKS.register(name, Entry(study, about))
    else:
        BENCHMARKS.register(name, lambda: study)
        PACKAGES.update(package_of(kind.__module__) for kind in study.kinds)


def measured(name: str) -> str:
    """What a study measures, in a line; "" if it does not say."""
    return getattr(BENCHMARKS[name], "about", "")
