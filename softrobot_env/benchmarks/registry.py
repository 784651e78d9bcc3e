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


def _of(run: str, tables: str, plot: str | None = None) -> Callable[[], Benchmark]:
    """What loads a benchmark, from paths `folder.module:name` in this package."""

    def find() -> Benchmark:
        paths = (run, tables) if plot is None else (run, tables, plot)
        return Benchmark(*(load(f"{__package__}.{path}") for path in paths))

    return find


#: Name -> function that loads the benchmark.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry(
    "benchmark",
    {
        "accuracy": _of("accuracy.run:run", "accuracy.tables:tables", "accuracy.plots:plot"),
        "controllers": _of(
            "controllers.run:run", "controllers.tables:tables", "controllers.plots:plot"
        ),
        "generalization": _of(
            "generalization.run:run", "generalization.tables:tables", "generalization.plots:plot"
        ),
        "learning": _of("learning.run:run", "learning.tables:tables", "learning.plots:plot"),
        "rig": _of("rig.run:run", "rig.tables:tables", "rig.plots:plot"),
        "rig_networks": _of(
            "rig_networks.run:run_on_twin", "rig_networks.tables:tables", "rig_networks.plots:plot"
        ),
        "speed": _of("speed.run:run", "speed.tables:tables"),
        "stability": _of("stability.run:run", "stability.tables:tables", "stability.plots:plot"),
        "thesis": _of("thesis.run:run", "thesis.tables:tables", "thesis.figures:plot"),
    },
)
