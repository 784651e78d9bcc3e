"""The contact study as tables that fit a terminal."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.contacts.rows import (
    ACCURATE,
    ACCURATE_SHARE,
    VERDICTS,
    WRONG_SHARE,
    Cell,
    Check,
)
from softrobot_env.benchmarks.records import Record, groups, of_kind, select
from softrobot_env.rendering.tables import Column, make_table, number, pivot_table


def tables(rows: Sequence[Record]) -> Group:
    """Verdicts by timestep, errors and cost at the rule's, all cells that warn or worse, checks."""
    cells, checks = of_kind(rows, Cell), of_kind(rows, Check)
    others = [c for c in cells if c.verdict != ACCURATE]
    return Group(
        _verdicts(cells),
        _errors(cells),
        make_table("Cells that are not accurate", _CELL, others),
        make_table(
            "Rods at rest on something, against closed form and elastica",
            _CHECK,
            checks,
            caption="pressed: sum of the sizes of the forces; force: their vector sum",
        ),
    )


def _verdicts(cells: Sequence[Cell]) -> Table:
    lines = {_times(n): n for (n,) in groups(cells, "steps_ratio")}
    return pivot_table(
        f"Verdicts of {len(cells)} cells by timestep: accurate within {100 * ACCURATE_SHARE:g} %, "
        f"wrong beyond {100 * WRONG_SHARE:g} % of the length",
        "timestep",
        lines,
        VERDICTS,
        lambda n, verdict: len(select(cells, steps_ratio=n, verdict=verdict)),
    )


def _times(multiple: int) -> str:
    return "the rule's" if multiple == 1 else f"{multiple} times"


def _errors(cells: Sequence[Cell]) -> Table:
    """Largest error in % and mean run time over simulated time, by scene and timestep."""
    columns = {_times(n): n for (n,) in groups(cells, "steps_ratio")}

    def cell(scene: str, multiple: int) -> str | None:
        mine = select(cells, scene=scene, steps_ratio=multiple)
        known = [c for c in mine if c.error_share is not None]
        if not known:
            return None
        worst = max(c.error_share for c in known)
        cost = sum(c.wall_time / c.duration for c in known) / len(known)
        return f"{100 * worst:.2f} % {cost:.3f}"

    scenes = [scene for (scene,) in groups(cells, "scene")]
    return pivot_table(
        "Largest error over the length, and mean run time over simulated time",
        "scene",
        scenes,
        columns,
        cell,
    )


def _share(value: float | None) -> str | None:
    return None if value is None else number(value, ".2g", "%")


_CELL = (
    Column("scene", "scene"),
    Column("stiffness", "stiffness_ratio", "g"),
    Column("friction", "friction", "g"),
    Column("steps", "steps_ratio", "d"),
    Column("dt ms", lambda r: f"{1e3 * r.timestep:.3g}", ">"),
    Column("verdict", "verdict"),
    Column("error %", lambda r: _share(r.error_share), ">"),
    Column("run ms", lambda r: None if r.wall_time is None else f"{1e3 * r.wall_time:.0f}", ">"),
)

_CHECK = (
    Column("case", "case"),
    Column("pieces", "pieces", "d"),
    Column("force N", "force", ".4g"),
    Column("force %", lambda r: _share(r.force_error), ">"),
    Column("pressed %", lambda r: _share(r.pressed_error), ">"),
    Column("tip %", lambda r: _share(r.tip_error), ">"),
    Column("dt ms", lambda r: f"{1e3 * r.timestep:.3g}", ">"),
    Column("run ms", lambda r: f"{1e3 * r.wall_time:.0f}", ">"),
)
