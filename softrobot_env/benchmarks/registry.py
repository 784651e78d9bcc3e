"""The benchmarks by name. What one imports is loaded when it is asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group

from softrobot_env.registries import Registry


@dataclass(frozen=True)
class Benchmark:
    """How to measure, show and draw.

    Attributes:
        run: From `quick` and a function (description, done, total) that shows progress to rows.
        tables: Rows as tables of a terminal.
        plot: Draws rows to a PNG of the given path, and others beside it; None if there is no
            picture.
    """

    run: Callable[..., list[dict]]
    tables: Callable[[list[dict]], Group]
    plot: Callable[[list[dict], Path], None] | None = None


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
    from softrobot_env.benchmarks.speed import run

    return Benchmark(run.run, run.tables)


def _stability() -> Benchmark:
    from softrobot_env.benchmarks.stability import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


def _thesis() -> Benchmark:
    from softrobot_env.benchmarks.thesis import plots, run, tables

    return Benchmark(run.run, tables.tables, plots.plot)


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
