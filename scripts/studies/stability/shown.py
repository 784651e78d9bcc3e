"""The stability rows as tables that fit a terminal, and as pictures."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import Axes, Figure, entry
from softrobot_env.rendering.models import cell_edges, new_maps
from softrobot_env.robots import ARM
from studies.lab import Column, groups, lines, number, of_kind, pivot, select, table
from studies.stability import map as arm_map
from studies.stability import rig
from studies.stability.integrators import FrontRow, gain
from studies.stability.rig import ASKED, MAP, RULE, RigRow
from studies.stability.runs import CHAIN, DIVERGED, NO_TRUTH, NOT_CONVERGED, STABLE, WRONG, Row

#: Cases that make up the maps, and those of the rig; all others are extreme cases.
MAP_CASES = ("map", "rule", "rule_asked", "limit", *rig.CASES)

_SHORT = {CHAIN: "chain", "implicit_euler": "impl. Euler"}


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


def _short(name: Any) -> str:
    return _SHORT.get(name, f"{name:.2g}" if isinstance(name, float) else name)


def _share(outcome: str, rows: list[Row]) -> str:
    return f"{100 * len(select(rows, outcome=outcome)) / len(rows):.0f}"


def _safe_share(damping: float, rows: list[Row]) -> str:
    step = safe_step(select(rows, damping_ratio=damping), first_period)
    return "none" if step is None else f"T1/{1 / step:.0f}"


def _picked(rows: list[Row]) -> list[Row]:
    """The rule's own picks."""
    return select(rows, case="rule")


def _steps(rows: list[Row]) -> str:
    steps = [first_period(row) / row.timestep for row in _picked(rows)]
    return f"{min(steps):.0f} to {max(steps):.0f}"


def _stable(rows: list[Row]) -> str:
    return f"{sum(row.stable for row in rows)}/{len(rows)}"


def _largest(name: str, unit: str, rows: list[Row]) -> str:
    values = (getattr(row, name) for row in rows)
    return number(max((v for v in values if v is not None), default=None), ".2g", unit)


def _stable_up_to(rows: list[Row]) -> str | None:
    step = safe_step(rows)
    return None if step is None else f"{step / rows[0].stability_limit:.2f}"


def _first(outcomes: tuple[str, ...], rows: list[Row]) -> str | None:
    """Least timestep over the stability limit of the runs that end in one of some ways."""
    ratios = [r.timestep / r.stability_limit for r in rows if r.outcome in outcomes]
    return f"{min(ratios):.2f}" if ratios else None


def _safe(rows: list[RigRow]) -> str:
    if select(rows, outcome=NO_TRUTH):
        return "?"
    return number(safe_step(rows), "g", "ms", missing="none")


def _is_extreme(row: Row) -> bool:
    return row.case not in MAP_CASES


_MODEL = Column("model", lambda row: _short(row.model))
_MAP_OUTCOMES = {"stable": STABLE, "wrong": WRONG, "div.": DIVERGED, "no c.": NOT_CONVERGED}

#: What the rule picks for the rig, by itself and with an integrator asked for.
_RIG_RULE = {RULE: "rule", ASKED: "asked"}
_RIG_OUTCOMES = {"stable": STABLE, "wrong": WRONG, "div.": DIVERGED, "no truth": NO_TRUTH}

