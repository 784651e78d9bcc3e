"""What the figures have in common: rows as lines in the style of their model, axes and legends."""

from typing import Any

from softrobot_env.benchmarks import records
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.figures import Axes, Line2D, entry, label_lines, label_of, style_of

#: Lines and texts beside the models.
GREY = "0.35"


def select(rows: list[Row], **values: Any) -> list[Row]:
    """Rows with given values of some fields and a value y."""
    return [row for row in records.select(rows, **values) if row.y is not None]


def draw_model(axes: Axes, rows: list[Row], factor: float = 1.0, x: str = "n", **line: Any) -> None:
    """y times a factor over n or x, in the style of the rows' model unless given."""
    if not rows:
        return
    model = rows[0].model
    style = {"markersize": 4, "linewidth": 1.1, "label": label_of(model)}
    rows = sorted(rows, key=lambda row: getattr(row, x))
    places = [getattr(row, x) for row in rows], [factor * row.y for row in rows]
    axes.plot(*places, **(style_of(model).points | style | line))


def draw_models(
    axes: Axes, rows: list[Row], figure: str, case: str, y_name: str, factor: float
) -> None:
    """A line for each model."""
    for model in MODELS:
        mine = select(rows, figure=figure, case=case, model=model, y_name=y_name)
        draw_model(axes, mine, factor)


def draw_level(axes: Axes, y: float, **line: Any) -> None:
    """A horizontal line for a number that does not depend on the abscissa."""
    axes.axhline(y, **({"color": GREY, "linewidth": 1} | line))


def set_pieces_axis(axes: Axes) -> None:
    """Whole numbers of pieces."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("number of pieces")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def model_entries(**line: Any) -> list[Line2D]:
    """Entries of the models in a legend."""
    return [entry(label_of(m), **style_of(m).points | {"markersize": 4} | line) for m in MODELS]


def hollow_entry(text: str) -> Line2D:
    """Entry of dotted lines with hollow markers, of any model."""
    style = {"linestyle": ":", "marker": "o", "markersize": 4, "markerfacecolor": "white"}
    return entry(text, color=GREY, **style)


def name_ends(axes: Axes) -> None:
    """Names of all lines that have one at their right ends, in place of a legend."""
    lines = [line for line in axes.lines if not line.get_label().startswith("_")]
    ends = [(line.get_label(), float(line.get_ydata()[-1]), line.get_color()) for line in lines]
    label_lines(axes, ends)


def note_at(axes: Axes, place: tuple[float, float], text: str, **options: Any) -> None:
    """A grey text above a place in the axes' units."""
    text_at = {"xytext": (0, 3), "textcoords": "offset points", "color": GREY, "fontsize": 8}
    axes.annotate(text, place, **(text_at | options))
