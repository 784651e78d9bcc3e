"""Pictures of the thesis benchmark, one per group of figures."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.benchmarks.thesis.statics import LOCKED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Okabe and Ito's colours, distinguishable with colour-blindness, and one marker per model.
_STYLE = {"pcc": ("#0072B2", "o"), "cosserat": ("#D55E00", "s"), "ancf": ("#009E73", "^")}
_LOCKED_STYLE = dict(zip(LOCKED.values(), (("#CC79A7", "v"), ("#E69F00", "D")), strict=True))
_NAMES = {"pcc": "PCC", "cosserat": "Cosserat rod", "ancf": "ANCF"}
_THEORY = {
    "euler_bernoulli": ("Euler-Bernoulli", "--"),
    "timoshenko": ("Timoshenko, k = 3/4", "-."),
    "elastica": ("elastica (no shear)", (0, (1, 1))),
    "exact_rod": ("exact rod, k = 3/4", "-"),
}
_GREY = "0.35"

_Draw = Callable[["Axes", list[Row]], None]


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the figures as PNG.

    Args:
        rows: Rows of `benchmarks.thesis_figures.run`.
        path: File of the figures on accuracy; the other groups' names are appended to it.
    """
    path = Path(path)
    _picture(rows, path, _ACCURACY, (2, 4), (15.5, 7.2))
    for name, (panels, shape, size) in _GROUPS.items():
        file = path.with_name(f"{path.stem}_{name}{path.suffix}")
        _picture(rows, file, panels, shape, size)


def _picture(
    rows: list[Row],
    path: Path,
    panels: tuple[tuple[str, _Draw], ...],
    shape: tuple[int, int],
    size: tuple[float, float],
) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    for axes, (title, draw) in zip(figure.subplots(*shape).flat, panels, strict=True):
        axes.set_title(title, fontsize=10)
        axes.tick_params(labelsize=8.5)
        axes.set_axisbelow(True)
        axes.grid(which="major", color="0.88", linewidth=0.6)
        draw(axes, rows)
    figure.savefig(path, dpi=110)


# ---------------------------------------------------------------- helpers


def _select(rows: list[Row], **fields: Any) -> list[Row]:
    """Rows with given values of some fields and a value y."""
    return [r for r in rows if r["y"] is not None and all(r[k] == v for k, v in fields.items())]


def _draw_model(
    axes: "Axes", rows: list[Row], factor: float = 1.0, x: str = "n", **line: Any
) -> None:
    """y times a factor over n or x, in the style of the rows' model unless given."""
    if not rows:
        return
    color, marker = _STYLE[rows[0]["model"]]
    style = {"color": color, "marker": marker, "markersize": 4, "linewidth": 1.1}
    style |= {"label": _NAMES[rows[0]["model"]]} | line
    rows = sorted(rows, key=lambda r: r[x])
    axes.plot([r[x] for r in rows], [factor * r["y"] for r in rows], **style)


def _draw_models(
    axes: "Axes", rows: list[Row], figure: str, case: str, y_name: str, factor: float, **line: Any
) -> None:
    for model in MODELS:
        mine = _select(rows, figure=figure, case=case, model=model, y_name=y_name)
        _draw_model(axes, mine, factor, **line)


def _draw_locked(axes: "Axes", rows: list[Row], figure: str, name: str, factor: float) -> None:
    """ANCF with the Poisson ratio of silicone."""
    for case, (color, marker) in _LOCKED_STYLE.items():
        mine = _select(rows, figure=figure, case=f"{name}, {case}")
        _draw_model(axes, mine, factor, color=color, marker=marker, label=f"ANCF, {case}")


def _draw_theory(axes: "Axes", rows: list[Row], figure: str, name: str, factor: float) -> None:
    for model, (label, dashes) in _THEORY.items():
        for row in _select(rows, figure=figure, case=name, model=model):
            axes.axhline(
                factor * row["y"], color=_GREY, linestyle=dashes, linewidth=1, label=label, zorder=1
            )


def _pieces_axis(axes: "Axes") -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("number of pieces")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _legend(axes: "Axes", **options: Any) -> None:
    axes.legend(**({"fontsize": 7.5, "framealpha": 0.9} | options))


