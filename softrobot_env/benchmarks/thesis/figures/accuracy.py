"""How accurate the models are by their number of pieces: Fig. 2.11 to 2.15."""

from functools import partial

from softrobot_env.benchmarks.thesis.figures.drawing import (
    GREY,
    draw_level,
    draw_model,
    draw_models,
    hollow_entry,
    model_entries,
    name_ends,
    note_at,
    select,
    set_pieces_axis,
)
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.benchmarks.thesis.statics import LOCKED
from softrobot_env.rendering.figures import SKY, WINE, Axes, Line2D, entry, label_of, style_of

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
    name_ends(axes)


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
    draw_level(axes, 1e3 * exact.y, label="exact")
    for model in MODELS:
        mine = select(rows, figure="2.14", case="tip", model=model)
        hollow = {"markerfacecolor": "none", "label": f"{label_of(model)}, tip"}
        draw_model(axes, mine, 1e3, **(hollow if model == "cosserat" else {}))
    mine = select(rows, figure="2.14", case="last section")
    draw_model(axes, mine, 1e3, label="Cosserat rod, last\nsection (thesis)")
    axes.set_ylabel("torsion angle at 0.01 N m [mrad]")
    set_pieces_axis(axes)
    name_ends(axes)


def _draw_torsional(axes: Axes, rows: list[Row]) -> None:
    hollow = {"markerfacecolor": "none", "linestyle": ":"}
    for case, line in {"nu = 0": {}, "nu = 0.49": hollow}.items():
        for row in select(rows, figure="2.15", case=case, model="analytic"):
            dashes = line.get("linestyle", "-")
            draw_level(axes, row.y, linestyle=dashes)
            note_at(axes, (20, row.y), f"exact, {case}", ha="right", xytext=(0, 5))
        for model in MODELS:
            mine = select(rows, figure="2.15", case=case, model=model)
            draw_model(axes, mine, **line)
    axes.set_ylabel("first torsional frequency [Hz]")
    set_pieces_axis(axes)


def _draw_nothing(axes: Axes, rows: list[Row]) -> None:
    axes.set_visible(False)


def legend(rows: list[Row]) -> list[Line2D]:
    """Entries of what several panels show."""
    theory = [
        entry(label, color=GREY, linestyle=dashes, linewidth=1)
        for label, dashes in _THEORY.values()
    ]
    locked = [
        entry(f"ANCF, {case}", color=colour, marker=marker, markersize=4)
        for case, (colour, marker) in _LOCKED_STYLE.items()
    ]
    return [*theory, *model_entries(), *locked, hollow_entry("Fig. 2.15: nu = 0.49")]


def message(rows: list[Row]) -> str:
    """How far the finest models are from the exact rod under their weight."""
    off, sag = {}, {"figure": "2.11", "y_name": "tip_deflection_m"}
    for exact in select(rows, model="exact_rod", **sag):
        for model in MODELS:
            mine = select(rows, case=exact.case, model=model, **sag)
            if mine:
                finest = max(mine, key=lambda row: row.n)
                off[model, exact.case] = abs(finest.y / exact.y - 1), finest.n
    if not off:
        return "Deflections and frequencies over the number of pieces"
    model, case = worst = max(off, key=off.__getitem__)
    share, pieces = off[worst]
    return (
        f"With {pieces} pieces and nu = 0 deflections are within {100 * share:.2g} % of the exact "
        f"rod's (farthest: {label_of(model)}, {case} set)"
    )


COLUMNS, SIZE = 2, (9.0, 13.0)

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
    "": _draw_nothing,
}
