"""The stability rows as tables that fit a terminal."""

from collections.abc import Callable, Iterable

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.records import groups, select
from softrobot_env.benchmarks.stability.front import FrontRow, table
from softrobot_env.benchmarks.stability.rig.runs import ASKED, MAP, RULE, RigRow
from softrobot_env.benchmarks.stability.rig.runs import CASES as RIG_CASES
from softrobot_env.benchmarks.stability.runs import (
    CHAIN,
    CHAIN_INTEGRATORS,
    DIVERGED,
    NOT_CONVERGED,
)
from softrobot_env.benchmarks.stability.verdicts import NO_TRUTH, STABLE, WRONG, Row
from softrobot_env.rendering.tables import Column, make_table, new_table, number
from softrobot_env.robots import ARM

#: Cases that make up the maps, and those of the rig; all others are extreme cases.
MAP_CASES = ("map", "rule", "rule_asked", "limit", *RIG_CASES)

_SHORT = {CHAIN: "chain", "implicit_euler": "impl. Euler"}


def tables(rows: list[Row]) -> Group:
    """Shares of the maps, the rule, how sharp its limit is, extreme cases, and the rig's."""
    costs = [row for row in rows if isinstance(row, FrontRow)]
    rows = [row for row in rows if not isinstance(row, FrontRow)]
    rig = [row for row in rows if isinstance(row, RigRow)]
    parts = [_shares(rows), _rule(rows), _limits(rows), _extremes(rows)]
    parts += [_rig_safe(rig), _rig_rule(rig), _rig_failures(rig)] if rig else []
    parts += [table(costs)] if costs else []
    more = "What the rule does on robots of all kinds: softrobot benchmark scenes"
    return Group(*parts, Text(more))


def first_period(row: Row) -> float:
    """First period [s] of the arm with a row's stiffness."""
    return 1 / (ARM.first_frequency * row.stiffness_scale**0.5)


def safe_step(rows: Iterable[Row], unit: Callable[[Row], float] = lambda _: 1.0) -> float | None:
    """Largest timestep, in seconds or in another unit [s], up to which all runs are stable."""
    safe = None
    for row in sorted(rows, key=lambda row: row.timestep / unit(row)):
        if not row.stable:
            break
        safe = row.timestep / unit(row)
    return safe


def _shares(rows: list[Row]) -> Table:
    """One line per model and integrator."""
    cells = select(rows, case="map")
    dampings = sorted({row.damping_ratio for row in cells})
    shown = [z for z in dampings if z in (dampings[0], dampings[-1])] if cells else []
    out = new_table(
        "Maps: share of cells in %; largest step up to which all are stable (T1: first period)",
        ("model", "n", "integrator"),
        ("stable", "wrong", "div.", "no c.", *(f"h, z={z:g}" for z in shown)),
    )
    for (model, n, integrator), mine in groups(cells, "model", "n", "integrator").items():
        shares = [
            f"{100 * len(select(mine, outcome=kind)) / len(mine):.0f}"
            for kind in (STABLE, WRONG, DIVERGED, NOT_CONVERGED)
        ]
        steps = [safe_step(select(mine, damping_ratio=z), first_period) for z in shown]
        texts = ("none" if step is None else f"T1/{1 / step:.0f}" for step in steps)
        out.add_row(_short(model), n, _short(integrator), *shares, *texts)
    return out


def _rule(rows: list[Row]) -> Table:
    """One line per resolution and damping."""
    out = new_table(
        "Timestep rule on the map",
        ("n", "zeta", "picks"),
        ("steps / T1", "stable", "e_max", "asked: stable"),
    )
    asked = groups(select(rows, case="rule_asked"), "n", "damping_ratio")
    picked = groups(select(rows, case="rule"), "n", "damping_ratio")
    for (n, damping), mine in picked.items():
        steps = [first_period(row) / row.timestep for row in mine]
        error = _largest(mine, "e_max", "mm")
        out.add_row(
            n,
            f"{damping:.2g}",
            ", ".join(sorted({row.integrator for row in mine})),
            f"{min(steps):.0f} to {max(steps):.0f}",
            _count(mine),
            f"{error} mm" if error != "-" else error,
            _count(asked.get((n, damping), [])),
        )
    return out


def _count(rows: list[Row]) -> str:
    return f"{sum(row.stable for row in rows)}/{len(rows)}"


def _largest(rows: list[Row], name: str, unit: str) -> str:
    values = (getattr(row, name) for row in rows)
    return number(max((v for v in values if v is not None), default=None), ".2g", unit)


