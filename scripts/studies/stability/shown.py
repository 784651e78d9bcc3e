"""The stability rows as tables that fit a terminal."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from softrobot_env.rendering.figures import (
    ORANGE,
    PURPLE,
    VERMILLION,
    Axes,
    Figure,
    add_legend,
    add_title,
    entry,
    new_figure,
)
from softrobot_env.rendering.models import cell_edges
from softrobot_env.rendering.tables import Column, make_table, new_table, number
from softrobot_env.robots import ARM
from studies.lab import groups, of_kind, select
from studies.stability import map as arm_map
from studies.stability import rig
from studies.stability.integrators import FrontRow, table
from studies.stability.integrators import figure as front_figure
from studies.stability.rig import ASKED, BOUND, JOINTS, MAP, RULE, TENSION_BOUND, RigRow
from studies.stability.rig import CASES as RIG_CASES
from studies.stability.runs import (
    CHAIN,
    CHAIN_INTEGRATORS,
    DIVERGED,
    NO_TRUTH,
    NOT_CONVERGED,
    STABLE,
    WRONG,
    Row,
)

#: Cases that make up the maps, and those of the rig; all others are extreme cases.
MAP_CASES = ("map", "rule", "rule_asked", "limit", *RIG_CASES)

_SHORT = {CHAIN: "chain", "implicit_euler": "impl. Euler"}


def tables(rows: list[Row]) -> list[Table]:
    """Shares of the maps, the rule, how sharp its limit is, extreme cases, the rig's, and costs."""
    costs, rows = of_kind(rows, FrontRow), of_kind(rows, Row)
    rig_rows = of_kind(rows, RigRow)
    parts = [_shares(rows), _rule(rows), _limits(rows), _extremes(rows)]
    parts += [_rig_safe(rig_rows), _rig_rule(rig_rows), _rig_failures(rig_rows)]
    return [*parts, table(costs)]


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


# ---------------------------------------------------------------- pictures

#: Outcome -> colour, sign in the cell, and text of the legend.
_OUTCOMES = {
    WRONG: (ORANGE, "~", "~  finite but wrong"),
    DIVERGED: (VERMILLION, "x", "x  diverged"),
    NOT_CONVERGED: (PURPLE, "N", "N  Newton's iteration failed"),
    NO_TRUTH: ("#CCCCCC", "?", "?  ended, but refined runs differ"),
}
_EMPTY = {"markerfacecolor": "white", "markeredgecolor": "0.6"}
_GREENS = ("#004D38", "#009E73", "#C9EBDD")

#: Errors [mm] at the ends of the shades of green.
_ERRORS = (0.02, 25.0)

#: Range [ms] of the axis; lower picks are drawn as triangles on its edge.
_LOWEST, _HIGHEST = 0.015, 28.0

#: Cases of the rule's own picks; its others have an integrator asked for.
_OWN = ("rule", RULE)


def pictures(rows: list[Row]) -> dict[str, Figure]:
    """A map for each model and resolution, that of the rig, and the integrators' error and cost."""
    costs, rows = of_kind(rows, FrontRow), of_kind(rows, Row)
    found = {"{}_integrators": front_figure(costs)} if costs else {}
    lines = ("damping_ratio", "damping ratio {:.2g}"), ("stiffness_scale", "stiffness / arm's")
    maps = groups(select(rows, case="map"), "model", "n")
    for index, ((model, n), cells) in enumerate(maps.items()):
        mine = select(rows, model=model, n=n)
        picks = select(mine, case="rule") + select(mine, case="rule_asked")
        name = "{}" if index == 0 else f"{{}}_{model.split('/')[0]}_{n}"
        found[name] = _draw(cells, picks, _title(cells[0]), *lines)
    cells = [row for row in rows if row.case in (MAP, RULE, ASKED) and _is_rig_itself(row)]
    if select(cells, case=MAP):
        found["{}_rig"] = _draw_rig(cells)
    return found


