"""Tables of `benchmarks.rig_networks`."""

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.controllers.cells import new_table
from softrobot_env.benchmarks.jobs import Row
from softrobot_env.identification.networks import TRAINING

#: Direction -> rms error [m], and computing times [s], in the thesis, secs. 3.2.4 and 5.1.2.
THESIS = {"forward": 0.77e-3, "inverse": 0.11e-3}
_THESIS_TIMES = {
    ("forward", "compiled"): 2.0e-6,
    ("inverse", "compiled"): 2.3e-6,
    ("forward", "plain"): 14.9e-6,
    ("inverse", "plain"): 14.9e-6,
}
_WHAT = {"forward": "s -> z", "inverse": "z -> s"}


def select(rows: list[Row], **fields: object) -> list[Row]:
    """Rows with given values of some fields."""
    return [row for row in rows if all(row.get(k) == v for k, v in fields.items())]


def tables(rows: list[Row]) -> Group:
    """Errors by size, samples and friction, figures of the network that is used, its times."""
    directions = list(dict.fromkeys(row["direction"] for row in rows))
    sizes = [_sizes(select(rows, study="size", direction=d), d) for d in directions]
    found = [_samples(rows, directions), _used(rows, directions), _friction(rows, directions)]
    parts = [*sizes, *found, _times(rows)]
    return Group(*(part for part in parts if part.row_count))


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.3f}"


def _sizes(rows: list[Row], direction: str) -> Table:
    layers = sorted({row["layers"] for row in rows})
    title = f"{direction}, {_WHAT[direction]}: rms error in mm on the test set, median"
    heads = [f"{n} layer{'s' if n > 1 else ''}" for n in layers]
    out = new_table(title, ("neurons per layer",), heads)
    for neurons in sorted({row["neurons"] for row in rows}):
        found = [select(rows, layers=n, neurons=neurons) for n in layers]
        cells = [_millimetres(mine[0]["e_rms"]) if mine else "-" for mine in found]
        out.add_row(str(neurons), *cells)
    return out


def _samples(rows: list[Row], directions: list[str]) -> Table:
    rows = select(rows, study="samples")
    title = "Samples in the training set: rms error in mm on the test set, median (range)"
    out = new_table(title, ("samples",), directions)
    for samples in sorted({row["samples"] for row in rows}):
        found = [select(rows, direction=d, samples=samples) for d in directions]
        out.add_row(str(samples), *(_spread(mine[0]) if mine else "-" for mine in found))
    return out


def _spread(row: Row) -> str:
    middle, least, largest = (
        _millimetres(row[name]) for name in ("e_rms", "e_rms_least", "e_rms_largest")
    )
    return f"{middle} ({least} to {largest})"


def _used(rows: list[Row], directions: list[str]) -> Table:
    heads = ("rms mm", "thesis mm", "max mm", "steps", "training s")
    out = new_table(f"Networks of {TRAINING} samples, medians", ("network",), heads)
    for direction in directions:
        for row in select(rows, study="samples", direction=direction, samples=TRAINING):
            out.add_row(
                f"{direction}, {_WHAT[direction]}",
                _millimetres(row["e_rms"]),
                f"{1e3 * THESIS[direction]:.2f}",
                f"{1e3 * row['e_max']:.2f}",
                f"{row['iterations']:g}",
                f"{row['training_time']:.2f}",
            )
    return out


def _friction(rows: list[Row], directions: list[str]) -> Table:
    rows = select(rows, study="friction")
    title = "Stand-in without dither: rms error in mm on the test set, median (range)"
    out = new_table(title, ("friction N", "sum of tensions"), directions)
    for total, friction in dict.fromkeys((row["total"], row["friction"]) for row in rows):
        mine = [select(rows, total=total, friction=friction, direction=d) for d in directions]
        shown = "least" if total is None else f"{total:g} N"
        out.add_row(f"{friction:g}", shown, *(_spread(found[0]) for found in mine))
    if rows:
        out.add_row("thesis", "", *(f"{1e3 * THESIS[d]:.2f}" for d in directions))
    return out


def _times(rows: list[Row]) -> Table:
    out = new_table("Computing time per sample", ("network", "how"), ("us", "thesis us"))
    for row in select(rows, study="inference"):
        thesis = _THESIS_TIMES.get((row["direction"], row["variant"]))
        shown = "-" if thesis is None else f"{1e6 * thesis:.1f}"
        out.add_row(row["direction"], row["variant"], f"{1e6 * row['time']:.2f}", shown)
    return out
