"""The stability rows as tables that fit a terminal."""

from collections.abc import Iterable

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.stability.groups import groups, new_table
from softrobot_env.benchmarks.stability.rig import run as rig_stability
from softrobot_env.benchmarks.stability.rig import tables as rig_stability_tables
from softrobot_env.benchmarks.stability.runs import (
    CHAIN,
    DIVERGED,
    NOT_CONVERGED,
    STABLE,
    WRONG,
    Row,
)
from softrobot_env.robots import ARM

#: Cases that make up the maps, and those of the rig; all others are extreme cases.
MAP_CASES = ("map", "rule", "rule_asked", "limit", *rig_stability.CASES)

_SHORT = {CHAIN: "chain", "implicit_euler": "impl. Euler"}


def tables(rows: list[Row]) -> Group:
    """Shares of the maps, the rule, how sharp its limit is, extreme cases, and the rig's."""
    arm = (_shares(rows), _rule(rows), _limits(rows), _extremes(rows))
    return Group(*arm, *rig_stability_tables.tables(rows))


def first_period(row: Row) -> float:
    """First period [s] of the arm with a row's stiffness."""
    return 1 / (ARM.first_frequency * row["stiffness_scale"] ** 0.5)


def safe_step(rows: Iterable[Row]) -> float | None:
    """Largest timestep, in first periods, up to which all of some cells are stable."""
    safe = None
    for row in sorted(rows, key=lambda row: row["timestep"] / first_period(row)):
        if not row["stable"]:
            break
        safe = row["timestep"] / first_period(row)
    return safe


def _shares(rows: list[Row]) -> Table:
    """One line per model and integrator."""
    cells = [row for row in rows if row["case"] == "map"]
    dampings = sorted({row["damping_ratio"] for row in cells})
    shown = [z for z in dampings if z in (dampings[0], dampings[-1])] if cells else []
    out = new_table(
        "Maps: share of cells in %; largest step up to which all are stable (T1: first period)",
        ("model", "n", "integrator"),
        ("stable", "wrong", "div.", "no c.", *(f"h, z={z:g}" for z in shown)),
    )
    for (model, n, integrator), mine in groups(cells, "model", "n", "integrator").items():
        shares = [
            f"{100 * sum(row['outcome'] == kind for row in mine) / len(mine):.0f}"
            for kind in (STABLE, WRONG, DIVERGED, NOT_CONVERGED)
        ]
        steps = [safe_step(r for r in mine if r["damping_ratio"] == z) for z in shown]
        out.add_row(_short(model), str(n), _short(integrator), *shares, *map(_step, steps))
    return out


def _step(step: float | None) -> str:
    return "none" if step is None else f"T1/{1 / step:.0f}"


def _rule(rows: list[Row]) -> Table:
    """One line per resolution and damping."""
    out = new_table(
        "Timestep rule on the map",
        ("n", "zeta", "picks"),
        ("steps / T1", "stable", "e_max", "asked: stable"),
    )
    asked = groups((r for r in rows if r["case"] == "rule_asked"), "n", "damping_ratio")
    picked = groups((r for r in rows if r["case"] == "rule"), "n", "damping_ratio")
    for (n, damping), mine in picked.items():
        steps = [first_period(row) / row["timestep"] for row in mine]
        errors = [row["e_max"] for row in mine if row["e_max"] is not None]
        out.add_row(
            str(n),
            f"{damping:.2g}",
            ", ".join(sorted({row["integrator"] for row in mine})),
            f"{min(steps):.0f} to {max(steps):.0f}",
            _count(mine),
            f"{1e3 * max(errors):.2g} mm" if errors else "-",
            _count(asked.get((n, damping), [])),
        )
    return out


def _count(rows: list[Row]) -> str:
    return f"{sum(row['stable'] for row in rows)}/{len(rows)}"


def _limits(rows: list[Row]) -> Table:
    """How sharp the linearised chain's stability limit is."""
    out = new_table(
        "Stability limit of the linearised chain: runs at timesteps in units of the limit",
        ("integrator", "n", "zeta"),
        ("limit", "stable up to", "fails from", "diverges from"),
    )
    cells = (row for row in rows if row["case"] == "limit")
    for (integrator, n, damping), mine in groups(cells, "integrator", "n", "damping_ratio").items():
        mine = sorted(mine, key=lambda row: row["timestep"])
        ratio = [row["timestep"] / row["stability_limit"] for row in mine]
        bad = [r for r, row in zip(ratio, mine, strict=True) if not row["stable"]]
        gone = [r for r, row in zip(ratio, mine, strict=True) if row["outcome"] == DIVERGED]
        good = [r for r in ratio if not bad or r < bad[0]]
        out.add_row(
            integrator,
            str(n),
            f"{damping:.2g}",
            f"{1e3 * mine[0]['stability_limit']:.3g} ms",
            *(f"{r[0]:.2f}" if r else "-" for r in (good[-1:], bad, gone)),
        )
    return out


def _extremes(rows: list[Row]) -> Table:
    """One line per case and model."""
    out = new_table(
        "Extreme cases",
        ("case", "model", "n", "integrator"),
        ("h [ms]", "error [mm]", "bound", "time [s]"),
    )
    mine = [row for row in rows if row["case"] not in MAP_CASES]
    for row in mine:
        error = "-" if row["e_max"] is None else f"{1e3 * row['e_max']:.2g}"
        out.add_row(
            row["case"],
            _short(row["model"]),
            str(row["n"]),
            _short(row["integrator"]),
            f"{1e3 * row['timestep']:.3g}",
            error if row["stable"] else f"[red]{error} FAILS[/]",
            f"{1e3 * row['e_bound']:.2g}",
            f"{row['wall_time']:.2g}",
        )
    failed = [row for row in mine if row["failure"]]
    out.caption = "\n".join(f"{r['case']}, {_short(r['model'])}: {r['failure']}" for r in failed)
    return out


def _short(name: str) -> str:
    return _SHORT.get(name, name)
