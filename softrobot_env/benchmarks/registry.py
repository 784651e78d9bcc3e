"""The benchmarks by name. What one imports is loaded when it is asked for.

A benchmark is a folder with the modules `run`, `tables` and `plots` or `figures`. `run` returns a
list of records (`benchmarks.records`): frozen dataclasses derived from `Record`, whose `row()` is
what report.json has of them, less the fields declared with `drawn()`. Tables and pictures are made
of the same records. A mapping is taken for a record too; it is written without its entry "trace".
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Group

from softrobot_env.benchmarks.records import Record
from softrobot_env.registries import Registry

Records = Sequence[Record | dict[str, Any]]


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


def _accuracy() -> Benchmark:
    from softrobot_env.benchmarks.accuracy import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _controllers() -> Benchmark:
    from softrobot_env.benchmarks.controllers import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _generalization() -> Benchmark:
    from softrobot_env.benchmarks.generalization import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _learning() -> Benchmark:
    from softrobot_env.benchmarks.learning import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _rig() -> Benchmark:
    from softrobot_env.benchmarks.rig import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _rig_networks() -> Benchmark:
    from softrobot_env.benchmarks.rig_networks import plots, run, tables

    return Benchmark(run.run_on_twin, tables.tables, plots.plot)


def _speed() -> Benchmark:
    from softrobot_env.benchmarks.speed import run, tables

    return Benchmark(run.run, tables.tables)


def _stability() -> Benchmark:
    from softrobot_env.benchmarks.stability import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _thesis() -> Benchmark:
    from softrobot_env.benchmarks.thesis import figures, run, tables

    return Benchmark(run.run, tables.tables, figures.plot)


#: Name -> function that loads the benchmark.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry(
    "benchmark",
    {
        "accuracy": _accuracy,
        "controllers": _controllers,
        "generalization": _generalization,
        "learning": _learning,
        "rig": _rig,
        "rig_networks": _rig_networks,
        "speed": _speed,
        "stability": _stability,
        "thesis": _thesis,
    },
)
