"""What evaluations and simulations cost: Fig. 2.16 to 2.19, Tab. 2.2 and 2.3."""

from functools import partial

from softrobot_env.benchmarks.thesis.figures.drawing import (
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
from softrobot_env.rendering.figures import Axes, Line2D, label_of, style_of

_HOLLOW = {"linestyle": ":", "markerfacecolor": "white"}


def _draw_evaluation_times(axes: Axes, rows: list[Row]) -> None:
    draw_models(axes, rows, "2.16", "compiled", "evaluation_time_s", 1e6)
    mine = select(rows, figure="2.16", case="compiled, order 8")
    draw_model(axes, mine, 1e6, label="ANCF, order 8", **_HOLLOW)
    axes.set(yscale="log", ylabel="time per evaluation [µs]")
    set_pieces_axis(axes)
    name_ends(axes)


def _draw_evaluation_numbers(axes: Axes, rows: list[Row]) -> None:
    for model in MODELS:
        mine = select(rows, figure="2.17", model=model, y_name="evaluations")
        method = f"\n({mine[0].case})" if mine else ""
        draw_model(axes, mine, label=f"{label_of(model)}{method}")
    axes.set(yscale="log", ylabel="evaluations for 5 s")
    set_pieces_axis(axes)
    name_ends(axes)


def _draw_simulation_times(axes: Axes, rows: list[Row], figure: str, duration: float) -> None:
    """Computation times; measured ones beside products of number and time."""
    for model in MODELS:
        mine = select(rows, figure=figure, model=model, y_name="computation_time_s")
        measured = [row for row in mine if row.case.endswith(", measured")]
        draw_model(axes, [row for row in mine if row not in measured])
        draw_model(axes, measured, label="_", **_HOLLOW)
    draw_level(axes, duration, linestyle="--")
    note_at(axes, (1, duration), "real time", va="top", xytext=(0, -3))
    axes.set(yscale="log", ylabel=f"computation time of {duration:g} s [s]")
    set_pieces_axis(axes)
    name_ends(axes)


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


_TIMES, _STEPS = ("computation_time_s",), ("step_s", "smallest_step_s", "largest_step_s")


def legend(rows: list[Row]) -> list[Line2D]:
    """Entries of the models, and of hollow markers."""
    return [*model_entries(), hollow_entry("hollow: measured (Fig. 2.18), thesis (tables)")]


def message(rows: list[Row]) -> str:
    """What evaluations of the finest models take."""
    told = []
    for model in MODELS:
        mine = select(rows, figure="2.16", case="compiled", model=model, y_name="evaluation_time_s")
        if mine:
            finest = max(mine, key=lambda row: row.n)
            told.append((finest.y, f"{1e6 * finest.y:.2g} µs ({label_of(model)})", finest.n))
    if not told:
        return "What evaluations and simulations take"
    least, most = min(told), max(told)
    return f"With {most[2]} pieces an evaluation takes {least[1]} to {most[1]}"


COLUMNS, SIZE = 2, (9.5, 11.5)

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
    "Tab. 2.3  spiral, steps (smallest, largest)": partial(
        _draw_table, figure="tab2.3", names=_STEPS, label="step [s]"
    ),
}
