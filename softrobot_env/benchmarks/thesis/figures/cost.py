"""What evaluations and simulations cost: Fig. 2.16 to 2.19, Tab. 2.2 and 2.3."""

from functools import partial

from softrobot_env.benchmarks.thesis.figures.drawing import (
    GREY,
    add_legend,
    draw_level,
    draw_model,
    draw_models,
    leave_headroom,
    select,
    set_pieces_axis,
)
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.figures import Axes, entry, label_of, style_of

_HOLLOW = {"linestyle": ":", "markerfacecolor": "white"}


def _draw_evaluation_times(axes: Axes, rows: list[Row]) -> None:
    draw_models(axes, rows, "2.16", "compiled", "evaluation_time_s", 1e6)
    mine = select(rows, figure="2.16", case="compiled, order 8")
    draw_model(axes, mine, 1e6, label="ANCF, Gauss-Legendre of order 8", **_HOLLOW)
    axes.set(yscale="log", ylabel=r"time per evaluation [$\mu$s]")
    leave_headroom(axes)
    set_pieces_axis(axes)
    add_legend(axes, loc="upper left")


def _draw_evaluation_numbers(axes: Axes, rows: list[Row]) -> None:
    for model in MODELS:
        mine = select(rows, figure="2.17", model=model, y_name="evaluations")
        method = f" ({mine[0].case})" if mine else ""
        draw_model(axes, mine, label=f"{label_of(model)}{method}")
    axes.set(yscale="log", ylabel="evaluations for 5 s")
    leave_headroom(axes)
    set_pieces_axis(axes)
    add_legend(axes, loc="upper left")


def _draw_simulation_times(axes: Axes, rows: list[Row], figure: str, duration: float) -> None:
    """Computation times; measured ones beside products of number and time."""
    for model in MODELS:
        mine = select(rows, figure=figure, model=model, y_name="computation_time_s")
        measured = [row for row in mine if row.case.endswith(", measured")]
        draw_model(axes, [row for row in mine if row not in measured])
        draw_model(axes, measured, label=f"{label_of(model)}, measured", **_HOLLOW)
    draw_level(axes, duration, linestyle="--")
    axes.text(1, duration * 0.92, "real time", color=GREY, fontsize=8, va="top")
    axes.set(yscale="log", ylabel=f"computation time of {duration:g} s [s]")
    set_pieces_axis(axes)
    add_legend(axes, loc="lower right")


def _draw_table(
    axes: Axes, rows: list[Row], figure: str, names: tuple[str, ...], label: str
) -> None:
    """Numbers of a table beside the thesis', one line per solver and accuracy."""
    mine = [row for row in select(rows, figure=figure) if row.y_name in names]
    cases = list(dict.fromkeys(row.case for row in mine))
    for row in mine:
        style = style_of(row.model)
        place = cases.index(row.case) + 0.24 * (MODELS.index(row.model) - 1)
        axes.plot([row.y, row.thesis], [place, place], color=style.colour, linewidth=0.8)
        line = style.points | {"markersize": 5, "linestyle": "none"}
        axes.plot(row.y, place, **line)
        axes.plot(row.thesis, place, **line, markerfacecolor="white")
    axes.set_yticks(range(len(cases)), [case.replace(", ", "\n") for case in cases], fontsize=8)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel=label)
    point = {"linestyle": "none", "markersize": 5}
    handles = [entry(label_of(model), **style_of(model).points, **point) for model in MODELS]
    for text, face in (("ours", GREY), ("thesis", "white")):
        handles.append(entry(text, color=GREY, marker="o", markerfacecolor=face, **point))
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 5}
    narrow = {"frameon": False, "columnspacing": 0.8, "handletextpad": 0.1}
    add_legend(axes, handles=handles, **place, **narrow)


_TIMES, _STEPS = ("computation_time_s",), ("step_s", "smallest_step_s", "largest_step_s")

COLUMNS, SIZE = 3, (12, 8.4)

#: What they show.
SUBJECT = "what beam models cost"
PANELS = {
    "Fig. 2.16  right-hand side, planar PCC and ANCF": _draw_evaluation_times,
    "Fig. 2.17  number of evaluations, weak set": _draw_evaluation_numbers,
    "Fig. 2.18  number times time, and measured": partial(
        _draw_simulation_times, figure="2.18", duration=5.0
    ),
    "Fig. 2.19  spiral, relative tolerance 1e-3": partial(
        _draw_simulation_times, figure="2.19", duration=3.0
    ),
    "Tab. 2.2  spiral, computation times": partial(
        _draw_table, figure="tab2.2", names=_TIMES, label="computation time [s]"
    ),
    "Tab. 2.3  spiral, steps (adaptive: smallest, largest)": partial(
        _draw_table, figure="tab2.3", names=_STEPS, label="step [s]"
    ),
}