TABLES = (
    pivot(
        "Maps: share of cells in %; largest step up to which all are stable (T1: first period)",
        ("model", "n", "integrator"),
        {
            **{name: partial(_share, outcome) for name, outcome in _MAP_OUTCOMES.items()},
            **{f"h, z={z:g}": partial(_safe_share, z) for z in arm_map.SOME_DAMPINGS[::2]},
        },
        of=Row,
        where={"case": "map"},
        show=_short,
    ),
    pivot(
        "Timestep rule on the map",
        ("n", "damping_ratio"),
        {
            "picks": lambda rows: ", ".join(sorted({row.integrator for row in _picked(rows)})),
            "steps / T1": _steps,
            "stable": lambda rows: _stable(_picked(rows)),
            "e max [mm]": lambda rows: _largest("e_max", "mm", _picked(rows)),
            "asked: stable": lambda rows: _stable(select(rows, case="rule_asked")),
        },
        of=Row,
        where=lambda row: row.case in ("rule", "rule_asked"),
        headings=("n", "zeta"),
        show=_short,
    ),
    pivot(
        "Stability limit of the linearised chain: runs at timesteps in units of the limit",
        ("integrator", "n", "damping_ratio"),
        {
            "limit": lambda rows: f"{1e3 * rows[0].stability_limit:.3g} ms",
            "stable up to": _stable_up_to,
            "fails from": partial(_first, (WRONG, DIVERGED, NOT_CONVERGED, NO_TRUTH)),
            "diverges from": partial(_first, (DIVERGED,)),
        },
        of=Row,
        where={"case": "limit"},
        headings=("integrator", "n", "zeta"),
        show=_short,
    ),
    table(
        "Extreme cases",
        *("case", _MODEL, "n", "integrator", "timestep", "e_max", "e_bound", "wall_time"),
        of=Row,
        where=_is_extreme,
    ),
    table(
        "Extreme cases that fail",
        *("case", _MODEL, "failure"),
        of=Row,
        where=lambda row: _is_extreme(row) and not row.stable,
    ),
    pivot(
        "Rig: largest timestep [ms] up to which all runs are stable (?: no truth)",
        ("damping_scale", "tendon_stiffness_scale"),
        "integrator",
        _safe,
        of=RigRow,
        where={"case": MAP},
        headings=("damping x", "tendons x"),
    ),
    pivot(
        "Rig: what the timestep rule picks, over tendons, stiffness, pretension and slack",
        ("case", "integrator", "friction", "damping_scale"),
        {
            "runs": len,
            **{k: lambda rows, v=v: len(select(rows, outcome=v)) for k, v in _RIG_OUTCOMES.items()},
            "e max [mm]": partial(_largest, "e_max", "mm"),
            "F err. [N]": partial(_largest, "e_tension", "N"),
        },
        of=RigRow,
        where=lambda row: row.case in _RIG_RULE,
        headings=("", "integrator", "friction", "damping"),
        show=lambda value: _RIG_RULE.get(value, _short(value)),
        ordered=True,
    ),
    table(
        "Rig: picks of the rule that fail",
        *("tendon_stiffness_scale", "stiffness_scale", "damping_scale", "pretension", "friction"),
        *("motion", "integrator", "timestep", "failure"),
        of=RigRow,
        where=lambda row: row.case == RULE and row.outcome in (WRONG, DIVERGED),
    ),
    table(
        "Integrators: error against cost",
        *(Column("", "case"), "integrator", "setting", "error", "evaluations", "cost"),
        of=FrontRow,
    ),
)


# ---------------------------------------------------------------- pictures

#: Outcome -> colour, sign in the cell, and text of the legend.
_OUTCOMES = {
    WRONG: (figures.ORANGE, "~", "~  finite but wrong"),
    DIVERGED: (figures.VERMILLION, "x", "x  diverged"),
    NO_TRUTH: ("#CCCCCC", "?", "?  ended, but refined runs differ"),
}
_EMPTY = {"markerfacecolor": "white", "markeredgecolor": "0.6"}
_PICK = {"markeredgecolor": "black", "markeredgewidth": 0.7}
_GREENS = ("#004D38", "#009E73", "#C9EBDD")

#: Errors [mm] at the ends of the shades of green.
_ERRORS = (0.02, 25.0)

#: Range [ms] of the axis; lower picks are drawn as triangles on its edge.
_LOWEST, _HIGHEST = 0.015, 28.0

#: Cases of the rule's own picks; its others have an integrator asked for.
_OWN = ("rule", RULE)


def arm_maps(rows: list[Row]) -> Figure:
    """The map of the first chain."""
    mine = [row for row in of_kind(rows, Row) if row.case in ("map", "rule", "rule_asked")]
    first = select(mine, model=CHAIN, n=mine[0].n)
    fields = ("damping_ratio", "damping ratio {:.2g}"), ("stiffness_scale", "stiffness / arm's")
    return _draw(first, _title(mine[0]), *fields)


def rig_maps(rows: list[Row]) -> Figure:
    """The map of the rig, where nothing else differs."""
    usual = {"stiffness_scale": 1.0, "pretension": rig.Variation.pretension, "friction": 0.0}
    mine = select(of_kind(rows, RigRow), motion="bend", **usual)
    dampings = {row.damping_scale for row in select(mine, case=MAP)}
    mine = [row for row in mine if row.damping_scale in dampings]
    tendons = "tendon_stiffness_scale", "tendon stiffness / nylon's"
    return _draw(mine, _RIG_TITLE, ("damping_scale", "damping x {:g}"), tendons)


PLOTS = {
    "{}": arm_maps,
    "{}_rig": rig_maps,
    "{}_integrators": lines(
        *("evaluations", "error", "integrator"),
        title=gain,
        subject="Errors of links against forces computed, at several settings",
        panel="case",
        of=FrontRow,
        log="xy",
        columns=4,
        size=(2.6, 2.6),
        legend=True,
    ),
}


def _title(row: Row) -> str:
    return (
        f"MuJoCo chain with {row.n} hinges, a step of the tensions, three first periods or "
        f"{arm_map.MOST_STEPS} steps; green: within {1e3 * row.e_bound:g} mm (5 % of the length) "
        "of a refined run"
    )


