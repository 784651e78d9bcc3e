"""Tables of `benchmarks.identify`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.identify.run import FoundRow, Row
from softrobot_env.benchmarks.identify.twins import TwinRow
from softrobot_env.benchmarks.records import groups, of_kind
from softrobot_env.rendering.tables import Column, make_table, verdict

#: Kind -> largest relative error that is asked for; of the delay none is.
GOALS = {"modulus": 0.02, "damping": 0.05, "friction": 0.2}

#: Share of repetitions whose interval has to hold the truth.
COVERAGE = 0.9


@dataclass(frozen=True)
class _Summary:
    kind: str
    count: int
    bias: float
    median: float
    most: float
    within: float | None
    inside: float
    met: bool | None


#: Largest error after an identification, over that of the same law that knows the twin.
RATIO = 1.3


def tables(rows: Sequence[Row]) -> Group:
    """Errors and coverage of each kind of parameter; laps of twins."""
    twins, rows = of_kind(rows, TwinRow), of_kind(rows, FoundRow)
    found = [_summary(kind, mine) for (kind,), mine in groups(rows, "kind").items()]
    relative = [row for row in found if row.kind in GOALS]
    delay = [row for row in found if row.kind not in GOALS]
    percent = {"form": ".1f", "unit": "%"}
    columns = (
        Column("parameter", "kind"),
        Column("n", "count", "d"),
        Column("mean %", "bias", **percent),
        Column("median", "median", **percent),
        Column("largest", "most", **percent),
        Column("asked", lambda row: GOALS[row.kind], **percent),
        Column("within it", "within", **percent),
        Column("in 95 %", "inside", **percent),
        Column("met", lambda row: verdict(row.met), ">"),
    )
    times = [row.time for row in rows if row.kind == "modulus"]
    caption = (
        f"{len(times)} robots; an identification took {np.median(times):.1f} s. mean: of the "
        "error; median, largest: of its size; in 95 %: truths within the stated interval. met: all "
        f"within what is asked, and the truth in at least {100 * COVERAGE:.0f} % of the intervals"
    )
    late = (
        Column("parameter", "kind"),
        Column("n", "count", "d"),
        Column("mean ms", "bias", ".1f", "ms"),
        Column("median", "median", ".1f", "ms"),
        Column("largest", "most", ".1f", "ms"),
        Column("in 95 %", "inside", **percent),
    )
    parts = [
        make_table("Cosserat rods, identified", columns, relative, caption=caption),
        make_table("Delay of the markers", late, delay),
    ]
    return Group(*parts, *([_laps(twins)] if twins else []))


def _laps(rows: Sequence[TwinRow]) -> Table:
    """Laps of twins; judged is the best law of each way of knowing the twin."""
    mm = {"form": ".2f", "unit": "mm"}
    columns = (
        Column("twin", "twin", "d"),
        Column("law", "policy"),
        Column("lap s", "period", "g", "s"),
        Column("identified mm", "found", **mm),
        Column("known", "true", **mm),
        Column("believed", "believed", **mm),
        Column("ratio", "ratio", ".2f"),
        Column("met", lambda row: "" if row not in best else verdict(row.ratio <= RATIO), ">"),
    )
    best = [
        min(mine, key=lambda row: np.inf if row.true is None else row.true)
        for mine in groups(rows, "twin", "period").values()
    ]
    best = [row for row in best if row.ratio is not None]
    caption = (
        "mean error of triangles; ratio: of the robot identified over the twin itself known; met: "
        f"at most {RATIO:g} by the law that is best for the twin known"
    )
    return make_table("Twins that nobody told", columns, rows, caption=caption)


def _summary(kind: str, rows: Sequence[FoundRow]) -> _Summary:
    error = np.array([row.error for row in rows])
    inside = float(np.mean([row.inside for row in rows]))
    goal = GOALS.get(kind)
    within = None if goal is None else float(np.mean(np.abs(error) <= goal))
    met = None if within is None else bool(within == 1 and inside >= COVERAGE)
    return _Summary(
        kind,
        len(rows),
        float(error.mean()),
        float(np.median(np.abs(error))),
        float(np.abs(error).max()),
        within,
        inside,
        met,
    )
