"""How accurate the models are by their number of pieces: Fig. 2.11 to 2.15."""

from functools import partial

from softrobot_env.benchmarks.thesis.figures.drawing import (
    add_legend,
    draw_level,
    draw_model,
    draw_models,
    select,
    set_pieces_axis,
)
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.benchmarks.thesis.statics import LOCKED
from softrobot_env.rendering.figures import SKY, WINE, Axes, label_of, style_of

_LOCKED_STYLE = dict(zip(LOCKED.values(), ((SKY, "v"), (WINE, "D")), strict=True))
_THEORY = {
    "euler_bernoulli": ("Euler-Bernoulli", "--"),
    "timoshenko": ("Timoshenko, k = 3/4", "-."),
    "elastica": ("elastica (no shear)", (0, (1, 1))),
    "exact_rod": ("exact rod, k = 3/4", "-"),
}


def _draw_pieces(
    axes: Axes, rows: list[Row], figure: str, name: str, y_name: str, factor: float
) -> None:
    """Models over their pieces, ANCF with the Poisson ratio of silicone, and beam theories."""
    for model, (label, dashes) in _THEORY.items():
        for row in select(rows, figure=figure, case=name, model=model):
            draw_level(axes, factor * row.y, linestyle=dashes, label=label, zorder=1)
    draw_models(axes, rows, figure, name, y_name, factor)
    for case, (color, marker) in _LOCKED_STYLE.items():
        mine = select(rows, figure=figure, case=f"{name}, {case}")
        draw_model(axes, mine, factor, color=color, marker=marker, label=f"ANCF, {case}")
    set_pieces_axis(axes)


def _draw_deflections(axes: Axes, rows: list[Row], name: str, top: float) -> None:
    _draw_pieces(axes, rows, "2.11", name, "tip_deflection_m", 1e3)
    axes.set(ylabel="tip deflection [mm]", ylim=(0, top))


def _draw_centrelines(axes: Axes, rows: list[Row]) -> None:
    for model in MODELS:
        mine = select(rows, figure="2.12", model=model)
        x, y = ([1e3 * getattr(row, name) for row in mine] for name in "xy")
        axes.plot(x, y, color=style_of(model).colour, linewidth=1.3, label=label_of(model))
    axes.set(xlabel="along the straight beam [mm]", ylabel="deflection [mm]", aspect="equal")
    axes.invert_yaxis()
    add_legend(axes, loc="lower left")


def _draw_bending(axes: Axes, rows: list[Row], name: str, limits: tuple[float, float]) -> None:
    _draw_pieces(axes, rows, "2.13", name, "frequency_Hz", 1.0)
    axes.set(ylabel="first bending frequency [Hz]", ylim=limits)
    # Say where the finest discretisation lies that is above the panel's top.
    mine = select(rows, figure="2.13", case=f"{name}, {LOCKED['strain']}")
    finest = max(mine, key=lambda row: row.n).y if mine else 0.0
    if finest > limits[1]:
        text = f"plane strain is off the scale: {finest:.3g} Hz"
        axes.text(0.97, 0.95, text, transform=axes.transAxes, ha="right", va="top", fontsize=8)


def _draw_twist(axes: Axes, rows: list[Row]) -> None:
    (exact,) = select(rows, figure="2.14", case="0.01 N m")
    draw_level(axes, 1e3 * exact.y, label="exact = thesis, 19.08 mrad")
    for model in MODELS:
        mine = select(rows, figure="2.14", case="tip", model=model)
        hollow = {"markerfacecolor": "none", "label": f"{label_of(model)}, tip"}
        draw_model(axes, mine, 1e3, **(hollow if model == "cosserat" else {}))
    mine = select(rows, figure="2.14", case="last section")
    draw_model(axes, mine, 1e3, label="Cosserat rod, last section (thesis)")
    axes.set_ylabel("torsion angle at 0.01 N m [mrad]")
    set_pieces_axis(axes)
    add_legend(axes, loc="lower right")


def _draw_torsional(axes: Axes, rows: list[Row]) -> None:
    hollow = {"markerfacecolor": "none", "linestyle": ":"}
    for case, line in {"nu = 0": {}, "nu = 0.49": hollow}.items():
        for row in select(rows, figure="2.15", case=case, model="analytic"):
            dashes = line.get("linestyle", "-")
            draw_level(axes, row.y, linestyle=dashes, label=f"exact, {case}")
        for model in MODELS:
            mine = select(rows, figure="2.15", case=case, model=model)
            draw_model(axes, mine, label=f"{label_of(model)}, {case}", **line)
    axes.set_ylabel("first torsional frequency [Hz]")
    set_pieces_axis(axes)
    add_legend(axes, loc="upper right", ncols=2)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.55 * (high - low))


def _draw_legend(axes: Axes, rows: list[Row]) -> None:
    """Legend of the deflections and bending frequencies, in a panel of its own."""
    axes.set_axis_off()
    handles, labels = axes.figure.axes[0].get_legend_handles_labels()
    axes.legend(handles, labels, loc="center", fontsize=9, frameon=False)


COLUMNS, SIZE = 4, (13, 7)

#: What they show.
SUBJECT = "deflections, shapes and frequencies of the beam models"
PANELS = {
    "Fig. 2.11a  self-weight, stiff set": partial(_draw_deflections, name="stiff", top=29),
    "Fig. 2.11b  self-weight, weak set": partial(_draw_deflections, name="weak", top=520),
    "Fig. 2.12  weak set, 5 pieces": _draw_centrelines,
    "Fig. 2.14  static torsion, weak set": _draw_twist,
    "Fig. 2.13a  bending, stiff set": partial(_draw_bending, name="stiff", limits=(2.8, 8)),
    "Fig. 2.13b  bending, weak set": partial(_draw_bending, name="weak", limits=(0.35, 1.05)),
    "Fig. 2.15  torsional oscillation, weak set": _draw_torsional,
    "legend of Fig. 2.11 and 2.13": _draw_legend,
}
