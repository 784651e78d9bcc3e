"""The benchmarks by name. What one imports is loaded when it is asked for.

A benchmark is a folder with the modules `run`, `tables` and `plots` or `figures`. `run` returns a
list of records (`benchmarks.records`): frozen dataclasses derived from `Record`, whose `row()` is
what report.json has of them, less the fields declared with `drawn()`. Tables and pictures are made
of the same records.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group

from softrobot_env.benchmarks.records import Record
from softrobot_env.registries import Registry, load

Records = Sequence[Record]


@dataclass(frozen=True)
class Benchmark:
    """How to measure, show and draw.

    Attributes:
        run: From `quick` and a function (description, done, total) that shows progress to records.
        tables: Records as tables of a terminal.
        plot: Draws records to a PNG of the given path, and others beside it; None if there is no
            picture.
    """

    run: Callable[..., Records]
    tables: Callable[[Records], Group]
    plot: Callable[[Records, Path], None] | None = None


def _find(
    folder: str, run: str = "run:run", plot: str | None = "plots:plot"
) -> Callable[[], Benchmark]:
    """What loads a benchmark from its folder; `run` and `plot` are paths `module:name` in it."""
    paths = (run, "tables:tables", *([] if plot is None else [plot]))
    return lambda: Benchmark(*(load(f"{__package__}.{folder}.{path}") for path in paths))


#: Name -> function that loads the benchmark.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry(
    "benchmark",
    {
        "accuracy": _find("accuracy"),
        "controllers": _find("controllers"),
        "generalization": _find("generalization"),
        "learning": _find("learning"),
        "rig": _find("rig"),
        "rig_networks": _find("rig_networks", run="run:run_on_twin"),
        "speed": _find("speed", plot=None),
        "stability": _find("stability"),
        "thesis": _find("thesis", plot="figures:plot"),
    },
)
