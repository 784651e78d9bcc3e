"""Pictures of `studies.thesis`, one for each group of figures."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import BLACK, BLUE, GREEN, Axes, entry, label_of, style_of
from studies import lab
from studies.truths import thesis_values as values

#: A row of `studies.thesis`.
Row = Any

#: Models by name in the rows.
MODELS = ("pcc", "cosserat", "ancf")

#: Lines and texts beside the models; hollow markers; and no line.
_GREY, _HOLLOW = "0.35", {"linestyle": ":", "markerfacecolor": "white"}


def select(rows: list[Row], **chosen: Any) -> list[Row]:
    """Rows with given values of some fields and a value y."""
    return [row for row in lab.select(rows, **chosen) if row.y is not None]


# -------------------- what the panels have in common


def _draw(axes: Axes, rows: list[Row], factor: float = 1.0, x: str = "n", **line: Any) -> None:
    """y times a factor over n or x, in the style of the rows' model unless given."""
    if rows:
        model = rows[0].model
        style = {"markersize": 4, "linewidth": 1.1, "label": label_of(model)}
        rows = sorted(rows, key=lambda row: getattr(row, x))
        places = [getattr(row, x) for row in rows], [factor * row.y for row in rows]
        axes.plot(*places, **(style_of(model).points | style | line))


def _draw_models(axes: Axes, rows: list[Row], factor: float = 1.0, **chosen: Any) -> None:
    for model in MODELS:
        _draw(axes, select(rows, model=model, **chosen), factor)


def _draw_level(axes: Axes, y: float, **line: Any) -> None:
    """A horizontal line for a number that does not depend on the abscissa."""
    axes.axhline(y, **({"color": _GREY, "linewidth": 1} | line))


def _finish(axes: Axes, named: bool = True, pieces: bool = True, **settings: Any) -> None:
    """Scales and labels; whole numbers of pieces; names of all lines at their right ends."""
    from matplotlib.ticker import MaxNLocator

    if pieces:
        axes.set_xlabel("number of pieces")
    axes.set(**settings)
    if pieces:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if named:
        lines = [line for line in axes.lines if not line.get_label().startswith("_")]
        ends = [(one.get_label(), float(one.get_ydata()[-1]), one.get_color()) for one in lines]
        figures.label_lines(axes, ends)


def _note(axes: Axes, place: tuple[float, float], text: str, **options: Any) -> None:
    """A grey text above a place in the axes' units."""
    text_at = {"xytext": (0, 3), "textcoords": "offset points", "color": _GREY, "fontsize": 8}
    axes.annotate(text, place, **(text_at | options))


def _model_entries() -> list[figures.Line2D]:
    return [entry(label_of(m), **style_of(m).points | {"markersize": 4}) for m in MODELS]


def _hollow_entry(text: str) -> figures.Line2D:
    return entry(text, color=_GREY, marker="o", markersize=4, **_HOLLOW)


def _finest(rows: list[Row], **chosen: Any) -> dict[str, Row]:
    """Model -> its row with the most pieces."""
    found = {model: select(rows, model=model, **chosen) for model in MODELS}
    return {model: max(mine, key=lambda row: row.n) for model, mine in found.items() if mine}


# -------------------- accuracy: Fig. 2.11 to 2.15

_LOCKED = {
    "nu = 0.49, plane stress": (figures.SKY, "v"),
    "nu = 0.49, plane strain": (figures.WINE, "D"),
}
_THEORY = {
    "euler_bernoulli": ("Euler-Bernoulli", "--"),
    "timoshenko": ("Timoshenko, k = 3/4", "-."),
    "elastica": ("elastica (no shear)", (0, (1, 1))),
    "exact_rod": ("exact rod, k = 3/4", "-"),
}


