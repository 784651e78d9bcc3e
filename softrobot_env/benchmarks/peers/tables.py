"""The rows beside other packages as tables."""

from rich.console import Group
from rich.text import Text

from softrobot_env.benchmarks.peers.rows import Row
from softrobot_env.benchmarks.records import groups, select
from softrobot_env.rendering.tables import Column, make_table

_MOTIONS = (
    Column("model"),
    Column("n", form="d"),
    Column("by", "integrator"),
    Column("step", lambda row: _setting(row), ">"),
    Column("mean mm", "e_mean", ".2g", "mm"),
    Column("max mm", "e_max", ".2g", "mm"),
    Column("core ms", "core_seconds", ".2g", "ms"),
    Column("compile s", "compiled", ".0f"),
)
_STEPS = (
    Column("environment", "model"),
    Column("n", form="d"),
    Column("step ms", "period", ".3g", "ms"),
    Column("steps a second", "steps_per_second", ".3g"),
    Column("core ms", "core_seconds", ".2g", "ms"),
    Column("told error mm", "e_max", ".1g", "mm"),
)
_RATIOS = (
    Column("peer", lambda row: row.integrator or row.model),
    Column("n", form="d"),
    Column("tolerance", form=".0e"),
    Column("mean mm", "e_mean", ".2g", "mm"),
    Column("ours", lambda row: row.model if row.integrator else ""),
    Column("times", "value", ".2g"),
)


def tables(rows: list[Row]) -> Group:
    """Motions that no faster one of the same model beats, environments, and ratios."""
    motions = select(rows, kind="motion")
    best = [row for mine in groups(motions, "package", "model").values() for row in _front(mine)]
    parts = [
        make_table(
            "Tension step of the arm, 3 s: runs that none of the model beats", _MOTIONS, best
        ),
        make_table("Steps of an arm in space", _STEPS, select(rows, kind="environment")),
    ]
    found = select(rows, kind="ratio")
    if found:
        title = "Computing time of a peer over that of ours at no larger mean error"
        parts.append(make_table(title, _RATIOS, found))
    versions = {f"{row.package} {row.version}" for row in rows if row.version}
    lines = {f"Error: to the {row.text}" for row in motions} | {
        row.text for row in select(rows, kind="note")
    }
    told = "n: degrees of freedom; core ms: computing time of one core for a simulated second"
    return Group(*parts, *map(Text, [told, *sorted(lines), ", ".join(sorted(versions))]))


def _setting(row: Row) -> str:
    """Fixed timestep, or the tolerance of adapted ones."""
    if row.tolerance is None:
        return f"{1e3 * row.timestep:.3g} ms"
    return f"tol {row.tolerance:.0e}".replace("e-0", "e-")


def _front(rows: list[Row]) -> list[Row]:
    out: list[Row] = []
    for row in sorted(rows, key=lambda row: row.core_seconds):
        if not out or row.e_mean < 0.85 * out[-1].e_mean:
            out.append(row)
    return out