def _message(picks: list[Row]) -> str:
    """How many of the rule's picks are good."""
    rows = [row for row in picks if row.case in _OWN and row.outcome != NO_TRUTH]
    good = len(select(rows, outcome=STABLE))
    return f"{good} of {len(rows)} timesteps that the rule picks by itself are stable and right"


_RIG_TITLE = (
    f"Spatial rig with {rig.JOINTS} joints, which servos bend to and fro for {rig.DURATION:g} "
    f"s; green: within {1e3 * rig.BOUND:g} mm (5 % of the length) and {rig.TENSION_BOUND:g} N "
    "of tension in the mean of a refined run"
)


def _draw(
    rows: list[Row], title: str, lines: tuple[str, str], stiffness: tuple[str, str]
) -> Figure:
    """A picture of a map and what the rule picks.

    Args:
        rows: Runs of the map, and with what the rule picks, by itself or an integrator asked for.
        title: Of the picture.
        lines: Field that the lines of panels differ in, and their label with it.
        stiffness: Field along the horizontal axis, and its label.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    def look(row: Row) -> tuple[Any, str]:
        if row.outcome != STABLE:
            return _OUTCOMES[row.outcome][:2]
        return shades.to_rgba(max(1e3 * row.e_max, _ERRORS[0])), ""

    (field, _), (x, _) = lines, stiffness
    cells = [row for row in rows if row.case in ("map", MAP)]
    picks = [row for row in rows if row.case not in ("map", MAP)]
    shades = ScalarMappable(LogNorm(*_ERRORS), LinearSegmentedColormap.from_list("error", _GREENS))
    figure, panels = new_maps(cells, lines, stiffness, look)
    for (value, integrator), axes in panels.items():
        own = {"integrator": integrator, field: value}
        _draw_limit(axes, select(cells, **own), x)
        _draw_picks(axes, select(picks, **own), x)
    figures.add_title(figure, _message(picks), title)
    place = {"location": "right", "shrink": 0.6, "aspect": 30, "pad": 0.01}
    bar = figure.colorbar(shades, ax=[*panels.values()], **place)
    bar.set_label("stable: largest error of the tip [mm]", fontsize=8.5)
    bar.ax.tick_params(labelsize=7.5)
    figures.add_legend(figure, _entries(cells))
    return figure


def _draw_limit(axes: Axes, rows: list[Row], stiffness: str) -> None:
    """The stability limit of the linearised chain, dashed, on axes of one range in all maps."""
    limits = {getattr(r, stiffness): 1e3 * r.stability_limit for r in rows if r.stability_limit}
    axes.plot(sorted(limits), [limits[at] for at in sorted(limits)], "k--", linewidth=1.1)
    axes.set_ylim(_LOWEST, _HIGHEST)  # picks may lie below
    axes.set_yticks([0.1, 1, 10], ["0.1", "1", "10"])
    axes.set_xticks([1e-2, 1, 1e2, 1e4], ["0.01", "1", "100", "1e4"])
    axes.set_xlim(*cell_edges(sorted({getattr(row, stiffness) for row in rows}))[[0, -1]])


def _draw_picks(axes: Axes, rows: list[Row], stiffness: str) -> None:
    """What the rule picks: by itself a star, with this integrator asked for a circle."""
    own = {getattr(row, stiffness) for row in rows if row.case in _OWN}
    for row in rows:
        x, height, own_pick = getattr(row, stiffness), 1e3 * row.timestep, row.case in _OWN
        if own_pick or x not in own:
            below = height < 1.2 * _LOWEST
            marker = "v" if below else "*" if own_pick else "o"
            fill = {STABLE: "white", NO_TRUTH: _OUTCOMES[NO_TRUTH][0]}.get(row.outcome, "black")
            look = _PICK | {"markersize": 9 if own_pick else 4.5, "markerfacecolor": fill}
            axes.plot(x, 1.3 * _LOWEST if below else height, marker=marker, **look)


def _entries(cells: list[Row]) -> list:
    """Entries of the legend."""
    square, seen = {"linestyle": "", "marker": "s", "markersize": 9}, groups(cells, "outcome")
    point = {"linestyle": "", "markeredgecolor": "black", "markerfacecolor": "white"}
    return [
        *(
            entry(text, color=colour, **square)
            for outcome, (colour, _, text) in _OUTCOMES.items()
            if (outcome,) in seen
        ),
        entry("white: not run", **square | _EMPTY),
        entry("the rule's own pick", marker="*", markersize=9, **point),
        entry("rule, integrator asked for", marker="o", markersize=5, **point),
        entry("rule's pick below the axis", marker="v", markersize=5, **point),
        entry("rule's pick that failed", marker="o", **point | {"markerfacecolor": "black"}),
        entry("linear stability limit", color="black", linestyle="--"),
    ]