def _headroom(axes: "Axes") -> None:
    """Leave the upper fourth of a logarithmic axis to the legend."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.33)


# ---------------------------------------------------------------- accuracy


def _deflections(name: str, top: float) -> _Draw:
    def draw(axes: "Axes", rows: list[Row]) -> None:
        _draw_theory(axes, rows, "2.11", name, 1e3)
        _draw_models(axes, rows, "2.11", name, "tip_deflection_m", 1e3)
        _draw_locked(axes, rows, "2.11", name, 1e3)
        axes.set_ylabel("tip deflection [mm]")
        axes.set_ylim(0, top)
        _pieces_axis(axes)

    return draw


def _centrelines(axes: "Axes", rows: list[Row]) -> None:
    for model in MODELS:
        mine = _select(rows, figure="2.12", model=model)
        if mine:
            color, _ = _STYLE[model]
            x, y = ([1e3 * r[k] for r in mine] for k in ("x", "y"))
            axes.plot(x, y, color=color, linewidth=1.3, label=_NAMES[model])
    axes.set_xlabel("along the straight beam [mm]")
    axes.set_ylabel("deflection [mm]")
    axes.invert_yaxis()
    axes.set_aspect("equal")
    _legend(axes, loc="lower left")


def _bending(name: str, limits: tuple[float, float]) -> _Draw:
    def draw(axes: "Axes", rows: list[Row]) -> None:
        _draw_theory(axes, rows, "2.13", name, 1.0)
        _draw_models(axes, rows, "2.13", name, "frequency_Hz", 1.0)
        _draw_locked(axes, rows, "2.13", name, 1.0)
        axes.set_ylabel("first bending frequency [Hz]")
        axes.set_ylim(*limits)
        _off_scale(axes, rows, f"{name}, {LOCKED['strain']}", limits[1])
        _pieces_axis(axes)

    return draw


def _off_scale(axes: "Axes", rows: list[Row], case: str, top: float) -> None:
    """Say where the finest discretisation of a case lies, if above the panel's top."""
    mine = _select(rows, figure="2.13", case=case)
    finest = max(mine, key=lambda r: r["n"])["y"] if mine else 0.0
    if finest > top:
        text = f"plane strain is off the scale: {finest:.3g} Hz"
        axes.text(0.97, 0.95, text, transform=axes.transAxes, ha="right", va="top", fontsize=8)


def _twist(axes: "Axes", rows: list[Row]) -> None:
    exact = _select(rows, figure="2.14", case="0.01 N m")
    axes.axhline(1e3 * exact[0]["y"], color=_GREY, linewidth=1, label="exact = thesis, 19.08 mrad")
    for model, hollow in (("pcc", False), ("ancf", False), ("cosserat", True)):
        mine = _select(rows, figure="2.14", case="tip", model=model)
        line = {"markerfacecolor": "none"} if hollow else {}
        label = f"{_NAMES[model]}, tip" if hollow else _NAMES[model]
        _draw_model(axes, mine, 1e3, label=label, **line)
    mine = _select(rows, figure="2.14", case="last section")
    _draw_model(axes, mine, 1e3, label="Cosserat rod, last section (thesis)")
    axes.set_ylabel("torsion angle at 0.01 N m [mrad]")
    _pieces_axis(axes)
    _legend(axes, loc="lower right")


def _torsional(axes: "Axes", rows: list[Row]) -> None:
    for case, line in (
        ("nu = 0", {}),
        ("nu = 0.49", {"markerfacecolor": "none", "linestyle": ":"}),
    ):
        for row in _select(rows, figure="2.15", case=case, model="analytic"):
            dashes = "-" if case == "nu = 0" else ":"
            axes.axhline(
                row["y"], color=_GREY, linewidth=1, linestyle=dashes, label=f"exact, {case}"
            )
        for model in MODELS:
            mine = _select(rows, figure="2.15", case=case, model=model)
            label = f"{_NAMES[model]}, {case}"
            _draw_model(axes, mine, label=label, **line)
    axes.set_ylabel("first torsional frequency [Hz]")
    _pieces_axis(axes)
    _legend(axes, loc="upper right", ncols=2)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.55 * (high - low))


def _shared_legend(axes: "Axes", rows: list[Row]) -> None:
    """Legend of the deflections and bending frequencies, in a panel of its own."""
    axes.set_axis_off()
    first = axes.figure.axes[0]
    handles, labels = first.get_legend_handles_labels()
    axes.legend(handles, labels, loc="center", fontsize=9, frameon=False)


_ACCURACY: tuple[tuple[str, _Draw], ...] = (
    ("Fig. 2.11a  self-weight, stiff set", _deflections("stiff", 29)),
    ("Fig. 2.11b  self-weight, weak set", _deflections("weak", 520)),
    ("Fig. 2.12  weak set, 5 pieces", _centrelines),
    ("Fig. 2.14  static torsion, weak set", _twist),
    ("Fig. 2.13a  bending, stiff set", _bending("stiff", (2.8, 8))),
    ("Fig. 2.13b  bending, weak set", _bending("weak", (0.35, 1.05))),
    ("Fig. 2.15  torsional oscillation, weak set", _torsional),
    ("legend of Fig. 2.11 and 2.13", _shared_legend),
)


