"""A map of stability as a picture: panels by damping and integrator, a cell for each run."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.benchmarks.stability.runs import (
    CHAIN,
    DIVERGED,
    NO_TRUTH,
    NOT_CONVERGED,
    STABLE,
    WRONG,
    Row,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, LogNorm
    from matplotlib.figure import Figure

#: Okabe and Ito's colours, distinguishable with colour-blindness.
_COLORS = {WRONG: "#E69F00", DIVERGED: "#D55E00", NOT_CONVERGED: "#CC79A7", NO_TRUTH: "#CCCCCC"}
_GREENS = ("#004D38", "#009E73", "#C9EBDD")
_SIGNS = {WRONG: "~", DIVERGED: "x", NOT_CONVERGED: "N", NO_TRUTH: "?"}
_WORDS = {
    WRONG: "~  finite but wrong",
    DIVERGED: "x  diverged",
    NOT_CONVERGED: "N  Newton's iteration failed",
    NO_TRUTH: "?  ended, but refined runs differ",
}

#: Errors [mm] at the ends of the shades of green.
_ERRORS = (0.02, 25.0)

#: Range [ms] of the axis; lower picks are drawn as triangles on its edge.
_LOWEST, _HIGHEST = 0.015, 28.0


@dataclass(frozen=True)
class Names:
    """What a picture tells.

    Attributes:
        title: Of the picture.
        line: Of a line of panels, to be formatted with the damping.
        x: Of the horizontal axis.
    """

    title: str
    line: str
    x: str


def draw_map(cells: list[Row], picks: list[Row], names: Names, path: Path) -> None:
    """Draw the cells of a map and what the rule picks, by damping, integrator and stiffness."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure

    colors = LinearSegmentedColormap.from_list("error", _GREENS)
    norm = LogNorm(*_ERRORS)
    integrators = list(dict.fromkeys(row["integrator"] for row in cells))
    dampings = sorted({row["damping_ratio"] for row in cells})
    width, height = 1.6 + 2.15 * len(integrators), 2.2 + 1.75 * len(dampings)
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(
        len(dampings), len(integrators), sharex=True, sharey=True, squeeze=False
    )
    for line, damping in zip(panels, dampings, strict=True):
        for axes, integrator in zip(line, integrators, strict=True):
            own = (integrator, damping)
            mine = [r for r in cells if (r["integrator"], r["damping_ratio"]) == own]
            _draw_cells(axes, mine, colors, norm)
            _draw_limit(axes, mine)
            _draw_picks(axes, [r for r in picks if (r["integrator"], r["damping_ratio"]) == own])
        line[0].set_ylabel(f"{names.line.format(damping)}\ntimestep [ms]", fontsize=8.5)
    for axes, integrator in zip(panels[0], integrators, strict=True):
        axes.set_title(integrator, fontsize=10, fontweight="bold")
    for axes in panels[-1]:
        axes.set_xlabel(names.x, fontsize=8.5)
    figure.suptitle(names.title, fontsize=11)
    _legend(figure, colors, norm, panels, {row["outcome"] for row in cells}, bool(picks))
    figure.savefig(path, dpi=150)


def _draw_cells(axes: "Axes", rows: list[Row], colors: "Colormap", norm: "LogNorm") -> None:
    """One rectangle per run, between the geometric means of neighbouring values."""
    from matplotlib.colors import to_rgb

    x = sorted({row["stiffness_scale"] for row in rows})
    y = sorted({1e3 * row["timestep"] for row in rows})
    picture = np.ones((len(y), len(x), 3))
    for row in rows:
        i, j = y.index(1e3 * row["timestep"]), x.index(row["stiffness_scale"])
        if row["outcome"] == STABLE:
            picture[i, j] = colors(norm(max(1e3 * row["e_max"], _ERRORS[0])))[:3]
        else:
            picture[i, j] = to_rgb(_COLORS[row["outcome"]])
            axes.text(
                x[j], y[i], _SIGNS[row["outcome"]], fontsize=6, ha="center", va="center", alpha=0.6
            )
    axes.pcolormesh(_edges(x), _edges(y), picture, edgecolors="white", linewidth=0.4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    ruled = rows[0]["model"] == CHAIN  # its picks may lie below the map
    axes.set_ylim(_LOWEST if ruled else _edges(y)[0], _HIGHEST)
    _ticks(axes)


def _edges(values: list[float]) -> np.ndarray:
    """Borders (k + 1,) of cells around increasing values (k,), on a logarithmic axis."""
    logs = np.log(values)
    inner = (logs[1:] + logs[:-1]) / 2
    return np.exp(np.concatenate(([2 * logs[0] - inner[0]], inner, [2 * logs[-1] - inner[-1]])))


def _ticks(axes: "Axes") -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    axes.yaxis.set_major_locator(FixedLocator([0.1, 1, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_major_locator(FixedLocator([1e-2, 1, 1e2, 1e4]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(labelsize=7.5)


def _draw_limit(axes: "Axes", rows: list[Row]) -> None:
    """Stability limit of the linearised chain."""
    limits = {
        r["stiffness_scale"]: 1e3 * r["stability_limit"] for r in rows if r["stability_limit"]
    }
    x = sorted(limits)
    axes.plot(x, [limits[s] for s in x], color="black", linestyle="--", linewidth=1.1)


def _draw_picks(axes: "Axes", rows: list[Row]) -> None:
    """What the rule picks: by itself a star, with this integrator asked for a circle."""
    own = {row["stiffness_scale"] for row in rows if row["case"] == "rule"}
    for row in rows:
        if row["case"] == "rule_asked" and row["stiffness_scale"] in own:
            continue
        own_pick, height = row["case"] == "rule", 1e3 * row["timestep"]
        below = height < _LOWEST
        axes.plot(
            row["stiffness_scale"],
            1.3 * _LOWEST if below else height,
            marker="v" if below else "*" if own_pick else "o",
            markersize=9 if own_pick else 4.5,
            markerfacecolor=_fill(row["outcome"]),
            markeredgecolor="black",
            markeredgewidth=0.7,
        )


def _fill(outcome: str) -> str:
    """Colour of a pick of the rule."""
    return {STABLE: "white", NO_TRUTH: _COLORS[NO_TRUTH]}.get(outcome, "black")


def _legend(
    figure: "Figure",
    colors: "Colormap",
    norm: "LogNorm",
    panels: np.ndarray,
    outcomes: set[str],
    rule: bool,
) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    bar = figure.colorbar(
        ScalarMappable(norm, colors), ax=panels, location="right", shrink=0.6, aspect=30, pad=0.01
    )
    bar.set_label("stable: largest error of the tip [mm]", fontsize=8.5)
    bar.ax.tick_params(labelsize=7.5)
    handles = [Patch(color=_COLORS[o], label=_WORDS[o]) for o in _COLORS if o in outcomes]
    if rule:
        point = {"linestyle": "", "markeredgecolor": "black", "markerfacecolor": "white"}
        failed = point | {"markerfacecolor": "black"}
        handles += [
            Line2D([], [], marker="*", markersize=9, label="the rule's own pick", **point),
            Line2D([], [], marker="o", markersize=5, label="rule, integrator asked for", **point),
            Line2D([], [], marker="v", markersize=5, label="rule's pick below the axis", **point),
            Line2D([], [], marker="o", markersize=5, label="rule's pick that failed", **failed),
            Line2D([], [], color="black", linestyle="--", label="linear stability limit"),
        ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)
