"""What the figures have in common: rows as lines in the style of their model, axes and legends."""

from typing import Any

from softrobot_env.benchmarks import records
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.figures import Axes, label_of, style_of

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


def add_legend(axes: Axes, **options: Any) -> None:
    """A legend in the panel."""
    axes.legend(**({"fontsize": 7.5, "framealpha": 0.9} | options))


def leave_headroom(axes: Axes) -> None:
    """Leave the upper fourth of a logarithmic axis to the legend."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.33)
