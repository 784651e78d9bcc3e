"""Tables of `benchmarks.feedback`."""

from statistics import median

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.feedback.gains import TOLD, GainRow, left
from softrobot_env.benchmarks.feedback.rigs import LATE
from softrobot_env.benchmarks.feedback.run import CAMERA, PRINTED, SLOW, THESIS, LapRow, Row
from softrobot_env.benchmarks.records import groups, names, of_kind, one, select
from softrobot_env.rendering.tables import Column, make_table, new_table
from softrobot_env.tasks import make_task

_NOTE = (
    f"The tip is seen {1e3 * LATE:g} ms late, by a camera or a curvature sensor with the errors of "
    "the twin; the sensor is calibrated by 120 postures at rest. Policies know the parameters of "
    "twin 0 and no disturbance. An offset of 7 mm is what makes the thesis' feedforward err as "
    "printed; its weight is not told: 26 g make its PI loop err as printed. Shares are those of "
    "twin 0. Most of an "
    "offset's error stays where it is; a weight's turns with the reference, and an integral lags "
    "behind: of that the thesis prints less left than a loop of its gains around the first mode "
    "leaves at its speed."
)


def tables(rows: list[Row]) -> Group:
    """Errors by disturbance beside the thesis', and gains."""
    laps = of_kind(rows, LapRow)
    parts = []
    for (path, by), mine in groups(laps, "path", "seen_by").items():
        parts.append(_errors(path, by, mine))
        if path != SLOW:
            parts.append(_errors(f"the last of {path}", by, mine, "last"))
    failed = [Text(f"{r.policy}, {r.disturbance}: {r.failure}") for r in laps if r.failure]
    parts.append(_shares(select(laps, path=SLOW, seen_by=CAMERA)))
    return Group(*parts, _gains(of_kind(rows, GainRow)), Text(_NOTE), *failed)


def _errors(path: str, seen_by: str, rows: list[LapRow], field: str = "rms") -> Table:
    """RMS errors: twin 0, median of the others, and the thesis'."""
    disturbances = [d for (d,) in groups(rows, "disturbance")]
    title = (
        f"Circle of 120 mm, {path}, tip by the {seen_by}: RMS error in mm of twin {rows[0].twin} / "
        "median of the others" + (" (thesis)" if path == SLOW else "")
    )
    out = new_table(title, ("policy",), [d or "undisturbed" for d in disturbances])
    for policy in names(rows):
        mine = [select(rows, policy=policy, disturbance=d) for d in disturbances]
        out.add_row(policy, *(_cell(each, field) for each in mine))
    return out


def _cell(rows: list[LapRow], field: str) -> str:
    values = [getattr(row, field) for row in rows]
    if not values or None in values:
        return "failed" if values else "-"
    first, *others = (1e3 * value for value in values)
    text = f"{first:.2g}" + (f" / {median(others):.2g}" if others else "")
    printed = one(rows, twin=rows[0].twin).thesis
    return text if printed is None else f"{text} ({1e3 * printed:.1f})"


def _shares(rows: list[LapRow]) -> Table:
    """What P and PI leave of the error of the network alone, here and in the thesis."""
    circle = make_task("rig_circle").trajectory
    proportional, integral = TOLD[0]
    told = dict(zip(THESIS[1:], ((proportional, 0.0), (proportional, integral)), strict=True))
    printed = [d for (d,) in groups(rows, "disturbance") if (THESIS[0], d) in PRINTED]
    columns = [c for d in printed for c in (d, "thesis")]
    ends = ("first mode: still", "turning once a lap")
    out = new_table("Share of the error of rig_nn that is left, %", ("policy",), [*columns, *ends])
    for policy, gains in told.items():
        cells = [c for d in printed for c in (_share(rows, policy, d), _told_share(policy, d))]
        rates = 0.0, circle.speed / circle.radius
        out.add_row(policy, *cells, *(f"{100 * left(*gains, rate):.0f}" for rate in rates))
    return out


def _share(rows: list[LapRow], policy: str, disturbance: str) -> str:
    """Of the first twin."""
    pair = [one(rows, policy=name, disturbance=disturbance) for name in (policy, THESIS[0])]
    if any(row is None or row.rms is None for row in pair):
        return "-"
    return f"{100 * pair[0].rms / pair[1].rms:.0f}"


def _told_share(policy: str, disturbance: str) -> str:
    return f"{100 * PRINTED[policy, disturbance] / PRINTED[THESIS[0], disturbance]:.0f}"


def _gains(rows: list[GainRow]) -> Table:
    columns = (
        Column("K_P", "proportional", ".2f"),
        Column("K_I 1/s", "integral", ".2f"),
        Column("rings for s", "decay", ".2f"),
        Column("", lambda row: "largest stable in this ratio" if row.limit else "thesis"),
    )
    return make_table("P and PI feedback by the first mode alone: what is stable", columns, rows)
