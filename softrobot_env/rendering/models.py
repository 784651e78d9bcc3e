"""Tables and pictures of how accurate and how stable the models of one robot are."""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Table

from softrobot_env.evaluation.models.accuracy import AccuracyRow
from softrobot_env.evaluation.models.runs import Verdict, front
from softrobot_env.evaluation.models.stability import StabilityRow

from .figures import (
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    STYLES,
    VERMILLION,
    Axes,
    Figure,
    entry,
    finish,
    label_of,
    new_figure,
    plain_ticks,
    save,
    style_of,
)
from .tables import Column, make_table, new_table, number

#: Verdict -> colour and what a legend says.
VERDICTS = {
    Verdict.ACCURATE: (GREEN, "within the accuracy asked for"),
    Verdict.WARNED: (SKY, "less accurate, with a warning"),
    Verdict.REPORTED: (PURPLE, "refused or diverged, and said so"),
    Verdict.INACCURATE: (ORANGE, "less accurate, not a word"),
    Verdict.WRONG: (VERMILLION, "over 5 % off, not a word"),
    Verdict.UNJUDGED: (GREY, "refined runs do not agree"),
}

_SQUARE = {"linestyle": "", "marker": "s", "markersize": 9}
_STAR = {"marker": "*", "markersize": 8, "markerfacecolor": "none", "markeredgecolor": "black"}

#: Errors [% of the length] below are plotted at this value.
_FLOOR = 1e-6


def draw_front(
    axes: Axes,
    rows: Sequence[Any],
    style: dict[str, Any],
    error: str,
    cost: str,
    value: Callable[[Any], float],
    time: Callable[[Any], float],
) -> None:
    """All runs of a model as faint points, those that no cheaper one beats joined.

    Args:
        axes: Logarithmic ones.
        rows: Its runs.
        style: Colour and marker.
        error, cost: Fields that they are compared by.
        value, time: What is plotted of a row.
    """
    for chosen, line in (
        (rows, {"linestyle": "", "markersize": 3, "alpha": 0.35, "markeredgewidth": 0}),
        (front(rows, error, cost), {"linewidth": 1.4, "markersize": 5}),
    ):
        axes.plot([time(r) for r in chosen], [value(r) for r in chosen], **style, **line)


def cell_edges(values: Iterable[float]) -> np.ndarray:
    """Borders (k + 1,) of cells around increasing values (k,), on a logarithmic axis."""
    logs = np.log(list(values))
    if len(logs) == 1:
        return np.exp(logs[0] + np.array([-0.5, 0.5]))
    inner = (logs[1:] + logs[:-1]) / 2
    return np.exp(np.concatenate(([2 * logs[0] - inner[0]], inner, [2 * logs[-1] - inner[-1]])))


def model_entries(names: Iterable[str]) -> list:
    """Entries of a legend for models, in the order of `figures.STYLES`."""
    shown = set(names)
    point = {"markersize": 5, "linewidth": 1.4}
    return [
        entry(label_of(name), **STYLES[name].points, **point) for name in STYLES if name in shown
    ]


# ---------------------------------------------------------------- accuracy


def accuracy_tables(rows: Sequence[AccuracyRow]) -> Group:
    """Errors at rest, the best runs in motion, what is known of the limits, and notes."""
    columns = (
        Column("model"),
        Column("pieces", "n", "d"),
        Column("mean [mm]", "e_mean", ".3g", "mm"),
        Column("largest [mm]", "e_max", ".3g", "mm"),
        Column("share [%]", "share", ".2g", "%"),
    )
    setting = (Column("integrator", form=">"), Column("setting", _setting, ">"))
    best: list[AccuracyRow] = []
    for model in dict.fromkeys(row.model for row in _measured(rows, "motion")):
        mine = [row for row in _measured(rows, "motion") if row.model == model]
        best += front(mine, "e_max", "cost")
    limits = [row for row in rows if row.kind == "limit"]
    notes = [row for row in rows if row.e_max is None]
    parts: list[Table] = [
        make_table(
            "At rest: distance of the tip from the limit of the model's own physics",
            (*columns, Column("time [ms]", "cost", ".3g", "ms")),
            _measured(rows, "rest"),
        ),
        make_table(
            "In motion: runs that no cheaper one of the same model beats",
            (*columns[:2], *setting, *columns[2:], Column("s per s", "cost", ".2g")),
            best,
        ),
        make_table(
            "Limits of ever finer models", (Column("", "model"), columns[3], columns[4]), limits
        ),
    ]
    if notes:
        heading = Column("model", lambda row: f"{row.model} {row.n or ''}")
        parts.append(make_table("Without a figure", (heading, Column("why", "note")), notes))
    return Group(*parts)


