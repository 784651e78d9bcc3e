"""The rig's rows of the stability benchmark as tables."""

from collections.abc import Iterable

from rich.table import Table

from softrobot_env.benchmarks.stability.groups import groups, new_table
from softrobot_env.benchmarks.stability.rig.run import ASKED, CASES, MAP, RULE
from softrobot_env.benchmarks.stability.runs import (
    CHAIN_INTEGRATORS,
    DIVERGED,
    NO_TRUTH,
    STABLE,
    WRONG,
    Row,
)

#: What a rig is made of, and what moves it.
_RIG = ("tendon_stiffness_scale", "stiffness_scale", "damping_scale")
_DRIVE = ("pretension", "friction", "motion")


def tables(rows: list[Row]) -> list[Table]:
    """Largest safe timesteps, how the rule does, and where what it picks fails."""
    rows = [row for row in rows if row["case"] in CASES]
    return [_safe(rows), _rule(rows), _failures(rows)] if rows else []


def safe_step(rows: Iterable[Row]) -> float | None:
    """Largest timestep [s] up to which all runs are stable."""
    safe = None
    for row in sorted(rows, key=lambda row: row["timestep"]):
        if not row["stable"]:
            break
        safe = row["timestep"]
    return safe


def _safe(rows: list[Row]) -> Table:
    out = new_table(
        "Rig: largest timestep [ms] up to which all runs are stable (?: no truth)",
        ("damping", "tendons"),
        CHAIN_INTEGRATORS,
    )
    cells = [row for row in rows if row["case"] == MAP]
    for (damping, tendons), mine in groups(cells, "damping_scale", *_RIG[:1]).items():
        own = groups(mine, "integrator")
        steps = (_step(own[integrator,]) for integrator in CHAIN_INTEGRATORS)
        out.add_row(f"x {damping:g}", f"x {tendons:g}", *steps)
    return out


def _step(rows: list[Row]) -> str:
    if any(row["outcome"] == NO_TRUTH for row in rows):
        return "?"
    step = safe_step(rows)
    return "none" if step is None else f"{1e3 * step:g}"


def _rule(rows: list[Row]) -> Table:
    """One line per integrator, the rule's own or asked for, friction and damping."""
    out = new_table(
        "Rig: what the timestep rule picks, over tendons, stiffness, pretension and slack",
        ("integrator", "friction", "damping"),
        ("runs", "stable", "wrong", "div.", "no truth", "e max [mm]", "F err. [N]"),
    )
    for asked in (None, *CHAIN_INTEGRATORS):
        case = RULE if asked is None else ASKED
        picked = [r for r in rows if r["case"] == case and asked in (None, r["integrator"])]
        for (friction, damping), mine in groups(picked, "friction", "damping_scale").items():
            names = ", ".join(sorted({row["integrator"] for row in mine}))
            outcomes = [row["outcome"] for row in mine]
            out.add_row(
                names if asked else f"rule: {names}",
                f"{friction:g} N",
                f"x {damping:g}",
                str(len(mine)),
                *(str(outcomes.count(kind)) for kind in (STABLE, WRONG, DIVERGED, NO_TRUTH)),
                _largest(mine, "e_max", 1e3),
                _largest(mine, "e_tension", 1),
            )
    return out


def _largest(rows: list[Row], name: str, unit: float) -> str:
    values = [row[name] for row in rows if row[name] is not None]
    return f"{unit * max(values):.2g}" if values else "-"


def _failures(rows: list[Row]) -> Table:
    """One line per own pick of the rule that diverged or is wrong."""
    out = new_table(
        "Rig: picks of the rule that fail",
        ("tendons, E, damping", "pretension, friction, motion", "picks", "failure"),
        (),
    )
    for row in rows:
        if row["case"] == RULE and row["outcome"] in (WRONG, DIVERGED):
            out.add_row(
                " ".join(f"x {row[name]:g}" for name in _RIG),
                "{:g} N, {:g} N, {}".format(*(row[name] for name in _DRIVE)),
                f"{row['integrator']} {1e3 * row['timestep']:.3g} ms",
                row["failure"],
            )
    return out
