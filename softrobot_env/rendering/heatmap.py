"""Maps of numbers by lines and columns: light is good, dark is bad, on a logarithmic scale."""

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
    """Draw a map.

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