def _measured(rows: Iterable[AccuracyRow], kind: str) -> list[AccuracyRow]:
    return [row for row in rows if row.kind == kind and row.e_max is not None]


def _setting(row: AccuracyRow) -> str:
    if row.integrator == "sdirk4":
        return f"tol {row.setting:.0e}".replace("e-0", "e-")
    unit = "mm" if row.integrator == "extrapolation" else "ms"
    return f"{number(row.setting, '.3g', unit)} {unit}"


def plot_accuracy(rows: Sequence[AccuracyRow], path: Path, robot: str) -> None:
    """Error against processor time, at rest and in motion."""
    figure, panels = new_figure(1, 2, (10, 4.6))
    axes = {
        "rest": (1e3, "time of an equilibrium [ms]"),
        "motion": (1, "time of 1 s of motion [s]"),
    }
    for axis, (kind, (unit, label)) in zip(panels.flat, axes.items(), strict=True):
        mine = _measured(rows, kind)
        for model in dict.fromkeys(row.model for row in mine):
            own = [row for row in mine if row.model == model]
            draw_front(
                axis,
                own,
                style_of(model).points,
                "e_max",
                "cost",
                lambda row: max(100 * row.share, _FLOOR),
                lambda row, unit=unit: unit * row.cost,
            )
        axis.set(xscale="log", yscale="log", xlabel=label)
        axis.set_title("at rest" if kind == "rest" else "random steps of all drives", fontsize=10)
        plain_ticks(axis, "x")
    panels[0, 0].set_ylabel("largest tip error [% of the length]")
    good = [row for row in _measured(rows, "motion") if row.share <= 0.01]
    message = "error against run time"
    if good:
        best = min(good, key=lambda row: row.cost)
        faster = f"{1 / best.cost:.0f} times faster than real time"
        message = f"the {label_of(best.model)} is the first within 1 %, {faster}"
    subject = "Each model to the limit of its own physics; all runs, and the best of each joined"
    entries = model_entries(row.model for row in rows)
    save(finish(figure, entries, f"{robot}: {message}", subject), path)


# ---------------------------------------------------------------- stability


def stability_tables(rows: Sequence[StabilityRow]) -> Group:
    """What became of the runs by integrator and timestep, and the package's own choices."""
    found: dict[tuple[str, str], list[Verdict]] = {}
    for row in sorted(rows, key=lambda row: row.case == "map"):
        if row.case != "own":
            step = "rule" if row.case == "rule" else number(row.timestep, ".3g", "ms")
            found.setdefault((row.integrator, step), []).append(row.verdict)
    heads = ("integrator", "ms", *VERDICTS)
    out = new_table("Runs with an integrator of MuJoCo's rule, and of one's choice", right=heads)
    for key, verdicts in found.items():
        out.add_row(*key, *(verdicts.count(verdict) or None for verdict in VERDICTS))
    columns = (
        Column("stiffness", lambda row: f"x {row.stiffness_scale:g}", ">"),
        Column("damping", lambda row: f"x {row.damping_scale:g}", ">"),
        Column("pieces", form="d"),
        Column("drives [%]", "amplitude", ".0f", "%"),
        Column("error [%]", "share", ".2g", "%"),
        Column("asked [mm]", "asked", ".2g", "mm"),
        Column("s per s", "cost", ".2g"),
        Column("verdict", form=">"),
    )
    own = [row for row in rows if row.case == "own"]
    said = "\n".join(dict.fromkeys(f"{row.verdict}: {row.why}" for row in own if row.why))
    return Group(out, make_table("What the package chooses by itself", columns, own, caption=said))


def plot_stability(rows: Sequence[StabilityRow], path: Path, robot: str) -> None:
    """Save a map of the runs of a robot."""
    save(stability_map(rows, robot), path)


