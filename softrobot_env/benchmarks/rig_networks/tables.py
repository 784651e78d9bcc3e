"""Tables of `benchmarks.rig_networks`."""

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.benchmarks.rig_networks.cases import CellRow
from softrobot_env.benchmarks.rig_networks.friction import FrictionRow
from softrobot_env.benchmarks.rig_networks.run import InferenceRow, Row
from softrobot_env.identification.networks import TRAINING
from softrobot_env.rendering.tables import Column, make_table, new_table, pivot_table

#: Direction -> rms error [m], and computing times [s], in the thesis, secs. 3.2.4 and 5.1.2.
THESIS = {"forward": 0.77e-3, "inverse": 0.11e-3}
_THESIS_TIMES = {
    ("forward", "compiled"): 2.0e-6,
    ("inverse", "compiled"): 2.3e-6,
    ("forward", "plain"): 14.9e-6,
    ("inverse", "plain"): 14.9e-6,
}
_WHAT = {"forward": "s -> z", "inverse": "z -> s"}


def tables(rows: list[Row]) -> Group:
    """Errors by size, samples and friction, figures of the network that is used, its times."""
    cells = of_kind(rows, CellRow)
    sizes = groups(select(cells, study="size"), "direction")
    parts = [
        *(_sizes(mine, direction) for (direction,), mine in sizes.items()),
        _samples(select(cells, study="samples")),
        _used(select(cells, study="samples", samples=TRAINING)),
        _friction(of_kind(rows, FrictionRow)),
        _times(of_kind(rows, InferenceRow)),
    ]
    return Group(*(part for part in parts if part.row_count))


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.3f}"


def _sizes(cells: list[CellRow], direction: str) -> Table:
    found = groups(cells, "neurons", "layers")

    def cell(neurons: int, layers: int) -> str:
        mine = found.get((neurons, layers))
        return _millimetres(mine[0].e_rms) if mine else "-"

    return pivot_table(
        f"{direction}, {_WHAT[direction]}: rms error in mm on the test set, median",
        "neurons per layer",
        {str(n): n for n in sorted({row.neurons for row in cells})},
        {f"{n} layer{'s' * (n > 1)}": n for n in sorted({row.layers for row in cells})},
        cell,
    )


def _samples(cells: list[CellRow]) -> Table:
    found = groups(cells, "samples", "direction")
    return pivot_table(
        "Samples in the training set: rms error in mm on the test set, median (range)",
        "samples",
        {str(n): n for n in sorted({row.samples for row in cells})},
        list(dict.fromkeys(row.direction for row in cells)),
        lambda samples, direction: _spread(found.get((samples, direction), [])),
    )


def _spread(rows: list[CellRow]) -> str:
    if not rows:
        return "-"
    values = (rows[0].e_rms, rows[0].e_rms_least, rows[0].e_rms_largest)
    middle, least, largest = map(_millimetres, values)
    return f"{middle} ({least} to {largest})"


def _used(cells: list[CellRow]) -> Table:
    columns = (
        Column("network", lambda row: f"{row.direction}, {_WHAT[row.direction]}"),
        Column("rms mm", "e_rms", ".3f", "mm"),
        Column("thesis mm", lambda row: THESIS[row.direction], ".2f", "mm"),
        Column("max mm", "e_max", ".2f", "mm"),
        Column("steps", "iterations", "g"),
        Column("training s", "training_time", ".2f"),
    )
    return make_table(f"Networks of {TRAINING} samples, medians", columns, cells)


def _friction(rows: list[FrictionRow]) -> Table:
    directions = list(dict.fromkeys(row.direction for row in rows))
    title = "Stand-in without dither: rms error in mm on the test set, median (range)"
    out = new_table(title, ("friction N", "sum of tensions"), directions)
    for (total, friction), mine in groups(rows, "total", "friction").items():
        shown = "least" if total is None else f"{total:g} N"
        spreads = (_spread(select(mine, direction=direction)) for direction in directions)
        out.add_row(f"{friction:g}", shown, *spreads)
    if rows:
        out.add_row("thesis", "", *(f"{1e3 * THESIS[d]:.2f}" for d in directions))
    return out


def _times(rows: list[InferenceRow]) -> Table:
    columns = (
        Column("network", "direction"),
        Column("how", "variant"),
        Column("µs", "time", ".2f", "µs"),
        Column("thesis µs", lambda r: _THESIS_TIMES.get((r.direction, r.variant)), ".1f", "µs"),
    )
    return make_table("Computing time per sample", columns, rows)
