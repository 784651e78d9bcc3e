"""Maps of numbers, and names beside points and in corners, of pictures of studies."""

from collections.abc import Sequence

import numpy as np

from softrobot_env.rendering.figures import Axes

#: Colour of cells without a number.
_EMPTY = "0.85"

_SIZE = 8.5  # of texts


def heatmap(
    axis: Axes,
    values: np.ndarray,
    texts: Sequence[Sequence[str]],
    lines: Sequence[str],
    columns: Sequence[str],
    colours: tuple[float, float],
) -> None:
    """Draw a map of numbers: light is good, dark is bad, on a logarithmic scale.

    Args:
        axis: The axes.
        values: (lines, columns), NaN where there is none; what is beyond the colours has their end.
        texts: What stands in the cells; red where there is no number but a reason.
        lines, columns: Their names.
        colours: Smallest and largest value of the scale.
    """
    from matplotlib.colors import LogNorm

    shown, norm = np.ma.masked_invalid(np.clip(values, *colours)), LogNorm(*colours)
    axis.grid(False)
    axis.set_facecolor(_EMPTY)
    axis.pcolormesh(shown, cmap="viridis_r", norm=norm, edgecolors="white", lw=1)
    dark = norm(shown) > 0.55
    for i, j in np.ndindex(values.shape):
        colour = "white" if dark[i, j] else "black"
        if np.isnan(values[i, j]):
            colour = "black" if texts[i][j] == "-" else "#A50026"
        text = {"ha": "center", "va": "center", "size": _SIZE, "color": colour}
        axis.text(j + 0.5, i + 0.5, texts[i][j], **text)
    axis.set_yticks(np.arange(len(lines)) + 0.5, lines)
    axis.set_xticks(np.arange(len(columns)) + 0.5, columns, fontsize=_SIZE)
    axis.tick_params(length=0)
    axis.invert_yaxis()


def label_points(
    axis: Axes, entries: Sequence[tuple[str, Sequence[tuple[float, float]], str]], size: float = 8
) -> None:
    """Names beside points, each at the first side where it covers neither points nor names.

    Args:
        axis: The axis, on a figure that has all else that it shall have.
        entries: Name, places of its points in the axis' units, and colour of each.
        size: Of the letters [pt].
    """
    axis.figure.draw_without_rendering()  # finds the place of the axis
    to_points = 72 / axis.figure.dpi
    places = {
        name: to_points * axis.transData.transform(np.array(points)) for name, points, _ in entries
    }
    drawn = [np.column_stack(line.get_data()) for line in axis.lines]
    every = to_points * axis.transData.transform(np.concatenate([np.empty((0, 2)), *drawn]))
    edges = to_points * axis.transAxes.transform([(0, 0), (1, 1)])
    taken: list[np.ndarray] = []
    for name, points, colour in entries:
        own, width = places[name], 0.62 * size * len(name)
        choices = []
        for k, ha, va, dx, dy in _sides(own, size):
            x, y = own[k] + (dx, dy)
            left = x - {"left": 0.0, "center": width / 2, "right": width}[ha]
            low = y - {"bottom": 0.0, "center": size / 2, "top": size}[va]
            box = np.array([left, low, left + width, low + size])
            crossed = sum(_meet(box, other) for other in taken)
            crossed += bool((box[:2] < edges[0]).any() or (box[2:] > edges[1]).any())
            covered = np.sum(
                (every > box[:2] - size / 2).all(axis=1) & (every < box[2:] + size / 2).all(axis=1)
            )
            choices.append((crossed, covered, len(choices), box, (k, ha, va, dx, dy)))
        *_, box, (k, ha, va, dx, dy) = min(choices, key=lambda choice: choice[:3])
        taken.append(box)
        text = {"color": colour, "fontsize": size, "ha": ha, "va": va}
        axis.annotate(name, points[k], (dx, dy), textcoords="offset points", **text)


def _sides(points: np.ndarray, size: float) -> list[tuple[int, str, str, float, float]]:
    """Where a name may stand: at which point, how it is aligned, and how far off [pt]."""
    first, last = int(np.argmin(points[:, 0])), int(np.argmax(points[:, 0]))
    low, high = int(np.argmin(points[:, 1])), int(np.argmax(points[:, 1]))
    near, far = 0.8 * size, 1.6 * size
    return [
        (last, "left", "center", near, 0.0),
        (first, "right", "center", -near, 0.0),
        (high, "center", "bottom", 0.0, near),
        (low, "center", "top", 0.0, -near),
        (last, "left", "bottom", near, near / 2),
        (last, "left", "top", near, -near / 2),
        (high, "center", "bottom", 0.0, far),
        (low, "center", "top", 0.0, -far),
    ]


def _meet(box: np.ndarray, other: np.ndarray) -> bool:
    """Whether two boxes (left, low, right, high) cover each other."""
    return bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all())


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