def _draw_pieces(
    axes: Axes, rows: list[Row], figure: str, y_name: str, factor: float, *panel: Any
) -> None:
    """Models over their pieces, ANCF with the Poisson ratio of silicone, and beam theories."""
    label, name, limits = panel
    for model, (text, dashes) in _THEORY.items():
        for row in select(rows, figure=figure, case=name, model=model):
            _draw_level(axes, factor * row.y, linestyle=dashes, label=text, zorder=1)
    _draw_models(axes, rows, factor, figure=figure, case=name, y_name=y_name)
    for case, (color, marker) in _LOCKED.items():
        mine = select(rows, figure=figure, case=f"{name}, {case}")
        _draw(axes, mine, factor, color=color, marker=marker, label=f"ANCF, {case}")
    _finish(axes, named=False, ylabel=label, ylim=limits)
    # Say where the finest discretisation of the last law lies that is above the panel's top.
    finest = max(mine, key=lambda row: row.n, default=None)
    if finest is not None and factor * finest.y > limits[1]:
        text = f"plane strain is off the scale: {finest.y:.3g} Hz"
        axes.text(0.97, 0.95, text, transform=axes.transAxes, ha="right", va="top", fontsize=8)


def _draw_centrelines(axes: Axes, rows: list[Row]) -> None:
    for model in MODELS:
        mine = select(rows, figure="2.12", model=model)
        x, y = ([1e3 * getattr(row, name) for row in mine] for name in "xy")
        axes.plot(x, y, color=style_of(model).colour, linewidth=1.3, label=label_of(model))
    axes.invert_yaxis()
    labels = {"xlabel": "along the straight beam [mm]", "ylabel": "deflection [mm]"}
    _finish(axes, pieces=False, aspect="equal", **labels)


def _draw_twist(axes: Axes, rows: list[Row]) -> None:
    (exact,) = select(rows, figure="2.14", case="0.01 N m")
    _draw_level(axes, 1e3 * exact.y, label="exact")
    for model in MODELS:
        hollow = {"markerfacecolor": "none", "label": f"{label_of(model)}, tip"}
        mine = select(rows, figure="2.14", case="tip", model=model)
        _draw(axes, mine, 1e3, **(hollow if model == "cosserat" else {}))
    mine = select(rows, figure="2.14", case="last section")
    _draw(axes, mine, 1e3, label="Cosserat rod, last\nsection (thesis)")
    _finish(axes, ylabel="torsion angle at 0.01 N m [mrad]")


def _draw_torsional(axes: Axes, rows: list[Row]) -> None:
    hollow = {"markerfacecolor": "none", "linestyle": ":"}
    for case, line in {"nu = 0": {}, "nu = 0.49": hollow}.items():
        for row in select(rows, figure="2.15", case=case, model="analytic"):
            _draw_level(axes, row.y, linestyle=line.get("linestyle", "-"))
            _note(axes, (20, row.y), f"exact, {case}", ha="right", xytext=(0, 5))
        for model in MODELS:
            _draw(axes, select(rows, figure="2.15", case=case, model=model), **line)
    _finish(axes, named=False, ylabel="first torsional frequency [Hz]")


def _accuracy_legend() -> list[figures.Line2D]:
    theory = [entry(t, color=_GREY, linestyle=line, linewidth=1) for t, line in _THEORY.values()]
    locked = [
        entry(f"ANCF, {case}", color=colour, marker=marker, markersize=4)
        for case, (colour, marker) in _LOCKED.items()
    ]
    return [*theory, *_model_entries(), *locked, _hollow_entry("Fig. 2.15: nu = 0.49")]


def _accuracy_message(rows: list[Row]) -> str:
    """How far the finest models are from the exact rod under their weight."""
    off, sag = [], {"figure": "2.11", "y_name": "tip_deflection_m"}
    for exact in select(rows, model="exact_rod", **sag):
        for model, row in _finest(rows, case=exact.case, **sag).items():
            off.append((abs(row.y / exact.y - 1), row.n, f"{label_of(model)}, {exact.case} set"))
    share, pieces, where = max(off)
    return (
        f"With {pieces} pieces and nu = 0 deflections are within {100 * share:.2g} % of the exact "
        f"rod's (farthest: {where})"
    )