def _title(row: Row) -> str:
    if row.model == CHAIN:
        what = f"MuJoCo chain with {row.n} hinges"
    else:
        what = f"beam model {row.model} with {row.n} pieces"
    return (
        f"{what[0].upper()}{what[1:]}, a step of the tensions, three first periods or "
        f"{arm_map.MOST_STEPS} steps; green: within {1e3 * row.e_bound:g} mm (5 % of the length) "
        "of a refined run"
    )


def _message(cells: list[Row], picks: list[Row]) -> str:
    """How many of the rule's picks are good, or else how many runs of the map."""
    own = [row for row in picks if row.case in _OWN and row.outcome != NO_TRUTH]
    rows = own or [row for row in cells if row.outcome != NO_TRUTH]
    good = len(select(rows, outcome=STABLE))
    what = "timesteps that the rule picks by itself" if own else "runs"
    return f"{good} of {len(rows)} {what} are stable and right"


def _is_rig_itself(row: RigRow) -> bool:
    """Whether nothing but damping and tendon stiffness differs from the rig."""
    usual = 1.0, rig.Variation.pretension, 0.0, "bend"
    return (row.stiffness_scale, row.pretension, row.friction, row.motion) == usual


def _draw_rig(rows: list[RigRow]) -> Figure:
    cells = select(rows, case=MAP)
    dampings = {row.damping_scale for row in cells}
    return _draw(
        cells,
        [row for row in rows if row.case != MAP and row.damping_scale in dampings],
        f"Spatial rig with {JOINTS} joints, which servos bend to and fro for {rig.DURATION:g} s; "
        f"green: within {1e3 * BOUND:g} mm (5 % of the length) and {TENSION_BOUND:g} N of tension "
        "in the mean of a refined run",
        ("damping_scale", "damping x {:g}"),
        ("tendon_stiffness_scale", "tendon stiffness / nylon's"),
    )


