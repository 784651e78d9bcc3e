"""Notes in corners of pictures of studies."""

from collections.abc import Sequence

from softrobot_env.rendering.figures import Axes


def add_notes(axis: Axes, notes: Sequence[tuple[str, str]], place: str = "upper right") -> None:
    """Lines of text in a corner of a panel, each in a colour, in place of a legend.

    Args:
        axis: The axis.
        notes: Text and colour of each line.
        place: The corner, such as "upper right".
    """
    upper, right = place.startswith("upper"), place.endswith("right")
    for k, (text, colour) in enumerate(notes if upper else notes[::-1]):
        axis.annotate(
            text,
            (float(right), float(upper)),
            ((-1 if right else 1) * 5, (-1 if upper else 1) * (4 + 11 * k)),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right" if right else "left",
            va="top" if upper else "bottom",
            fontsize=8,
            color=colour,
        )
