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
        options: Further keywords of `run`, out of those of `softrobot benchmark`.
    """

    run: Callable[..., Records]
    tables: Callable[[Records], Group]
    plot: Callable[[Records, Path], None] | None = None
    options: tuple[str, ...] = ()


def _found_at(
    run: str, tables: str, plot: str | None = None, options: tuple[str, ...] = ()
) -> Callable[[], Benchmark]:
    """What loads a benchmark whose functions are at these paths."""
    paths = (run, tables) if plot is None else (run, tables, plot)
    return lambda: Benchmark(*map(load, paths), options=options)


#: Name -> function that loads the benchmark.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry(
    "benchmark",
    {
        "accuracy": _found_at(
            "softrobot_env.benchmarks.accuracy.run:run",
            "softrobot_env.benchmarks.accuracy.tables:tables",
            "softrobot_env.benchmarks.accuracy.plots:plot",
        ),
        "contacts": _found_at(
            "softrobot_env.benchmarks.contacts.run:run",
            "softrobot_env.benchmarks.contacts.tables:tables",
            "softrobot_env.benchmarks.contacts.plots:plot",
        ),
        "controllers": _found_at(
            "softrobot_env.benchmarks.controllers.run:run",
            "softrobot_env.benchmarks.controllers.tables:tables",
            "softrobot_env.benchmarks.controllers.plots:plot",
        ),
        "generalization": _found_at(
            "softrobot_env.benchmarks.generalization.run:run",
            "softrobot_env.benchmarks.generalization.tables:tables",
            "softrobot_env.benchmarks.generalization.plots:plot",
        ),
        "learning": _found_at(
            "softrobot_env.benchmarks.learning.run:run",
            "softrobot_env.benchmarks.learning.tables:tables",
            "softrobot_env.benchmarks.learning.plots:plot",
        ),
        "ppo_defaults": _found_at(
            "softrobot_env.benchmarks.ppo_defaults.run:run",
            "softrobot_env.benchmarks.ppo_defaults.tables:tables",
            "softrobot_env.benchmarks.ppo_defaults.plots:plot",
        ),
        "rig": _found_at(
            "softrobot_env.benchmarks.rig.run:run",
            "softrobot_env.benchmarks.rig.tables:tables",
            "softrobot_env.benchmarks.rig.plots:plot",
        ),
        "rig_networks": _found_at(
            "softrobot_env.benchmarks.rig_networks.run:run_on_twin",
            "softrobot_env.benchmarks.rig_networks.tables:tables",
            "softrobot_env.benchmarks.rig_networks.plots:plot",
        ),
        "scenes": _found_at(
            "softrobot_env.benchmarks.scenes.run:run",
            "softrobot_env.benchmarks.scenes.tables:tables",
            "softrobot_env.benchmarks.scenes.plots:plot",
            options=("count", "seed"),
        ),
        "sections": _found_at(
            "softrobot_env.benchmarks.sections.run:run",
            "softrobot_env.benchmarks.sections.tables:tables",
            "softrobot_env.benchmarks.sections.plots:plot",
        ),
        "speed": _found_at(
            "softrobot_env.benchmarks.speed.run:run",
            "softrobot_env.benchmarks.speed.tables:tables",
        ),
        "stability": _found_at(
            "softrobot_env.benchmarks.stability.run:run",
            "softrobot_env.benchmarks.stability.tables:tables",
            "softrobot_env.benchmarks.stability.plots:plot",
        ),
        "thesis": _found_at(
            "softrobot_env.benchmarks.thesis.run:run",
            "softrobot_env.benchmarks.thesis.tables:tables",
            "softrobot_env.benchmarks.thesis.figures:plot",
        ),
    },
)