def _draw(
    cells: list[Row],
    picks: list[Row],
    title: str,
    lines: tuple[str, str],
    stiffness: tuple[str, str],
) -> Figure:
    """A picture of a map and what the rule picks.

    Args:
        cells: Runs of the map.
        picks: What the rule picks, by itself and with an integrator asked for.
        title: Of the picture.
        lines: Field that the lines of panels differ in, and their label with it.
        stiffness: Field along the horizontal axis, and its label.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    (field, line_label), (x, x_label) = lines, stiffness
    greens = LinearSegmentedColormap.from_list("error", _GREENS)
    shades = ScalarMappable(LogNorm(*_ERRORS), greens)
    integrators = list(dict.fromkeys(row.integrator for row in cells))
    dampings = sorted({getattr(row, field) for row in cells})
    size = 1.6 + 1.75 * len(integrators), 2.2 + 1.6 * len(dampings)
    figure, panels = new_figure(len(dampings), len(integrators), size, share=True)
    for line, damping in zip(panels, dampings, strict=True):
        for axes, integrator in zip(line, integrators, strict=True):
            own = {"integrator": integrator, field: damping}
            mine = select(cells, **own)
            _draw_cells(axes, mine, x, shades)
            _draw_limit(axes, mine, x)
            _draw_picks(axes, select(picks, **own), x)
        line[0].set_ylabel(f"{line_label.format(damping)}\ntimestep [ms]", fontsize=8.5)
    for axes, integrator in zip(panels[0], integrators, strict=True):
        axes.set_title(integrator, fontsize=10, fontweight="bold")
    for axes in panels[-1]:
        axes.set_xlabel(x_label, fontsize=8.5)
    add_title(figure, _message(cells, picks), title)
    place = {"location": "right", "shrink": 0.6, "aspect": 30, "pad": 0.01}
    bar = figure.colorbar(shades, ax=panels, **place)
    bar.set_label("stable: largest error of the tip [mm]", fontsize=8.5)
    bar.ax.tick_params(labelsize=7.5)
    ruled = cells[0].model == CHAIN
    add_legend(figure, _entries({row.outcome for row in cells}, bool(picks), ruled))
    return figure


def _draw_cells(axes: Axes, rows: list[Row], stiffness: str, shades: Any) -> None:
    """One rectangle per run, between the geometric means of neighbours; shades are errors."""
    from matplotlib.colors import to_rgb

    x = sorted({getattr(row, stiffness) for row in rows})
    y = sorted({1e3 * row.timestep for row in rows})
    picture = np.ones((len(y), len(x), 3))
    for row in rows:
        i, j = y.index(1e3 * row.timestep), x.index(getattr(row, stiffness))
        if row.outcome == STABLE:
            picture[i, j] = shades.to_rgba(max(1e3 * row.e_max, _ERRORS[0]))[:3]
        else:
            colour, sign, _ = _OUTCOMES[row.outcome]
            picture[i, j] = to_rgb(colour)
            axes.text(x[j], y[i], sign, fontsize=6, ha="center", va="center", alpha=0.6)
    axes.grid(False)
    axes.pcolormesh(cell_edges(x), cell_edges(y), picture, edgecolors="white", linewidth=0.4)
    axes.set(xscale="log", yscale="log")
    ruled = rows[0].model == CHAIN  # its picks may lie below the map
    axes.set_ylim(_LOWEST if ruled else cell_edges(y)[0], _HIGHEST)
    axes.set_yticks([0.1, 1, 10], ["0.1", "1", "10"])
    axes.set_xticks([1e-2, 1, 1e2, 1e4])
    axes.minorticks_off()
    axes.set_xlim(*cell_edges(x)[[0, -1]])
    axes.tick_params(labelsize=7.5)


def _draw_limit(axes: Axes, rows: list[Row], stiffness: str) -> None:
    """Stability limit of the linearised chain."""
    limits = {getattr(r, stiffness): 1e3 * r.stability_limit for r in rows if r.stability_limit}
    x = sorted(limits)
    axes.plot(x, [limits[s] for s in x], color="black", linestyle="--", linewidth=1.1)


def _draw_picks(axes: Axes, rows: list[Row], stiffness: str) -> None:
    """What the rule picks: by itself a star, with this integrator asked for a circle."""
    own = {getattr(row, stiffness) for row in rows if row.case in _OWN}
    for row in rows:
        x, height, own_pick = getattr(row, stiffness), 1e3 * row.timestep, row.case in _OWN
        if not own_pick and x in own:
            continue
        below = height < 1.2 * _LOWEST
        axes.plot(
            x,
            1.3 * _LOWEST if below else height,
            marker="v" if below else "*" if own_pick else "o",
            markersize=9 if own_pick else 4.5,
            markerfacecolor=_fill(row.outcome),
            markeredgecolor="black",
            markeredgewidth=0.7,
        )


def _fill(outcome: str) -> str:
    """Colour of a pick of the rule."""
    return {STABLE: "white", NO_TRUTH: _OUTCOMES[NO_TRUTH][0]}.get(outcome, "black")


def _entries(outcomes: set[str], ruled: bool, below: bool) -> list:
    """Entries of the legend; `below` says that axes go below the map."""
    square = {"linestyle": "", "marker": "s", "markersize": 9}
    handles = [
        entry(text, color=colour, **square)
        for outcome, (colour, _, text) in _OUTCOMES.items()
        if outcome in outcomes
    ]
    if below:
        handles.append(entry("white: not run", **square | _EMPTY))
    if not ruled:
        return handles
    point = {"linestyle": "", "markeredgecolor": "black", "markerfacecolor": "white"}
    return [
        *handles,
        entry("the rule's own pick", marker="*", markersize=9, **point),
        entry("rule, integrator asked for", marker="o", markersize=5, **point),
        entry("rule's pick below the axis", marker="v", markersize=5, **point),
        entry("rule's pick that failed", marker="o", **point | {"markerfacecolor": "black"}),
        entry("linear stability limit", color="black", linestyle="--"),
    ]