# ---------------------------------------------------------------- Cosserat rod


def _drift(axes: "Axes", rows: list[Row]) -> None:
    curves = [r for r in _select(rows, figure="2.4") if r["x_name"] == "time_s"]
    colors = {"BDF": "#0072B2", "Radau, not": "#D55E00", "Radau, projected": "#009E73"}
    for case in dict.fromkeys(r["case"] for r in curves):
        color = next(c for key, c in colors.items() if case.startswith(key))
        mine = [r for r in curves if r["case"] == case]
        strict = case.endswith("1e-05")
        solver, projection, tolerance = case.split(", ")
        axes.plot(
            [r["x"] for r in mine],
            [r["y"] for r in mine],
            color=color,
            linestyle=":" if strict else "-",
            linewidth=1.3,
            label=f"{solver}, {projection}, rel. tolerance {float(tolerance):.0e}",
        )
    for row in _select(rows, figure="2.4", y_name="largest_norm_violation"):
        if row["thesis"] is not None:
            strict = row["case"].endswith("1e-05")
            axes.axhline(
                row["thesis"],
                color="black",
                linestyle=":" if strict else "-",
                linewidth=0.9,
                label=f"thesis, projected, {'stricter' if strict else 'its first'} tolerance",
            )
    axes.set_yscale("log")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("largest violation of the norm")
    _legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=1)


_XI_COLORS = ("#000000", "#D55E00", "#CC79A7", "#E69F00", "#0072B2")


def _weightings(axes: "Axes", rows: list[Row]) -> None:
    for kind, color in enumerate(_XI_COLORS, start=1):
        mine = _select(rows, figure="2.5", case=f"xi_{kind}")
        theta = [np.degrees(r["x"]) for r in mine]
        axes.plot(theta, [r["y"] for r in mine], color=color, linewidth=1.3, label=_xi(kind))
    axes.set_xlim(0, 90)
    axes.set_ylim(0.9, 3)
    axes.set_xlabel("half the angle between sections [deg]")
    axes.set_ylabel("weighting")
    _legend(axes, loc="upper left")


def _xi(kind: int) -> str:
    return rf"$\xi_{kind}$"


def _influence(axes: "Axes", rows: list[Row]) -> None:
    for moments, dashes in (("printed", "-"), ("conservative", ":")):
        for n, marker in ((3, "s"), (5, "D")):
            mine = _select(rows, figure="2.6", case=moments, n=n, y_name="tip_deflection_m")
            line = {"linestyle": dashes, "marker": marker}
            line |= {"markerfacecolor": "#D55E00" if moments == "printed" else "white"}
            _draw_model(axes, mine, 1e3, x="x", label=f"{n} pieces, {moments} moments", **line)
    axes.set_xticks(range(1, 6), [_xi(k) for k in range(1, 6)])
    axes.set_ylabel("tip deflection [mm], weak set")
    _legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=1)


# ---------------------------------------------------------------- quadrature


def _quadrature_errors(axes: "Axes", rows: list[Row]) -> None:
    for reference, color, marker in (("order 20", "#009E73", "^"), ("exact", "#D55E00", "o")):
        mine = [
            r
            for r in _select(rows, figure="2.8", y_name="relative_rms_error")
            if r["case"] == f"legendre, against {reference}"
        ]
        _draw_model(
            axes, mine, x="x", color=color, marker=marker,
            label=f"Gauss-Legendre, against {reference}" + (" (thesis)" * (reference != "exact")),
        )  # fmt: skip
    axes.axhline(1e-3, color=_GREY, linewidth=1, linestyle="--")
    axes.axvline(8, color=_GREY, linewidth=1, linestyle=":")
    axes.text(8.2, 0.25, "thesis' choice", color=_GREY, fontsize=8)
    axes.set_yscale("log")
    axes.set_xlabel("order")
    axes.set_ylabel("relative rms error of the elastic force")
    axes.set_xticks(range(0, 21, 2))
    _legend(axes, loc="lower left")