def stability_map(rows: Sequence[StabilityRow], robot: str) -> Figure:
    """A map: a line of panels a damping, a column an integrator, a cell a run.

    Stars are timesteps that are chosen for `mj_step`, at the edge where they are shorter.
    """

    def look(row: StabilityRow) -> tuple[Any, str]:
        percent = 100 * (row.share or 0)
        text = f"{percent:.0f}" if percent >= 9.5 else f"{percent:.1g}"
        return VERDICTS[row.verdict][0], "" if row.share is None else text

    asked = [row for row in rows if row.case == "map"]
    stiffness = "stiffness_scale", "stiffness / robot's"
    figure, panels = new_maps(asked, ("damping_scale", "damping x {:g}"), stiffness, look)
    for row in rows:
        axes = panels.get((row.damping_scale, row.integrator))
        if row.case == "rule" and axes is not None:
            low, high = axes.get_ylim()
            height = np.clip(1e3 * row.timestep, 1.1 * low, high / 1.1)
            axes.plot(row.stiffness_scale, height, **_STAR)
    own = [row for row in rows if row.case == "own"]
    good = sum(row.verdict == Verdict.ACCURATE for row in own)
    message = f"{good} of {len(own)} runs are accurate with what the package chooses itself"
    shown = {row.verdict for row in asked}
    entries = [entry(text, color=c, **_SQUARE) for v, (c, text) in VERDICTS.items() if v in shown]
    entries.append(entry("chosen for mj_step", linestyle="", **_STAR))
    subject = "With an integrator and timestep asked for; numbers: error in % of the length"
    return finish(figure, entries, f"{robot}: {message}", subject)


def new_maps(
    rows: Sequence[Any],
    line: tuple[str, str],
    across: tuple[str, str],
    look: Callable[[Any], tuple[Any, str]],
) -> tuple[Figure, dict[tuple[float, str], Axes]]:
    """Maps of runs over a field and the timestep, one for each integrator and value of a field.

    Args:
        rows: Runs.
        line: Field whose values have lines of maps of their own, and a format of their label.
        across: Field along the horizontal axes, and its label.
        look: From a run to the colour of its cell and what is written there.

    Returns:
        The figure, and its axes by the value of the first field and the integrator.
    """
    integrators = list(dict.fromkeys(row.integrator for row in rows))
    (field, label), (x, x_label) = line, across
    values = sorted({getattr(row, field) for row in rows})
    size = (2.0 + 1.9 * len(integrators), 2.0 + 1.7 * len(values))
    figure, panels = new_figure(len(values), len(integrators), size, share=True)
    found = dict(zip(product(values, integrators), panels.flat, strict=True))
    for place, axes in found.items():
        mine = [row for row in rows if (getattr(row, field), row.integrator) == place]
        _draw_map(axes, mine, x, look)
    for first, value in zip(panels[:, 0], values, strict=True):
        first.set_ylabel(f"{label.format(value)}\ntimestep [ms]", fontsize=8.5)
    for top, bottom, integrator in zip(panels[0], panels[-1], integrators, strict=True):
        top.set_title(integrator, fontsize=10)
        bottom.set_xlabel(x_label, fontsize=8.5)
    return figure, found


def _draw_map(
    axes: Axes, rows: Sequence[Any], field: str, look: Callable[[Any], tuple[Any, str]]
) -> None:
    from matplotlib.colors import to_rgb

    x = sorted({getattr(row, field) for row in rows})
    y = sorted({1e3 * row.timestep for row in rows})
    picture = np.ones((len(y), len(x), 3))
    for row in rows:
        i, j = y.index(1e3 * row.timestep), x.index(getattr(row, field))
        colour, text = look(row)
        picture[i, j] = to_rgb(colour)
        axes.text(x[j], y[i], text, fontsize=6, ha="center", va="center")
    axes.grid(False)
    axes.pcolormesh(cell_edges(x), cell_edges(y), picture, edgecolors="white", linewidth=0.4)
    axes.set(xscale="log", yscale="log")
    axes.set_xticks(x, [f"{value:g}" for value in x])
    axes.set_yticks(y, [f"{value:g}" for value in y])
    axes.minorticks_off()
    axes.tick_params(labelsize=7.5)
