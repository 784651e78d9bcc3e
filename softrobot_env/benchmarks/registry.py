"""The benchmarks by name. What one imports is loaded when it is asked for.

A benchmark is a folder with the modules `run`, `tables` and `plots` or `figures`. `run` returns a
list of records (`benchmarks.records`): frozen dataclasses derived from `Record`, whose `row()` is
what report.json has of them, less the fields declared with `for_pictures()`, which `drawn.npz` has.
Tables and pictures are made of the same records, pictures of those in the files
(`benchmarks.stored`), so that they can be drawn again at any time.
"""

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group

from softrobot_env.benchmarks.records import Record
from softrobot_env.core.registry import Registry, load

Records = Sequence[Record]


@dataclass(frozen=True)
class Benchmark:
    """How to measure, show and draw.

    Attributes:
        run: From `quick` and a function (description, done, total) that shows progress to records,
            `list[Kind | Kind]` by its annotation.
        tables: Records as tables of a terminal.
        plot: Draws records to a PNG of the given path, and others beside it; None if there is no
            picture.
        options: Further keywords of `run`, out of those of `softrobot benchmark`.
        alone: Whether it runs one job after the other, as it measures times that other jobs would
            lengthen, or as its parts need each other.
    """

    run: Callable[..., Records]
    tables: Callable[[Records], Group]
    plot: Callable[[Records, Path], None] | None = None
    options: tuple[str, ...] = ()
    alone: bool = False


def _in_folder(
    name: str,
    run: str = "run:run",
    plot: str | None = "plots:plot",
    options: tuple[str, ...] = (),
    alone: bool = False,
) -> Callable[[], Benchmark]:
    """What loads the benchmark in a folder; its functions are at these places in it."""
    places = (run, "tables:tables") if plot is None else (run, "tables:tables", plot)
    paths = [f"{__package__}.{name}.{place}" for place in places]
    return lambda: Benchmark(*map(load, paths), options=options, alone=alone)


#: Name -> function that loads the benchmark.
BENCHMARKS: Registry[Callable[[], Benchmark]] = Registry(
    "benchmark",
    {
        "accuracy": _in_folder("accuracy", alone=True),
        "contacts": _in_folder("contacts"),
        "controllers": _in_folder("controllers", alone=True),
        "feedback": _in_folder("feedback"),
        "generalization": _in_folder("generalization"),
        "gripper": _in_folder("gripper"),
        "identify": _in_folder("identify"),
        "laws": _in_folder("laws"),
        "learning": _in_folder("learning"),
        "peers": _in_folder("peers", plot=None, alone=True),
        "ppo_defaults": _in_folder("ppo_defaults"),
        "reduction": _in_folder("reduction"),
        "rig": _in_folder("rig", alone=True),
        "rig_networks": _in_folder("rig_networks", run="run:run_on_twin"),
        "scale": _in_folder("scale", plot=None, alone=True),
        "scenes": _in_folder("scenes", options=("count", "seed")),
        "sections": _in_folder("sections", alone=True),
        "sensing": _in_folder("sensing", alone=True),
        "speed": _in_folder("speed", plot=None, alone=True),
        "stability": _in_folder("stability", alone=True),
        "thesis": _in_folder("thesis", plot="figures:plot", alone=True),
        "transfer": _in_folder("transfer"),
    },
)


def measured(name: str) -> str:
    """What a benchmark measures, in a line: what its folder says; "" of one from elsewhere."""
    source = Path(__file__).with_name(name) / "__init__.py"
    if not source.is_file():
        return ""
    text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ")