def _quadrature_times(axes: "Axes", rows: list[Row]) -> None:
    mine = _select(rows, figure="2.9", case="legendre")
    _draw_model(axes, mine, 1e6, x="x", label="Gauss-Legendre")
    for case, color, dashes in (("exact", "#D55E00", "-"), ("chebyshev", "#0072B2", "--")):
        for row in _select(rows, figure="2.9", case=case):
            label = {"exact": "moments, exact", "chebyshev": "Gauss-Chebyshev, exact"}[case]
            axes.axhline(1e6 * row["y"], color=color, linewidth=1.2, linestyle=dashes, label=label)
    thesis = [r for r in mine if r["thesis"] is not None]
    axes.plot(
        [r["x"] for r in thesis], [1e6 * r["thesis"] for r in thesis], color="black", marker="*",
        markersize=10, linestyle="none", label="thesis, order 8",
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlabel("order")
    axes.set_ylabel(r"time per evaluation [$\mu$s]")
    axes.set_xticks(range(0, 21, 2))
    _legend(axes, loc="center right")


# ---------------------------------------------------------------- cost


def _evaluation_times(axes: "Axes", rows: list[Row]) -> None:
    _draw_models(axes, rows, "2.16", "compiled", "evaluation_time_s", 1e6)
    mine = _select(rows, figure="2.16", case="compiled, order 8")
    _draw_model(
        axes, mine, 1e6, linestyle=":", markerfacecolor="white",
        label="ANCF, Gauss-Legendre of order 8",
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylabel(r"time per evaluation [$\mu$s]")
    _headroom(axes)
    _pieces_axis(axes)
    _legend(axes, loc="upper left")


def _evaluation_numbers(axes: "Axes", rows: list[Row]) -> None:
    for model in MODELS:
        mine = _select(rows, figure="2.17", model=model, y_name="evaluations")
        method = f" ({mine[0]['case']})" if mine else ""
        _draw_model(axes, mine, label=f"{_NAMES[model]}{method}")
    axes.set_yscale("log")
    axes.set_ylabel("evaluations for 5 s")
    _headroom(axes)
    _pieces_axis(axes)
    _legend(axes, loc="upper left")


def _total_times(axes: "Axes", rows: list[Row]) -> None:
    for model in MODELS:
        mine = _select(rows, figure="2.18", model=model, y_name="computation_time_s")
        product = [r for r in mine if r["case"] == "product"]
        measured = [r for r in mine if r["case"] != "product"]
        _draw_model(axes, product)
        _draw_model(
            axes, measured, linestyle=":", markerfacecolor="white",
            label=f"{_NAMES[model]}, measured",
        )  # fmt: skip
    _realtime(axes, 5.0)
    axes.set_ylabel("computation time of 5 s [s]")
    _pieces_axis(axes)
    _legend(axes, loc="lower right")


def _spiral_times(axes: "Axes", rows: list[Row]) -> None:
    for model in MODELS:
        mine = _select(rows, figure="2.19", model=model, y_name="computation_time_s")
        _draw_model(axes, mine)
    _realtime(axes, 3.0)
    axes.set_ylabel("computation time of 3 s [s]")
    _pieces_axis(axes)
    _legend(axes, loc="lower right")


def _realtime(axes: "Axes", duration: float) -> None:
    axes.axhline(duration, color=_GREY, linewidth=1, linestyle="--")
    axes.text(1, duration * 0.92, "real time", color=_GREY, fontsize=8, va="top")
    axes.set_yscale("log")


def _table(figure: str, names: tuple[str, ...]) -> _Draw:
    """Numbers of a table beside the thesis', one line per solver and accuracy."""

    def draw(axes: "Axes", rows: list[Row]) -> None:
        mine = [r for r in _select(rows, figure=figure) if r["y_name"] in names]
        cases = list(dict.fromkeys(r["case"] for r in mine))
        for row in mine:
            color, marker = _STYLE[row["model"]]
            place = cases.index(row["case"]) + 0.24 * (MODELS.index(row["model"]) - 1)
            axes.plot([row["y"], row["thesis"]], [place, place], color=color, linewidth=0.8)
            line = {"color": color, "marker": marker, "markersize": 5, "linestyle": "none"}
            axes.plot(row["y"], place, **line)
            axes.plot(row["thesis"], place, **line, markerfacecolor="white")
        axes.set_yticks(range(len(cases)), [c.replace(", ", "\n") for c in cases], fontsize=8)
        axes.invert_yaxis()
        axes.set_xscale("log")
        axes.set_xlabel("computation time [s]" if figure == "tab2.2" else "step [s]")
        _table_legend(axes)

    return draw


def _table_legend(axes: "Axes") -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=c, marker=m, linestyle="none", markersize=5, label=_NAMES[model])
        for model, (c, m) in _STYLE.items()
    ]
    for label, face in (("ours", _GREY), ("thesis", "white")):
        handles.append(
            Line2D([], [], color=_GREY, marker="o", markerfacecolor=face, linestyle="none",
                   markersize=5, label=label)
        )  # fmt: skip
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=5, fontsize=7.5,
        frameon=False, columnspacing=0.8, handletextpad=0.1,
    )  # fmt: skip


