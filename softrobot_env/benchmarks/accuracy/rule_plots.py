"""Figure of the accuracy benchmark that compares the hinge rules of the MuJoCo chain."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from softrobot_env.benchmarks.accuracy.run import is_chain, rule_of
from softrobot_env.scene.quadrature import RULES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

Row = dict[str, Any]

#: Okabe and Ito's colours, distinguishable with colour-blindness, and one marker per rule.
_STYLE = dict(
    zip(
        RULES,
        (("#000000", "o"), ("#0072B2", "s"), ("#D55E00", "D"), ("#009E73", "^"), ("#CC79A7", "v")),
        strict=True,
    )
)

#: Cases whose truth is the same for all, with their titles.
_TITLES = {
    "self_weight_weak": "self-weight, weak",
    "self_weight_stiff": "self-weight, stiff",
    "tip_moment_1Nm": "tip moment 1 N m",
    "tip_force_3N": "tip force 3 N",
    "tendon_static": "tendon 20 N (arm)",
}

#: Chains shown in the work-precision figure; gauss3 has other numbers and goes to the nearest.
_NEAREST = {9: 6, 18: 12, 36: 24}

_LINES = {"implicitfast": ("-", 1.0), "discrete": (":", 0.0)}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw tip error against hinges (static) above error against run time (dynamic) as PNG.

    Args:
        rows: Rows of `benchmarks.accuracy.run`.
        path: File to write.
    """
    from matplotlib.figure import Figure

    rows = [row for row in rows if row["kind"] in ("static", "dynamic") and is_chain(row)]
    figure = Figure(figsize=(11, 7.4), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.15])
    _draw_static(upper, [row for row in rows if row["case"] in _TITLES])
    _draw_dynamic(lower, [row for row in rows if row["case"] == "tension_step"])
    figure.savefig(path, dpi=200)


def _draw_static(figure: "SubFigure", rows: list[Row]) -> None:
    figure.suptitle("Static tip error of the chain, by hinge rule", fontsize=11)
    panels = figure.subplots(1, len(_TITLES), sharex=True, sharey=True)
    for axes, (case, title) in zip(panels, _TITLES.items(), strict=True):
        mine = [row for row in rows if row["case"] == case]
        for rule in RULES:
            _line(axes, rule, [row for row in mine if rule_of(row) == rule], x="n", y="e_mean")
        _second_order(axes)
        label_axes(axes, title, "number of hinges")
        _hinge_ticks(axes)
    panels[0].set_ylabel("tip error [mm]")
    panels[0].set_ylim(5e-7, 20)
    panels[0].legend(fontsize=7.5, loc="lower left", framealpha=0.9)


def _draw_dynamic(figure: "SubFigure", rows: list[Row]) -> None:
    figure.suptitle(
        "Tension step of the arm, 3 s: mean tip error against run time, "
        "timesteps 10, 5, 2 and 1 ms from left to right",
        fontsize=11,
    )
    sizes = sorted({_NEAREST.get(row["n"], row["n"]) for row in rows})
    panels = figure.subplots(1, max(1, len(sizes)), sharey=True, squeeze=False)[0]
    for axes, n in zip(panels, sizes, strict=False):
        mine = [row for row in rows if _NEAREST.get(row["n"], row["n"]) == n]
        for integrator in _LINES:
            chosen = [row for row in mine if row["integrator"] == integrator]
            for rule in RULES:
                same = [row for row in chosen if rule_of(row) == rule]
                _line(axes, rule, same, "wall_time", "e_mean", integrator)
        label_axes(axes, _size_title(n, mine), "run time [ms]")
        _time_ticks(axes)
    panels[0].set_ylabel("mean tip error [mm]")
    panels[0].set_ylim(0.02, 5)
    _integrator_legend(panels[0])


def _line(
    axes: "Axes", rule: str, rows: list[Row], x: str, y: str, integrator: str = "implicitfast"
) -> None:
    """One rule's errors [mm] over hinges or run time [ms]."""
    rows = sorted(rows, key=lambda row: (row["n"], -row["timestep"]))
    color, marker = _STYLE[rule]
    dashes, filled = _LINES[integrator]
    axes.plot(
        [row[x] * (1e3 if x == "wall_time" else 1) for row in rows],
        [1e3 * row[y] for row in rows],
        color=color,
        marker=marker,
        markersize=4,
        markerfacecolor=color if filled else "white",
        linestyle=dashes,
        linewidth=1.2,
        label=rule,
    )


def _second_order(axes: "Axes") -> None:
    axes.plot([6, 48], [20, 20 / 64], color="0.55", linestyle="--", linewidth=1, zorder=0)
    axes.text(20, 3.2, "order 2", color="0.4", fontsize=7.5)


def label_axes(axes: "Axes", title: str, x: str) -> None:
    """Logarithmic axes with a title, a name of x and a quiet grid."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(title, fontsize=9.5)
    axes.set_xlabel(x)
    axes.grid(which="major", color="0.85", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)


def _hinge_ticks(axes: "Axes") -> None:
    axes.set_xticks([6, 12, 24, 48], labels=["6", "12", "24", "48"])
    axes.set_xticks([], minor=True)


def _time_ticks(axes: "Axes") -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _size_title(n: int, rows: list[Row]) -> str:
    others = sorted({row["n"] for row in rows if row["n"] != n})
    return f"{n} hinges" + "".join(f" (gauss3: {k})" for k in others)


def _integrator_legend(axes: "Axes") -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            color="0.3",
            marker="o",
            markersize=4,
            linestyle=dashes,
            label=name,
            markerfacecolor="0.3" if filled else "white",
        )
        for name, (dashes, filled) in _LINES.items()
    ]
    axes.legend(handles=handles, fontsize=7.5, loc="lower left", framealpha=0.9)
