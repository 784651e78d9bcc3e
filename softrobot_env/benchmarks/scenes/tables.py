"""The random scenes as tables that fit a terminal."""

from collections.abc import Callable, Iterator, Sequence

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.scenes.rows import GOOD_FACTOR, Row
from softrobot_env.benchmarks.verdicts import WRONG_SHARE, Verdict
from softrobot_env.rendering.tables import Column, make_table, new_table, pivot_table

#: Groups of scenes that are compared.
_GROUPS: dict[str, Callable[[Row], bool]] = {
    "planar": lambda r: r.bending == "planar",
    "spatial, rigid in torsion": lambda r: r.bending == "spatial" and not r.torsion,
    "spatial with torsion": lambda r: r.torsion,
    "driven by tension": lambda r: r.actuation == "tension",
    "driven by length": lambda r: r.actuation == "length",
    "tendons through guides": lambda r: r.guided,
    "tendons that rub": lambda r: r.friction > 0,
    "tendons with pretension": lambda r: r.pretension > 0,
    "with a head": lambda r: r.head > 0,
    "with a load": lambda r: r.loaded,
    "no gravity": lambda r: r.gravity == 0,
    "rho A g L^3 / EI up to 10": lambda r: 0 < r.weight_load <= 10,
    "rho A g L^3 / EI up to 1000": lambda r: 10 < r.weight_load <= 1000,
    "rho A g L^3 / EI above 1000": lambda r: r.weight_load > 1000,
    "damping ratio below 0.003": lambda r: r.damping_ratio < 0.003,
    "damping ratio 0.003 to 0.03": lambda r: 0.003 <= r.damping_ratio < 0.03,
    "damping ratio above 0.03": lambda r: r.damping_ratio >= 0.03,
    "steps": lambda r: r.excitation == "steps",
    "sines": lambda r: r.excitation == "sines",
    "let go": lambda r: r.excitation == "let_go",
}

_SCENE = (
    Column("no.", "index", "d"),
    Column("joints", "joints", "d"),
    Column("chain", lambda r: _kind(r)),
    Column("L/r", "slenderness", ".0f"),
    Column("E Pa", "youngs_modulus", ".0e"),
    Column("zeta", "damping_ratio", ".0e"),
    Column("sag", "weight_load", ".0e"),
    Column("steps", lambda r: r.substeps and f"{r.substeps} {_SHORT.get(r.integrator)}", ">"),
)
_SHORT = {
    "extrapolation": "ex",
    "implicitfast": "if",
    "discrete": "di",
    "Euler": "eu",
    "implicit": "im",
    "RK4": "rk",
}


def tables(rows: Sequence[Row]) -> Group:
    """How many scenes have which verdict, by what they are, and all that are not accurate."""
    lists = [_listed(rows, *what) for what in _LISTS if select(rows, verdict=what[0])]
    return Group(_summary(rows), _groups(rows), *lists)


def _summary(rows: Sequence[Row]) -> Table:
    out = new_table(
        f"{len(rows)} random scenes of seed {rows[0].seed}; accuracy asked for "
        f"{100 * rows[0].asked_share:g} % of the length",
        ("verdict", "of these"),
        ("scenes", "%"),
    )
    for verdict in Verdict:
        mine = select(rows, verdict=verdict)
        out.add_row(
            verdict, _remark(verdict, mine), len(mine), f"{100 * len(mine) / len(rows):.1f}"
        )
    return out


def _remark(verdict: str, rows: list[Row]) -> str:
    if verdict == Verdict.REPORTED:
        fine = sum(row.refined_fine is True for row in rows)
        return f"a refined run is fine: {fine}" if rows else ""
    if verdict == Verdict.WARNED:
        good = sum(row.estimate_is_good is True for row in rows)
        return f"estimate within a factor of {GOOD_FACTOR:g}: {good}" if rows else ""
    if verdict == Verdict.ACCURATE:
        return f"warned all the same: {sum(row.warning is not None for row in rows)}"
    return {
        Verdict.INACCURATE: f"no warning, up to {100 * WRONG_SHARE:g} % of the length",
        Verdict.WRONG: f"no warning, beyond {100 * WRONG_SHARE:g} % of the length",
        Verdict.UNJUDGED: "refined runs disagree or cost too much",
    }[verdict]


def _groups(rows: Sequence[Row]) -> Table:
    def cell(test: Callable[[Row], bool], verdict: str) -> int:
        return sum(test(row) for row in select(rows, verdict=verdict))

    return pivot_table("Verdicts by what the scenes have", "scenes", _GROUPS, Verdict, cell)


def _kind(row: Row) -> str:
    chain = "2-D" if row.bending == "planar" else "torsion" if row.torsion else "3-D"
    return f"{chain} {row.actuation} {row.excitation.replace('_', ' ')}"


def _short(why: str | None) -> str | None:
    """What failed and when, without the names of coordinates."""
    if why is None:
        return None
    before, _, after = why.partition("in the control period ending ")
    return (before + after.split(": not finite")[0]).removeprefix("simulation ")


_ERROR = (
    Column("error %", "error_share", ".2g", "%"),
    Column("estimate %", "estimate_share", ".2g", "%"),
)
_WHY = (Column("why", lambda r: _short(r.why)),)
_FINE = (Column("refined run", lambda r: _fine(r)), *_WHY)

#: Verdict, title and what is shown beside the scene.
_LISTS = (
    (Verdict.WRONG, "Wrong without a word", _ERROR),
    (Verdict.INACCURATE, "Less accurate than asked for, without a word", _ERROR),
    (Verdict.WARNED, "Less accurate than asked for, with a warning", _ERROR),
    (Verdict.REPORTED, "Refused or failed", _FINE),
    (Verdict.UNJUDGED, "Unjudged", _WHY),
)


def _fine(row: Row) -> str | None:
    return None if row.refined_fine is None else "is fine" if row.refined_fine else "is not"


def _listed(rows: Sequence[Row], verdict: str, title: str, columns: tuple[Column, ...]) -> Table:
    caption = "sag: rho A g L^3 / EI; steps per control period and integrator"
    return make_table(
        title, (*_SCENE, *columns), _worst_first(select(rows, verdict=verdict)), caption=caption
    )


def _worst_first(rows: list[Row]) -> Iterator[Row]:
    yield from sorted(rows, key=lambda row: -(row.error_share or 0.0))
