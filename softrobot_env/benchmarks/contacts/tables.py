"""The contact study as tables that fit a terminal."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.contacts.rows import ACCURATE_SHARE, Cell, Check
from softrobot_env.benchmarks.records import Record, groups, of_kind, select
from softrobot_env.benchmarks.verdicts import WRONG_SHARE, Verdict
from softrobot_env.rendering.tables import Column, make_table, pivot_table


def tables(rows: Sequence[Record]) -> Group:
    """Verdicts by timestep, errors and cost at the rule's, all cells that warn or worse, checks."""
    cells, checks = of_kind(rows, Cell), of_kind(rows, Check)
    others = [c for c in cells if c.verdict != Verdict.ACCURATE]
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
        Verdict,
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


_CELL = (
    Column("scene", "scene"),
    Column("stiffness", "stiffness_ratio", "g"),
    Column("friction", "friction", "g"),
    Column("steps", "steps_ratio", "d"),
    Column("dt ms", "timestep", ".3g", "ms"),
    Column("verdict", "verdict"),
    Column("error %", "error_share", ".2g", "%"),
    Column("run ms", "wall_time", ".0f", "ms"),
)

_CHECK = (
    Column("case", "case"),
    Column("pieces", "pieces", "d"),
    Column("force N", "force", ".4g"),
    Column("force %", "force_error", ".2g", "%"),
    Column("pressed %", "pressed_error", ".2g", "%"),
    Column("tip %", "tip_error", ".2g", "%"),
    Column("dt ms", "timestep", ".3g", "ms"),
    Column("run ms", "wall_time", ".0f", "ms"),
)
