"""Tables of `benchmarks.reduction`."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.benchmarks.reduction.rows import (
    DataRow,
    LoopRow,
    OrderRow,
    PathRow,
    Row,
    SpectrumRow,
)
from softrobot_env.rendering.tables import Column, make_table, new_table, number

_NOTE = (
    "Predictions are from rest and the inputs alone, two laps. Each model is learned from motion "
    "of the same rig: the thesis' settings from 70 decays and 28 min of random inputs, the others "
    "from 70 decays and 30 min of random inputs and laps. NMTE: mean error over the largest "
    "distance of the tip from rest. Settings were chosen on the rig without errors and on twin 0."
)


def tables(rows: Sequence[Row]) -> Group:
    """Errors of models by path and speed, what sets them, and closed loops."""
    paths = of_kind(rows, PathRow)
    parts = [_paths(twin, mine) for (twin,), mine in groups(paths, "twin").items()]
    orders, amounts = of_kind(rows, OrderRow), of_kind(rows, DataRow)
    if orders:
        parts.append(_orders(orders))
    if amounts:
        parts.append(make_table("Improved model, unseen random motion", _AMOUNTS, amounts))
    parts.append(make_table("Triangle, closed loop", _LOOPS, of_kind(rows, LoopRow)))
    parts.append(make_table("Modes of decays", _MODES, of_kind(rows, SpectrumRow)))
    return Group(*parts, Text(_NOTE))


def rig_name(twin: int | None) -> str:
    """Name of a rig for people."""
    return "without errors" if twin is None else f"twin {twin}"


def _paths(twin: int | None, rows: list[PathRow]) -> Table:
    periods = [p for (p,) in groups(rows, "period")]
    title = (
        f"Rig {rig_name(twin)}: mean error in mm over rectangle and circle (goal), by the period "
        "of a lap; NMTE of the slowest and of the fastest"
    )
    heads = [*(f"{p:g} s" for p in periods), "NMTE %", "learned s", "25 s in ms"]
    out = new_table(title, ("model",), heads)
    for (model,), mine in groups(rows, "model").items():
        cells = [_cell(select(mine, period=p)) for p in periods]
        share = " / ".join(_share(select(mine, period=p)) for p in (periods[0], periods[-1]))
        times = number(mine[0].fit_time, ".2g"), number(mine[0].predict_time, ".2g", "ms")
        out.add_row(model, *cells, share, *times)
    return out


def _cell(rows: list[PathRow]) -> str:
    means = [row.mean for row in rows]
    if None in means:
        return "diverges"
    mean, goal = sum(means) / len(means), rows[0].goal
    text = f"{1e3 * mean:.2g}"
    if goal is None:
        return text
    return f"{text} ({1e3 * goal:g}{'' if mean <= goal else ' missed'})"


def _share(rows: list[PathRow]) -> str:
    shares = [row.nmte for row in rows]
    return "-" if None in shares else f"{100 * sum(shares) / len(shares):.2g}"


def _orders(rows: list[OrderRow]) -> Table:
    sizes = [p for (p,) in groups(rows, "p")]
    out = new_table(
        f"Fig. 3.14, rig {rig_name(rows[0].twin)}: RMS error in mm of unseen random motion of 25 s",
        ("n_w",),
        [f"p = {p}" for p in sizes],
    )
    for (order,), mine in groups(rows, "shape_order").items():
        cells = [number(row.rms, ".3g", "mm", "diverges") for row in mine]
        out.add_row(str(order), *cells)
    return out


_AMOUNTS = (
    Column("min of motion", "minutes", "g"),
    Column("order", "order", "d"),
    Column("RMS mm", "rms", ".3g", "mm"),
    Column("learned in s", "fit_time", ".3g"),
    Column("25 s in ms", "predict_time", ".3g", "ms"),
)

_LOOPS = (
    Column("rig", lambda row: rig_name(row.twin)),
    Column("policy"),
    Column("lap s", "period", "g"),
    Column("mean mm", "mean", ".3g", "mm"),
    Column("largest mm", "largest", ".3g", "mm"),
    Column("goal mm", "goal", "g", "mm"),
    Column("decides ms", "decision", ".2g", "ms"),
    Column("99 % ms", "longest", ".2g", "ms"),
    Column("failure"),
)

_MODES = (
    Column("rig", lambda row: rig_name(row.twin)),
    Column("decay 1/s", "decay", ".3g"),
    Column("frequency rad/s", "frequency", ".3g"),
    Column("others decay times as fast", "separation", ".3g"),
)