# ---------------------------------------------------------------- spiral


def _distances(axes: "Axes", rows: list[Row]) -> None:
    _draw_models(axes, rows, "2.20", "spiral", "mean_distance_m", 1e3)
    axes.axhline(2, color=_GREY, linestyle="--", linewidth=1)
    axes.text(20, 2.06, "thesis' limit for Tab. 2.2", color=_GREY, fontsize=8, ha="right")
    axes.axhline(0.9, color=_GREY, linestyle=":", linewidth=1)
    axes.text(20, 0.93, "thesis' bound for the finest", color=_GREY, fontsize=8, ha="right")
    axes.set_yscale("log")
    axes.set_ylabel("mean distance to the mean of the models [mm]")
    _pieces_axis(axes)
    _legend(axes, loc="upper right")


def _series(rows: list[Row], model: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, int | None]:
    """Time, x and y of a model's tip, smoothly interpolated, and its number of pieces."""
    from scipy.interpolate import CubicSpline

    first, second = (_select(rows, figure=f, case="spiral", model=model) for f in ("2.21", "2.22"))
    second = [r for r in second if r["y_name"] == "tip_y_m"]
    time = np.array([r["x"] for r in first])
    fine = np.linspace(time[0], time[-1], 1201)
    x, y = (CubicSpline(time, [1e3 * r["y"] for r in part])(fine) for part in (first, second))
    return fine, x, y, first[0]["n"]


_LINES = {"pcc": (0, (4, 1.5)), "cosserat": (0, (1, 1)), "ancf": "-."}


def _tip_over_time(axes: "Axes", rows: list[Row]) -> None:
    _draw_tips(axes, rows, lambda t, x, y: (t, x))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tip, x [mm]")
    axes.set_ylim(-78, 78)
    _legend(axes, loc="lower left")


def _tip_path(axes: "Axes", rows: list[Row]) -> None:
    _draw_tips(axes, rows, lambda t, x, y: (x, y))
    axes.set_aspect("equal")
    axes.set_xlabel("tip, x [mm]")
    axes.set_ylabel("tip, y [mm]")


def _draw_tips(axes: "Axes", rows: list[Row], choose: Callable[..., tuple]) -> None:
    for model in ("mean of models", *MODELS):
        time, x, y, n = _series(rows, model)
        if n is None:
            axes.plot(*choose(time, x, y), color="0.75", linewidth=3, label=model)
        else:
            style = {"color": _STYLE[model][0], "linestyle": _LINES[model], "linewidth": 1.2}
            axes.plot(*choose(time, x, y), label=f"{_NAMES[model]}, n = {n}", **style)


_GROUPS = {
    "cosserat": (
        (
            ("Fig. 2.4  drift of the quaternions, weak set, 5 pieces", _drift),
            ("Fig. 2.5  weighting functions", _weightings),
            ("Fig. 2.6  their influence on the deflection", _influence),
        ),
        (1, 3),
        (13.5, 4.9),
    ),
    "quadrature": (
        (
            ("Fig. 2.8  error of the elastic force, one element", _quadrature_errors),
            ("Fig. 2.9  time per evaluation (with damping and inertia)", _quadrature_times),
        ),
        (1, 2),
        (10, 4.2),
    ),
    "cost": (
        (
            ("Fig. 2.16  right-hand side, planar PCC and ANCF", _evaluation_times),
            ("Fig. 2.17  number of evaluations, weak set", _evaluation_numbers),
            ("Fig. 2.18  number times time, and measured", _total_times),
            ("Fig. 2.19  spiral, relative tolerance 1e-3", _spiral_times),
            ("Tab. 2.2  spiral, computation times", _table("tab2.2", ("computation_time_s",))),
            (
                "Tab. 2.3  spiral, steps (adaptive: smallest, largest)",
                _table("tab2.3", ("step_s", "smallest_step_s", "largest_step_s")),
            ),
        ),
        (2, 3),
        (14.5, 8.6),
    ),
    "spiral": (
        (
            ("Fig. 2.20  distance over the number of pieces", _distances),
            ("Fig. 2.21  tip over time", _tip_over_time),
            ("Fig. 2.22  path of the tip", _tip_path),
        ),
        (1, 3),
        (14.5, 4.9),
    ),
}