# -------------------- Cosserat rod: Fig. 2.4 to 2.6

#: Solver and projection -> colour.
_SOLVERS = {"BDF": BLUE, "Radau": figures.VERMILLION, "Radau, projected": GREEN}

#: Text -> line by the tolerance of Fig. 2.4.
_TOLERANCES = {"Fig. 2.4: relative tolerance 1e-3": "-", "1e-5 (thesis: stricter)": ":"}


def _draw_drift(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.4")
    dashes = {row.case: ":" if row.case.endswith("1e-05") else "-" for row in mine}
    for (case,), path in lab.groups(select(mine, x_name="time_s"), "case").items():
        name = case.replace(", not projected", "").rpartition(",")[0]
        line = {"color": _SOLVERS[name], "linestyle": dashes[case], "linewidth": 1.3}
        axes.plot([row.x for row in path], [row.y for row in path], label=name, **line)
    for row in mine:
        if row.thesis is not None:
            line = {"color": BLACK, "linestyle": dashes[row.case], "linewidth": 0.9}
            axes.axhline(row.thesis, label="thesis, projected", **line)
    labels = {"xlabel": "time [s]", "ylabel": "largest violation of the norm"}
    _finish(axes, pieces=False, yscale="log", **labels)


def _draw_weightings(axes: Axes, rows: list[Row]) -> None:
    for kind, color in enumerate(
        (BLACK, figures.VERMILLION, figures.PURPLE, figures.ORANGE, BLUE), start=1
    ):
        mine = select(rows, figure="2.5", case=f"xi_{kind}")
        theta = [np.degrees(row.x) for row in mine]
        line = {"color": color, "linewidth": 1.3, "label": rf"$\xi_{kind}$"}
        axes.plot(theta, [row.y for row in mine], **line)
    labels = {"xlabel": "half the angle between sections [deg]", "ylabel": "weighting"}
    _finish(axes, pieces=False, xlim=(0, 90), ylim=(0.9, 3), **labels)


def _draw_influence(axes: Axes, rows: list[Row]) -> None:
    for moments, dashes, face in (("printed", "-", GREEN), ("conservative", ":", "white")):
        for n, marker in ((3, "s"), (5, "D")):
            mine = select(rows, figure="2.6", case=moments, n=n, y_name="tip_deflection_m")
            line = {"linestyle": dashes, "marker": marker, "markerfacecolor": face}
            _draw(axes, mine, 1e3, x="x", label=f"{n} pieces,\n{moments}", **line)
    axes.set_xticks(range(1, 6), [rf"$\xi_{k}$" for k in range(1, 6)])
    _finish(axes, pieces=False, ylabel="tip deflection [mm], weak set")


def _cosserat_message(rows: list[Row]) -> str:
    """How far quaternions drift with and without projection."""
    drift: dict[str, float] = {}
    for row in select(rows, figure="2.4", x_name="time_s"):
        how = "not projected" if ", not projected" in row.case else "projected"
        drift[how] = max(row.y, drift.get(how, 0.0))
    sizes = [f"{value:.1g} when {how}" for how, value in drift.items()]
    return f"Norms of quaternions drift by up to {' and '.join(sizes)}"


# -------------------- quadrature: Fig. 2.8 and 2.9


def _draw_errors(axes: Axes, rows: list[Row]) -> None:
    mine = select(rows, figure="2.8", y_name="relative_rms_error")
    for reference, color, marker, by in (
        ("order 20", GREEN, "^", "\n(thesis)"),
        ("exact", figures.VERMILLION, "o", ""),
    ):
        line = {"color": color, "marker": marker, "label": f"against {reference}{by}"}
        _draw(axes, select(mine, case=f"legendre, against {reference}"), x="x", **line)
    _draw_level(axes, 1e-3, linestyle="--")
    _note(axes, (20, 1e-3), "0.1 %", ha="right")
    axes.axvline(values.ORDER, color=_GREY, linewidth=1, linestyle=":")
    axes.text(values.ORDER + 0.2, 0.25, "thesis' choice", color=_GREY, fontsize=8)
    _finish_orders(axes, "relative rms error of the elastic force")


def _draw_times(axes: Axes, rows: list[Row]) -> None:
    _draw(axes, select(rows, figure="2.9", case="legendre"), 1e6, x="x", label="Gauss-Legendre")
    for case, color, dashes, label in (
        ("exact", figures.VERMILLION, "-", "moments, exact"),
        ("chebyshev", BLUE, "--", "Gauss-Chebyshev,\nexact"),
    ):
        for row in select(rows, figure="2.9", case=case):
            _draw_level(axes, 1e6 * row.y, color=color, linestyle=dashes, label=label)
    printed = values.ORDER, 1e6 * values.ORDER_TIME
    axes.plot(*printed, **figures.THESIS | {"label": "_"})
    _note(axes, printed, "thesis", ha="center", xytext=(0, 8))
    _finish_orders(axes, "time per evaluation [µs]")


def _finish_orders(axes: Axes, y: str) -> None:
    axes.set_xticks(range(0, 21, 2))
    _finish(axes, pieces=False, yscale="log", xlabel="order of Gauss-Legendre", ylabel=y)


def _quadrature_message(rows: list[Row]) -> str:
    """What the thesis' order errs, and costs over exact moments."""
    chosen = {"x": values.ORDER, "figure": "2.8", "y_name": "relative_rms_error"}
    (error,) = select(rows, case="legendre, against exact", **chosen)
    (time,) = select(rows, figure="2.9", case="legendre", x=values.ORDER)
    (exact,) = select(rows, figure="2.9", case="exact")
    return (
        f"Order {values.ORDER}, the thesis' choice, errs by {100 * error.y:.2g} % and takes "
        f"{time.y / exact.y:.2g} times as long as exact moments"
    )


# -------------------- cost: Fig. 2.16 to 2.19, Tab. 2.2 and 2.3


def _draw_evaluation_times(axes: Axes, rows: list[Row]) -> None:
    _draw_models(axes, rows, 1e6, figure="2.16", case="compiled", y_name="evaluation_time_s")
    mine = select(rows, figure="2.16", case="compiled, order 8")
    _draw(axes, mine, 1e6, label="ANCF, order 8", **_HOLLOW)
    _finish(axes, yscale="log", ylabel="time per evaluation [µs]")


def _draw_evaluation_numbers(axes: Axes, rows: list[Row]) -> None:
    for model in MODELS:
        mine = select(rows, figure="2.17", model=model, y_name="evaluations")
        method = f"\n({mine[0].case})" if mine else ""
        _draw(axes, mine, label=f"{label_of(model)}{method}")
    _finish(axes, yscale="log", ylabel="evaluations for 5 s")


def _draw_simulation_times(axes: Axes, rows: list[Row], figure: str, duration: float) -> None:
    """Computation times; measured ones beside products of number and time."""
    for model in MODELS:
        mine = select(rows, figure=figure, model=model, y_name="computation_time_s")
        measured = [row for row in mine if row.case.endswith(", measured")]
        _draw(axes, [row for row in mine if row not in measured])
        _draw(axes, measured, label="_", **_HOLLOW)
    _draw_level(axes, duration, linestyle="--")
    _note(axes, (1, duration), "real time", va="top", xytext=(0, -3))
    _finish(axes, yscale="log", ylabel=f"computation time of {duration:g} s [s]")


def _draw_table(
    axes: Axes, rows: list[Row], figure: str, names: tuple[str, ...], label: str
) -> None:
    """Numbers of a table beside the thesis', corrected, one line per solver and accuracy."""
    mine = [row for row in select(rows, figure=figure) if row.y_name in names]
    cases = list(dict.fromkeys(row.case for row in mine))
    for row in mine:
        style = style_of(row.model)
        place = cases.index(row.case) + 0.24 * (MODELS.index(row.model) - 1)
        meant = row.thesis if row.audit is None else row.audit
        axes.plot([row.y, meant], [place, place], color=style.colour, linewidth=0.8)
        line = style.points | {"markersize": 5, "linestyle": "none"}
        axes.plot(row.y, place, **line)
        axes.plot(meant, place, **line, markerfacecolor="white")
    axes.set_yticks(range(len(cases)), [case.replace(", ", "\n") for case in cases], fontsize=8)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel=label)