def _limits(rows: list[Row]) -> Table:
    """How sharp the linearised chain's stability limit is."""
    out = new_table(
        "Stability limit of the linearised chain: runs at timesteps in units of the limit",
        ("integrator", "n", "zeta"),
        ("limit", "stable up to", "fails from", "diverges from"),
    )
    cells = groups(select(rows, case="limit"), "integrator", "n", "damping_ratio")
    for (integrator, n, damping), mine in cells.items():
        mine = sorted(mine, key=lambda row: row.timestep)
        ratio = {row: row.timestep / row.stability_limit for row in mine}
        bad = [r for row, r in ratio.items() if not row.stable]
        gone = [r for row, r in ratio.items() if row.outcome == DIVERGED]
        good = [r for r in ratio.values() if not bad or r < bad[0]]
        out.add_row(
            integrator,
            n,
            f"{damping:.2g}",
            f"{1e3 * mine[0].stability_limit:.3g} ms",
            *(f"{r[0]:.2f}" if r else None for r in (good[-1:], bad, gone)),
        )
    return out


def _extremes(rows: list[Row]) -> Table:
    """One line per case and model."""
    mine = [row for row in rows if row.case not in MAP_CASES]
    failed = (row for row in mine if row.failure)
    return make_table(
        "Extreme cases",
        (
            Column("case"),
            Column("model", lambda row: _short(row.model)),
            Column("n"),
            Column("integrator", lambda row: _short(row.integrator)),
            Column("h [ms]", "timestep", ".3g", "ms"),
            Column("error [mm]", _error, ">"),
            Column("bound", "e_bound", ".2g", "mm"),
            Column("time [s]", "wall_time", ".2g"),
        ),
        mine,
        caption="\n".join(f"{row.case}, {_short(row.model)}: {row.failure}" for row in failed),
    )


def _error(row: Row) -> Text:
    error = number(row.e_max, ".2g", "mm")
    return Text(error) if row.stable else Text(f"{error} FAILS", style="red")


def _short(name: str) -> str:
    return _SHORT.get(name, name)


# ---------------------------------------------------------------- the rig


def _rig_safe(rows: list[RigRow]) -> Table:
    out = new_table(
        "Rig: largest timestep [ms] up to which all runs are stable (?: no truth)",
        ("damping", "tendons"),
        CHAIN_INTEGRATORS,
    )
    cells = groups(select(rows, case=MAP), "damping_scale", "tendon_stiffness_scale")
    for (damping, tendons), mine in cells.items():
        steps = (_safe(select(mine, integrator=name)) for name in CHAIN_INTEGRATORS)
        out.add_row(f"x {damping:g}", f"x {tendons:g}", *steps)
    return out


def _safe(rows: list[RigRow]) -> str:
    if select(rows, outcome=NO_TRUTH):
        return "?"
    return number(safe_step(rows), "g", "ms", missing="none")


def _rig_rule(rows: list[RigRow]) -> Table:
    """One line per integrator, the rule's own or asked for, friction and damping."""
    out = new_table(
        "Rig: what the timestep rule picks, over tendons, stiffness, pretension and slack",
        ("integrator", "friction", "damping"),
        ("runs", "stable", "wrong", "div.", "no truth", "e max [mm]", "F err. [N]"),
    )
    for asked in (None, *CHAIN_INTEGRATORS):
        picked = select(rows, case=ASKED, integrator=asked) if asked else select(rows, case=RULE)
        for (friction, damping), mine in groups(picked, "friction", "damping_scale").items():
            names = ", ".join(sorted({row.integrator for row in mine}))
            outcomes = [row.outcome for row in mine]
            out.add_row(
                names if asked else f"rule: {names}",
                f"{friction:g} N",
                f"x {damping:g}",
                len(mine),
                *(outcomes.count(kind) for kind in (STABLE, WRONG, DIVERGED, NO_TRUTH)),
                _largest(mine, "e_max", "mm"),
                _largest(mine, "e_tension", "N"),
            )
    return out


def _rig_failures(rows: list[RigRow]) -> Table:
    """One line per own pick of the rule that diverged or is wrong."""
    return make_table(
        "Rig: picks of the rule that fail",
        (
            Column("tendons, E, damping", _rig_label),
            Column("pretension, friction, motion", _drive_label),
            Column("picks", lambda row: f"{row.integrator} {1e3 * row.timestep:.3g} ms"),
            Column("failure"),
        ),
        [row for row in select(rows, case=RULE) if row.outcome in (WRONG, DIVERGED)],
    )


def _rig_label(row: RigRow) -> str:
    scales = row.tendon_stiffness_scale, row.stiffness_scale, row.damping_scale
    return " ".join(f"x {scale:g}" for scale in scales)


def _drive_label(row: RigRow) -> str:
    return f"{row.pretension:g} N, {row.friction:g} N, {row.motion}"
