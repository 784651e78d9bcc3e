"""Maps of stability as pictures: panels by damping and integrator, a cell for each run."""

from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.benchmarks.records import groups, select
from softrobot_env.benchmarks.stability.front import FrontRow
from softrobot_env.benchmarks.stability.front import figure as front_figure
from softrobot_env.benchmarks.stability.map import MOST_STEPS
from softrobot_env.benchmarks.stability.rig import cases as rig
from softrobot_env.benchmarks.stability.rig.runs import (
    ASKED,
    BOUND,
    JOINTS,
    MAP,
    RULE,
    TENSION_BOUND,
    RigRow,
)
from softrobot_env.benchmarks.stability.runs import CHAIN, DIVERGED, NOT_CONVERGED
from softrobot_env.benchmarks.stability.verdicts import NO_TRUTH, STABLE, WRONG, Row
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
    save,
)

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


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw one picture per model and resolution as PNG.

    Args:
        rows: Rows of `benchmarks.stability.run`.
        path: File of the first model's picture; the others get the model's name appended, that of
            the rig "_rig", and that of error against cost "_integrators".
    """
    costs = [row for row in rows if isinstance(row, FrontRow)]
    rows = [row for row in rows if not isinstance(row, FrontRow)]
    path = Path(path)
    if costs:
        save(front_figure(costs), path.with_stem(f"{path.stem}_integrators"))
    lines = ("damping_ratio", "damping ratio {:.2g}"), ("stiffness_scale", "stiffness / arm's")
    for index, ((model, n), cells) in enumerate(
        groups(select(rows, case="map"), "model", "n").items()
    ):
        mine = select(rows, model=model, n=n)
        picks = select(mine, case="rule") + select(mine, case="rule_asked")
        figure = _draw(cells, picks, _title(cells[0]), *lines)
        name = path.stem if index == 0 else f"{path.stem}_{model.split('/')[0]}_{n}"
        save(figure, path.with_stem(name))
    cells = [row for row in rows if row.case in (MAP, RULE, ASKED) and _is_rig_itself(row)]
    if select(cells, case=MAP):
        save(_draw_rig(cells), path.with_stem(f"{path.stem}_rig"))


def _title(row: Row) -> str:
    if row.model == CHAIN:
        what = f"MuJoCo chain with {row.n} hinges"
    else:
        what = f"beam model {row.model} with {row.n} pieces"
    return (
        f"{what[0].upper()}{what[1:]}, a step of the tensions, three first periods or "
        f"{MOST_STEPS} steps; green: within {1e3 * row.e_bound:g} mm (5 % of the length) of a "
        "refined run"
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
    axes.pcolormesh(_edges(x), _edges(y), picture, edgecolors="white", linewidth=0.4)
    axes.set(xscale="log", yscale="log")
    ruled = rows[0].model == CHAIN  # its picks may lie below the map
    axes.set_ylim(_LOWEST if ruled else _edges(y)[0], _HIGHEST)
    axes.set_yticks([0.1, 1, 10], ["0.1", "1", "10"])
    axes.set_xticks([1e-2, 1, 1e2, 1e4])
    axes.minorticks_off()
    axes.set_xlim(*_edges(x)[[0, -1]])
    axes.tick_params(labelsize=7.5)


def _edges(values: list[float]) -> np.ndarray:
    """Borders (k + 1,) of cells around increasing values (k,), on a logarithmic axis."""
    logs = np.log(values)
    inner = (logs[1:] + logs[:-1]) / 2
    return np.exp(np.concatenate(([2 * logs[0] - inner[0]], inner, [2 * logs[-1] - inner[-1]])))


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