def _cost_message(rows: list[Row]) -> str:
    """What evaluations of the finest models take."""
    finest = _finest(rows, figure="2.16", case="compiled", y_name="evaluation_time_s").items()
    times = [(r.y, f"{1e6 * r.y:.2g} µs ({label_of(model)})", r.n) for model, r in finest]
    least, most = min(times), max(times)
    return f"With {most[2]} pieces an evaluation takes {least[1]} to {most[1]}"


# -------------------- spiral: Fig. 2.20 to 2.22

_MEAN = "mean of models"


def _draw_distances(axes: Axes, rows: list[Row]) -> None:
    _draw_models(axes, rows, 1e3, figure="2.20", case="spiral", y_name="mean_distance_m")
    for bound, dashes, text in (
        (values.CHOSEN_BOUND, "--", "thesis' limit for Tab. 2.2"),
        (values.FINEST_BOUND, ":", "thesis' bound for the finest"),
    ):
        _draw_level(axes, 1e3 * bound, linestyle=dashes)
        _note(axes, (20, 1e3 * bound), text, ha="right")
    _finish(axes, yscale="log", ylabel="mean distance to the mean of the models [mm]")


def _draw_tips(axes: Axes, rows: list[Row], names: tuple[str, str], settings: dict) -> None:
    """Two of time, x and y for all models and their mean, smoothly interpolated."""
    for model in (_MEAN, *MODELS):
        x = select(rows, figure="2.21", case="spiral", model=model)
        y = select(rows, figure="2.22", case="spiral", model=model, y_name="tip_y_m")
        time = [row.x for row in x]
        fine = np.linspace(time[0], time[-1], 1201)
        smooth = (CubicSpline(time, [1e3 * row.y for row in part])(fine) for part in (x, y))
        series = dict(zip(("time", "x", "y"), (fine, *smooth), strict=True))
        axes.plot(*(series[name] for name in names), **_tip_style(model))
    axes.set(**settings)


def _tip_style(model: str) -> dict[str, Any]:
    if model == _MEAN:
        return {"color": "0.75", "linewidth": 3, "label": model}
    label = f"{label_of(model)}, {values.CHOSEN[model]} pieces (Figs. 2.21, 2.22)"
    return style_of(model).curve | {"linewidth": 1.2, "label": label}


def _spiral_message(rows: list[Row]) -> str:
    """How far the tips of the finest models are from their mean."""
    finest = _finest(rows, figure="2.20", y_name="mean_distance_m").items()
    off = [(r.y, f"{1e3 * r.y:.2g} mm ({label_of(model)}, {r.n} pieces)") for model, r in finest]
    return f"The finest models' tips are {min(off)[1]} to {max(off)[1]} from the mean of all"


# -------------------- the pictures


class Picture(NamedTuple):
    """A group of figures: what it shows, what it says, columns, size [inch], panels and legend."""

    subject: str
    message: Callable[[list[Row]], str]
    columns: int
    size: tuple[float, float]
    panels: dict[str, tuple]
    legend: Callable[[], Sequence[figures.Line2D]] = tuple


_SAG = "2.11", "tip_deflection_m", 1e3, "tip deflection [mm]"
_BEND = "2.13", "frequency_Hz", 1.0, "first bending frequency [Hz]"
_COMPUTED = ("computation_time_s",), "computation time [s]"
_STEPS = ("step_s", "smallest_step_s", "largest_step_s"), "step [s]"
_TIME = ("time", "x"), {"xlabel": "time [s]", "ylabel": "tip, x [mm]"}
_PATH = ("x", "y"), {"xlabel": "tip, x [mm]", "ylabel": "tip, y [mm]", "aspect": "equal"}

#: What is appended to a picture's name -> the picture.
_PICTURES = {
    "": Picture(
        "deflections, shapes and frequencies of the beam models",
        *(_accuracy_message, 2, (9.0, 13.0)),
        {
            "Fig. 2.11a  self-weight, stiff set": (_draw_pieces, *_SAG, "stiff", (0, 29)),
            "Fig. 2.11b  self-weight, weak set": (_draw_pieces, *_SAG, "weak", (0, 520)),
            "Fig. 2.12  weak set, 5 pieces": (_draw_centrelines,),
            "Fig. 2.14  static torsion, weak set": (_draw_twist,),
            "Fig. 2.13a  bending, stiff set": (_draw_pieces, *_BEND, "stiff", (2.8, 8)),
            "Fig. 2.13b  bending, weak set": (_draw_pieces, *_BEND, "weak", (0.35, 1.05)),
            "Fig. 2.15  torsional oscillation, weak set": (_draw_torsional,),
        },
        _accuracy_legend,
    ),
    "_cosserat": Picture(
        "drift and weighting of the Cosserat rod",
        *(_cosserat_message, 2, (9.5, 7.6)),
        {
            "Fig. 2.4  drift of the quaternions, weak set, 5 pieces": (_draw_drift,),
            "Fig. 2.5  weighting functions": (_draw_weightings,),
            "Fig. 2.6  their influence, by the moments": (_draw_influence,),
        },
        lambda: [entry(text, color=BLACK, linestyle=line) for text, line in _TOLERANCES.items()],
    ),
    "_quadrature": Picture(
        "quadrature of elastic forces, error and time",
        *(_quadrature_message, 2, (10.0, 4.4)),
        {
            "Fig. 2.8  error of the elastic force, one element": (_draw_errors,),
            "Fig. 2.9  time, with damping and inertia": (_draw_times,),
        },
    ),
    "_cost": Picture(
        "what beam models cost",
        *(_cost_message, 2, (9.5, 11.5)),
        {
            "Fig. 2.16  right-hand side, planar PCC and ANCF": (_draw_evaluation_times,),
            "Fig. 2.17  number of evaluations, weak set": (_draw_evaluation_numbers,),
            "Fig. 2.18  number times time, and measured": (_draw_simulation_times, "2.18", 5.0),
            "Fig. 2.19  spiral, relative tolerance 1e-3": (_draw_simulation_times, "2.19", 3.0),
            "Tab. 2.2  spiral, computation times": (_draw_table, "tab2.2", *_COMPUTED),
            "Tab. 2.3  spiral, steps, columns corrected": (_draw_table, "tab2.3", *_STEPS),
        },
        lambda: [*_model_entries(), _hollow_entry("hollow: measured (Fig. 2.18), thesis (tables)")],
    ),
    "_spiral": Picture(
        "the spiral under a turning force",
        *(_spiral_message, 3, (12, 4.9)),
        {
            "Fig. 2.20  distance over the number of pieces": (_draw_distances,),
            "Fig. 2.21  tip over time": (_draw_tips, *_TIME),
            "Fig. 2.22  path of the tip": (_draw_tips, *_PATH),
        },
        lambda: [entry(**_tip_style(model)) for model in (_MEAN, *MODELS)],
    ),
}


def pictures(rows: list[Row]) -> dict[str, figures.Figure]:
    """The figures on accuracy, and the others with their names appended to the file's."""
    found = {}
    for name, picture in _PICTURES.items():
        lines = -(-len(picture.panels) // picture.columns)
        figure, axes = figures.new_figure(lines, picture.columns, picture.size)
        for axis, (title, (draw, *given)) in zip(axes.flat, picture.panels.items(), strict=False):
            axis.set_title(title, fontsize=10)
            axis.tick_params(labelsize=8.5)
            draw(axis, rows, *given)
        figures.add_legend(figure, picture.legend())
        figures.add_title(figure, picture.message(rows), f"As in the thesis: {picture.subject}")
        found["{}" + name] = figure
    return found
